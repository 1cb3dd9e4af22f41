"""Means and spreads of figures of merit over noise seeds."""

from collections.abc import Iterable, Sequence
from statistics import fmean, pstdev

from hil_bridge.control import FiguresOfMerit
from hil_bridge.lab.experiments.results import Row, rounded

FIGURES = {
    "rise_samples": "rise_samples",
    "overshoot_percent": "overshoot_percent",
    "steady_error_n": "steady_mean_error",
    "steady_peak_to_peak_n": "steady_peak_to_peak",
    "rms_error_n": "rms_error",
    "contact_losses": "contact_losses",
    "steps_per_second": "steps_per_second",
    "largest_force_n": "largest_force",
}
"""Columns of a table and the figures that they hold."""


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
    for column, name in FIGURES.items():
        mean, deviation = spread(None if merit is None else getattr(merit, name) for merit in merits)
        row[column], row[f"{column}_sd"] = rounded(mean), rounded(deviation)
    return row
