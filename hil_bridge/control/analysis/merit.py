"""Figures of merit of a tracked force, from the arrays of a run's TRACK phase."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hil_bridge.control.types import POSITION_STEP_MM

Array = NDArray[np.float64]

STEADY_SAMPLES = 40
"""The last samples of a run, which count as its steady state."""

RISE_FRACTION = 0.9
"""Share of the desired force whose first reaching ends the rise."""


@dataclass(frozen=True, slots=True)
class FiguresOfMerit:
    """Figures of a tracked force; None where the run was too short or never reached the force."""

    rise_samples: int | None
    """Samples from the first one to 90 % of the desired force."""
    rise_s: float | None
    """The same in s."""
    overshoot_percent: float
    """Largest force above the desired one, percent of it; 0 when it was never above. Where the desired force drops by
    more than a tenth at once, the force counts again when it has come down to within a tenth of it.
    """
    steady_mean_error_n: float | None
    """Mean of force − desired force over the last 40 samples, N; None for fewer since the rise."""
    steady_peak_to_peak_n: float | None
    """Largest less smallest force − desired force over the last 40 samples, N."""
    rms_error_n: float
    """Root of the mean square of force − desired force over all samples, the rise included, N."""
    contact_losses: int
    """Times that contact was there and then was not."""
    steps_per_s: float | None
    """Resolution steps that the command moved over the last 40 samples, per s: wear."""
    largest_force_n: float
    """N"""


class ForceTrace(NamedTuple):
    """A run under control, one value a sample, in order of time."""

    time: ArrayLike
    """s"""
    force: ArrayLike
    """N"""
    reference: ArrayLike
    """Desired force, N: one value, or one a sample."""
    commanded: ArrayLike
    """Depth, m."""
    in_contact: ArrayLike
    """Booleans."""


def figures_of_merit(trace: ForceTrace, resolution_mm: float = POSITION_STEP_MM) -> FiguresOfMerit:
    """Figures of a run. Raises ValueError when there is no sample, or when the arrays differ in length."""
    at, pressed, depth = (
        np.asarray(values, dtype=float) for values in (trace.time, trace.force, trace.commanded)
    )
    touching = np.asarray(trace.in_contact, dtype=bool)
    if not pressed.size or not pressed.shape == at.shape == depth.shape == touching.shape:
        raise ValueError("a run needs a time, force, command and contact flag a sample, at least one sample")
    desired = np.broadcast_to(np.asarray(trace.reference, dtype=float), pressed.shape)
    error = pressed - desired
    risen = np.flatnonzero(pressed >= RISE_FRACTION * desired)
    rise = int(risen[0]) if risen.size else None
    above = np.where(_falling(pressed, desired), 0.0, 100.0 * error / desired)
    steady = pressed.size - (rise or 0) >= STEADY_SAMPLES  # else the rise itself would count as unsteadiness
    tail = slice(-STEADY_SAMPLES, None)
    return FiguresOfMerit(
        rise_samples=rise,
        rise_s=None if rise is None else float(at[rise] - at[0]),
        overshoot_percent=float(max(0.0, np.max(above))),
        steady_mean_error_n=float(np.mean(error[tail])) if steady else None,
        steady_peak_to_peak_n=float(np.ptp(error[tail])) if steady else None,
        rms_error_n=float(np.sqrt(np.mean(error**2))),
        contact_losses=int(np.count_nonzero(touching[:-1] & ~touching[1:])),
        steps_per_s=_steps_per_second(at[tail], depth[tail], resolution_mm) if steady else None,
        largest_force_n=float(np.max(pressed)),
    )


def _falling(pressed: Array, desired: Array) -> NDArray[np.bool_]:
    """ForceTrace in which the force still comes down to a desired one that has dropped."""
    falling = np.zeros(pressed.shape, dtype=bool)
    drops = np.flatnonzero(desired[1:] < RISE_FRACTION * desired[:-1]) + 1
    for begin in drops:
        there = np.flatnonzero(pressed[begin:] <= (2.0 - RISE_FRACTION) * desired[begin:])
        falling[begin : begin + int(there[0]) if there.size else None] = True
    return falling


def _steps_per_second(at: Array, depth: Array, resolution_mm: float) -> float | None:
    span = float(at[-1] - at[0])
    if span <= 0:
        return None
    words = np.rint(depth / (resolution_mm * 1e-3))
    return float(np.sum(np.abs(np.diff(words)))) / span
