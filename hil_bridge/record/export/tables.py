"""Records as tables: a row a record, a column a number or text. Times are seconds of the run's clock.

A column has the name of its field, which the recording's schema explains. The columns of a vector, a quaternion and a
wrench end in the name of the axis; those of a value by name, and of a record within the record, begin with the
field's name and a dot. What is not known is an empty cell of a CSV file, and null in Parquet.
"""

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from msgspec import Struct, structs

from hil_bridge.errors import ConfigError
from hil_bridge.errors.extras import install_command
from hil_bridge.record import CycleRecord, SensorRecord
from protocol.geometry import Wrench
from protocol.wrench import AXES, wrench_of

TIME = "time_s"
"""The first column: the run's clock, s; of a cycle when it was decided."""
COLUMNS_MAX = 1000
"""Of a table. Chosen: ten times those of a usual run; a controller may explain itself with names of its own."""
_ENDS: Mapping[int, Sequence[str]] = {3: ("x", "y", "z"), 4: ("w", "x", "y", "z"), 6: AXES}
"""Ends of the columns' names of an array, by its length."""
_UNITS = ("n", "n", "n", "nm", "nm", "nm")


@dataclass(frozen=True, slots=True)
class Table:
    """Columns in order, and rows that may lack some of them."""

    columns: tuple[str, ...]
    rows: tuple[Mapping[str, Any], ...]


def cycle_table(cycles: Sequence[CycleRecord]) -> Table:
    """Every field of every control cycle. Raises ConfigError for more columns than a table may have."""
    rows = [{TIME: cycle.controlled_at, **dict(_cells("", cycle))} for cycle in cycles]
    columns = dict.fromkeys(name for row in rows for name in row)
    if len(columns) > COLUMNS_MAX:
        raise ConfigError(
            f"the cycles have {len(columns)} columns, a table at most {COLUMNS_MAX}: the controller explains itself "
            "with too many names"
        )
    return Table(tuple(columns), tuple(rows))


def sensor_table(sensors: Sequence[SensorRecord], scales: Wrench | None) -> Table:
    """Every frame of the sensor: in N and N·m where the scales are known, and as the device counts (`_raw`)."""
    scaled = [f"{axis}_{unit}" for axis, unit in zip(AXES, _UNITS, strict=True)] if scales else []
    raw = [f"{axis}_raw" for axis in AXES]
    rows = []
    for one in sensors:
        values = wrench_of(one.counts, scales) if scales else ()
        row = {TIME: one.at, "sequence": one.sequence}
        row.update(zip(scaled, values, strict=True))
        row.update(zip(raw, one.counts, strict=True))
        rows.append(row)
    return Table((TIME, "sequence", *scaled, *raw), tuple(rows))


def as_csv(table: Table) -> bytes:
    """Comma-separated, with a line of names; numbers are told whole, so that reading them gives the same."""
    file = io.StringIO(newline="")
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(table.columns)
    for row in table.rows:
        writer.writerow([_cell(row.get(name)) for name in table.columns])
    return file.getvalue().encode(errors="backslashreplace")


def as_parquet(table: Table) -> bytes:
    """For pandas, Polars, DuckDB and the like. Raises ConfigError where pyarrow is not installed."""
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise ConfigError(
            f"Parquet needs the package pyarrow; {install_command('parquet')}, or export csv"
        ) from error
    columns = {name: [_known(row.get(name)) for row in table.rows] for name in table.columns}
    sink = pyarrow.BufferOutputStream()
    parquet.write_table(pyarrow.table(columns), sink)
    data: bytes = sink.getvalue().to_pybytes()
    return data


def column_names(field: str, parts: int) -> Sequence[str]:
    """Names of the columns of an array with so many parts: by axes, and of joints by number."""
    joints = field.startswith("joints")
    return [f"{field}_{end}" for end in (_ENDS[parts] if parts in _ENDS and not joints else range(parts))]


def _cells(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Columns of a value, with their contents."""
    match value:
        case Struct():
            for field in structs.fields(value):
                yield from _cells(f"{name}.{field.name}" if name else field.name, getattr(value, field.name))
        case dict():
            for key, each in value.items():
                yield f"{name}.{key}", each
        case tuple() if len(value) in _ENDS and not isinstance(value[0], str):
            yield from zip(column_names(name, len(value)), value, strict=True)
        case tuple():
            yield name, "; ".join(map(str, value))
        case _:
            yield name, value


def _known(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _cell(value: Any) -> Any:
    known = _known(value)
    return "" if known is None else known
