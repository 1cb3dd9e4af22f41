"""Means and spreads of figures of merit over noise seeds."""

from collections.abc import Iterable, Sequence
from dataclasses import fields
from statistics import fmean, pstdev

from hil_bridge.control import FiguresOfMerit
from hil_bridge.lab.experiments.results import Row, round_digits

COLUMNS = tuple(field.name for field in fields(FiguresOfMerit) if field.name != "rise_s")
"""Figures that a table holds; the paper counts the rise in samples."""


def spread(values: Iterable[float | None]) -> tuple[float | None, float | None]:
    """Mean and standard deviation; none when a value is missing, for a mean of the others would flatter."""
    known = list(values)
    if not known or any(value is None for value in known):
        return None, None
    numbers = [float(value) for value in known if value is not None]
    return fmean(numbers), pstdev(numbers)


def figures(merits: Sequence[FiguresOfMerit | None]) -> Row:
    """Mean of every figure over the seeds, and its standard deviation as `…_sd`."""
    row: Row = {"seeds": len(merits)}
    for column in COLUMNS:
        mean, deviation = spread(None if merit is None else getattr(merit, column) for merit in merits)
        row[column], row[f"{column}_sd"] = round_digits(mean), round_digits(deviation)
    return row
