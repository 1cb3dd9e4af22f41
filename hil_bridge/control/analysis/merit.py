"""Figures of merit of a tracked force, from the arrays of a run's TRACK phase."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hil_bridge.control.types import POSITION_STEP_MM

Array = NDArray[np.float64]

STEADY_SAMPLES = 40
"""Number of samples at the end of a run that count as its steady state."""

RISE_FRACTION = 0.9
"""Share of the desired force at which the rise ends, when the force first reaches it."""


@dataclass(frozen=True, slots=True)
class FiguresOfMerit:
    """Figures of merit of a tracked force. A figure is None if the run was too short or never reached the desired
    force.
    """

    rise_samples: int | None
    """Rise time from the first sample to 90 % of the desired force, in samples."""
    rise_s: float | None
    """Rise time from the first sample to 90 % of the desired force, s."""
    overshoot_percent: float
    """Overshoot: largest excess of the force over the desired force, percent of the desired force; 0 if there is
    none. After a sudden drop of the desired force by more than a tenth, the force counts again once it is within a
    tenth of the new value.
    """
    steady_mean_error_n: float | None
    """Mean of force − desired force over the last 40 samples, N; None if the rise ended fewer than 40 samples ago."""
    steady_peak_to_peak_n: float | None
    """Peak-to-peak value of force − desired force over the last 40 samples, N."""
    rms_error_n: float
    """Root mean square of force − desired force over all samples, including the rise, N."""
    contact_losses: int
    """Number of transitions from contact to no contact."""
    steps_per_s: float | None
    """Resolution steps per second that the command moved over the last 40 samples: a measure of wear."""
    largest_force_n: float
    """Largest force in the run, N."""


class ForceTrace(NamedTuple):
    """Recorded force control run, with one value per sample in order of time."""

    time: ArrayLike
    """Times of the samples, s."""
    force: ArrayLike
    """Force in each sample, N."""
    reference: ArrayLike
    """Desired force, N: one value for all samples, or one value per sample."""
    commanded: ArrayLike
    """Commanded depth in each sample, m."""
    in_contact: ArrayLike
    """Booleans that state whether the tool is in contact."""


def figures_of_merit(trace: ForceTrace, resolution_mm: float = POSITION_STEP_MM) -> FiguresOfMerit:
    """Return the figures of merit of a run. Raises ValueError if there are no samples, or if the arrays differ in
    length.
    """
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
    above = np.where(_mask_falling(pressed, desired), 0.0, 100.0 * error / desired)
    steady = pressed.size - (rise or 0) >= STEADY_SAMPLES  # otherwise the rise would count as fluctuation
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


def _mask_falling(pressed: Array, desired: Array) -> NDArray[np.bool_]:
    """Return a mask of the samples in which the force is still falling after a drop of the desired force."""
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
    steps = np.rint(depth / (resolution_mm * 1e-3))
    return float(np.sum(np.abs(np.diff(steps)))) / span
