"""Columns of a page: rounded, in order of time, and limited to the resolution of a picture."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from hil_bridge.show.charts.columns import Arrays
from hil_bridge.show.pages.description import Chart

Array: TypeAlias = NDArray[np.float64]

ROWS_MOST = 4000
"""Maximum number of rows in a source. Chosen: four per pixel of a wide picture; a page stays below a few megabytes
for any run.
"""
_DIGITS = 6
"""Number of significant digits of a value. Chosen: more than a sensor or a robot resolves."""
_TIME_DIGITS = 5
"""Number of decimal places of a time in s."""


class Sources:
    """Sources of a page, by name."""

    def __init__(self) -> None:
        self.held: dict[str, dict[str, list[float | None]]] = {}

    def chart(self, chart: Chart, tables: Mapping[str, Arrays]) -> Chart:
        """Add the columns that a chart needs; return the chart with the names of the sources that contain them."""
        needed: dict[str, dict[str, Array]] = {}
        lines = [(one.source, column) for one in chart.bands for column in (one.low, one.high)]
        for table, column in [*((one.source, one.column) for one in chart.series), *lines]:
            if table in tables:
                needed.setdefault(table, {})[column] = tables[table][column]
        names = {
            table: self.add(table, chart.id, tables[table]["x"], columns) for table, columns in needed.items()
        }
        return replace(
            chart,
            series=[replace(one, source=names.get(one.source, one.source)) for one in chart.series],
            bands=[replace(one, source=names.get(one.source, one.source)) for one in chart.bands],
        )

    def add(self, name: str, chart: str, x: Array, columns: Mapping[str, Array]) -> str:
        """Add the columns of one chart over x; return the name of their source. Rows without x are omitted.

        A short source is shared by all charts that name it, so their x must be identical. For a long source, each
        chart gets a source of its own, with the smallest and largest value of each interval in every column.
        """
        known = np.flatnonzero(np.isfinite(x))
        order = known[np.argsort(x[known], kind="stable")]
        if len(order) <= ROWS_MOST:
            source = self.held.setdefault(name, {"x": round_times(x[order])})
        else:
            order = order[kept_rows([column[order] for column in columns.values()], len(order))]
            name = f"{name}/{chart}"
            source = self.held.setdefault(name, {"x": round_times(x[order])})
        for column, values in columns.items():
            if column not in source:
                source[column] = round_values(values[order])
        return name


def kept_rows(columns: Sequence[Array], rows: int) -> NDArray[np.intp]:
    """Return the indices of the rows of long columns to keep.

    They are the first and the last row, and the extremes of each column in equal intervals.
    """
    stretches = max(ROWS_MOST // (2 * max(len(columns), 1)) - 1, 1)
    edges = np.linspace(0, rows, stretches + 1).astype(np.intp)
    kept = {0, rows - 1}
    for column in columns:
        low, high = np.where(np.isnan(column), np.inf, column), np.where(np.isnan(column), -np.inf, column)
        for begin, end in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
            kept.add(begin + int(low[begin:end].argmin()))
            kept.add(begin + int(high[begin:end].argmax()))
    return np.array(sorted(kept), dtype=np.intp)


def round_values(values: Array) -> list[float | None]:
    """Round numbers for a page; a value that is not finite becomes None."""
    return [float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else None for value in values.tolist()]


def round_times(values: Array) -> list[float | None]:
    """Round times for a page, s."""
    return [round(value, _TIME_DIGITS) for value in values.tolist()]


def column(records: Sequence[Any], name: str) -> Array:
    """Return one column of records; None becomes NaN."""
    return np.array([getattr(record, name) for record in records], dtype=np.float64)
