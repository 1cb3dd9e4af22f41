"""Response of a controlled force to a touch, a step, a ramp or a sine of the target, and a moved surface.

All functions take arrays of a run. `record.analysis.response` takes the arrays from a recording.
"""

import math
from collections.abc import Iterator, Mapping
from itertools import groupby, pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BAND_SHARE = 0.1
"""Band of the settled force, as a share of the target or of the step. Chosen: as for a step of a program."""
BAND_LEAST_N = 1.0
"""Smallest band of the settled force after a touch, N. Chosen: below it, the noise of a sensor would decide."""
WIDE_BAND_N = 10.0
"""Fixed band of the settled force, N. Derived: reproduces the settling times of Gadringer et al. 2022."""
HELD_S = 2.0
"""Shortest time for which a target must be constant before and after a step, s. Chosen."""
FOLLOWED_SHARE = 0.5
"""Share of a step that the mean force must follow for the step to show. Chosen."""
REPEATS_LEAST = 3
"""Smallest number of equal steps from which to judge whether they show. Chosen."""
RAMP_S = 1.0
"""Shortest ramp, s. Chosen."""
RAMP_BEND = 0.02
"""Largest distance of a ramp from a straight line, as a share of its height. Chosen."""
RAMP_BEGIN = 0.3
"""Share of a ramp at its beginning that is left out, in which the lag builds up. Chosen."""
PERIOD_SAMPLES = 8
"""Smallest number of samples in a period of a sine. Chosen."""
SINE_BEND = 0.1
"""Largest distance of a sine of the target from its fit (RMS), and of its periods from their mean, as shares.
Chosen: admits a sine of 16 straight pieces.
"""


class ForceSignal(NamedTuple):
    """Force and its target over time, N and s, (n,); the times ascend."""

    at: Array
    force: Array
    target: Array

    @property
    def error(self) -> Array:
        """Force minus target, N."""
        return self.force - self.target

    @property
    def span_s(self) -> float:
        """Time from the first sample to the last, s; 0 without samples."""
        return float(self.at[-1] - self.at[0]) if self.at.size else 0.0

    def between(self, begin: float, end: float) -> "ForceSignal":
        """Return the samples from `begin` to `end`, both included."""
        chosen = slice(*np.searchsorted(self.at, [begin, np.nextafter(end, math.inf)]))
        return ForceSignal(self.at[chosen], self.force[chosen], self.target[chosen])


class TargetStep(NamedTuple):
    """Step of the target between two intervals in which it is constant."""

    before: ForceSignal
    after: ForceSignal

    @property
    def size(self) -> float:
        """Height of the step, N, negative for a step down."""
        return float(self.after.target[0] - self.before.target[0])

    @property
    def response(self) -> float:
        """Change of the mean force in the second halves of the intervals, in the direction of the step, N."""
        change = _late_mean(self.after) - _late_mean(self.before)
        return math.copysign(1.0, self.size) * change


def settling_s(signal: ForceSignal, band_n: float) -> float:
    """Return the time from the first sample until the force stays within the band; infinity if it does not."""
    (outside,) = np.nonzero(np.abs(signal.error) > band_n)
    if not outside.size:
        return 0.0
    after = int(outside[-1]) + 1
    return float(signal.at[after] - signal.at[0]) if after < signal.at.size else math.inf


def touch_figures(signal: ForceSignal) -> Mapping[str, float | None]:
    """Return the figures of a touch, from the samples that begin with it."""
    size, target = np.abs(signal.error), float(signal.target[0])
    return {
        "touch_peak_n": float(signal.force.max()),
        "touch_error_max_n": float(size.max()),
        "touch_error_mean_n": float(size.mean()),
        "touch_error_deviation_n": float(size.std()),
        "touch_impulse_ns": _integral(signal.at, np.maximum(signal.error, 0.0)),
        "settle_s": settling_s(signal, max(BAND_LEAST_N, BAND_SHARE * target)),
        "settle_10n_s": settling_s(signal, WIDE_BAND_N) if target > WIDE_BAND_N else None,
    }


def _integral(at: Array, values: Array) -> float:
    return float((values[1:] + values[:-1]) @ np.diff(at)) / 2


def error_figures(signal: ForceSignal) -> Mapping[str, float | None]:
    """Return the figures of the error while tracking."""
    size = np.abs(signal.error)
    return {
        "track_error_max_n": float(size.max()),
        "track_error_mean_n": float(size.mean()),
        "track_error_deviation_n": float(size.std()),
    }


def target_steps(signal: ForceSignal) -> Iterator[TargetStep]:
    """Yield the steps between intervals in which the target is constant for at least HELD_S."""
    bounds = [0, *(np.flatnonzero(np.diff(signal.target)) + 1).tolist(), signal.at.size]
    parts = (ForceSignal(*(array[begin:end] for array in signal)) for begin, end in pairwise(bounds))
    for before, after in pairwise(parts):
        if min(before.span_s, after.span_s) >= HELD_S:
            yield TargetStep(before, after)


def step_figures(steps: list[TargetStep]) -> Mapping[str, float | None]:
    """Return the figures of steps of the target: the worst of those that are at least half the largest step."""
    largest = max((abs(step.size) for step in steps), default=0.0)
    rows = [_step_row(step) for step in steps if abs(step.size) >= largest / 2]
    worst = {key: max(row[key] for row in rows) for key in rows[0]} if rows else {}
    return {**worst, "smallest_step_n": _smallest_step_n(steps)}


def _step_row(step: TargetStep) -> dict[str, float]:
    sign, size, after = math.copysign(1.0, step.size), abs(step.size), step.after
    moved = sign * (after.force - _late_mean(step.before))
    first, high = (np.flatnonzero(moved >= share * size) for share in (BAND_SHARE, 1.0 - BAND_SHARE))
    return {
        "step_rise_s": float(after.at[high[0]] - after.at[first[0]]) if high.size else math.inf,
        "step_overshoot_percent": 100.0 * max(0.0, float((sign * after.error).max())) / size,
        "step_settle_s": settling_s(after, BAND_SHARE * size),
        "step_error_n": abs(_late_mean(after) - float(after.target[0])),
    }


def _late_mean(signal: ForceSignal) -> float:
    """Return the mean force of the second half of an interval."""
    half = (signal.at[0] + signal.at[-1]) / 2
    return float(signal.force[signal.at >= half].mean())


def _smallest_step_n(steps: list[TargetStep]) -> float | None:
    """Return the smallest step that shows, such that all larger ones show too.

    Equal steps show if the mean of their responses is at least FOLLOWED_SHARE of the step, and at least three standard
    errors of that mean above 0. Infinity if the largest step does not show; None without repeated steps.
    """
    sizes = sorted(steps, key=lambda step: abs(step.size), reverse=True)
    groups = [
        (size, [step.response for step in equal])
        for size, equal in groupby(sizes, key=lambda step: round(abs(step.size), 6))
    ]
    smallest = math.inf
    repeated = [(size, values) for size, values in groups if len(values) >= REPEATS_LEAST]
    for size, values in repeated:
        mean, error = np.mean(values), np.std(values, ddof=1) / math.sqrt(len(values))
        if not (mean >= FOLLOWED_SHARE * size and mean >= 3.0 * error):
            break
        smallest = size
    return smallest if repeated else None


def ramp_lags_s(signal: ForceSignal) -> Iterator[float]:
    """Yield the time by which the force lags each ramp of the target, s: the mean error divided by the rate."""
    rising = np.sign(np.diff(signal.target))
    bounds = [0, *(np.flatnonzero(np.diff(rising)) + 1).tolist(), rising.size]
    for begin, end in pairwise(bounds):
        ramp = ForceSignal(*(array[begin : end + 1] for array in signal))
        height = float(ramp.target[-1] - ramp.target[0])
        if height == 0.0 or ramp.span_s < RAMP_S:
            continue
        rate = height / ramp.span_s
        bend = np.abs(ramp.target - ramp.target[0] - rate * (ramp.at - ramp.at[0])).max()
        if bend <= RAMP_BEND * abs(height):
            late = ramp.between(float(ramp.at[0]) + RAMP_BEGIN * ramp.span_s, float(ramp.at[-1]))
            yield -float(late.error.mean()) / rate


def sine_response(signal: ForceSignal) -> complex | None:
    """Return the response to a sine of the target as a complex ratio: amplitude ratio and phase.

    The frequency is that of the target. The first period is left out. None if the target is not a sine of at least
    three periods, or if a period has fewer than PERIOD_SAMPLES samples.
    """
    at, target = signal.at, signal.target
    if at.size < 3 * PERIOD_SAMPLES:
        return None
    middle = (target.max() + target.min()) / 2
    (below,) = np.nonzero((target[:-1] < middle) & (target[1:] >= middle))
    share = (middle - target[below]) / (target[below + 1] - target[below])
    crossings = at[below] + share * (at[below + 1] - at[below])
    if crossings.size < 4:
        return None
    period = float(crossings[-1] - crossings[0]) / (crossings.size - 1)
    late = signal.between(float(crossings[1]), float(crossings[-1]))
    uneven = np.abs(np.diff(crossings) - period).max() > SINE_BEND * period
    if uneven or late.at.size < PERIOD_SAMPLES * (crossings.size - 2):
        return None
    goal, rest = _fit_sine(late.at, late.target, period)
    if abs(goal) == 0.0 or rest > SINE_BEND * abs(goal):
        return None
    return _fit_sine(late.at, late.force, period)[0] / goal


def phase_deg(ratio: complex) -> float:
    """Return the phase of a response in (−270, 90] degrees, negative for a delay."""
    phase = math.degrees(math.atan2(ratio.imag, ratio.real))
    return phase - 360.0 if phase > 90.0 else phase


def amplitude_n(signal: ForceSignal, period_s: float) -> float:
    """Return the amplitude of the force at a period, N."""
    return abs(_fit_sine(signal.at, signal.force, period_s)[0])


def _fit_sine(at: Array, values: Array, period_s: float) -> tuple[complex, float]:
    """Return the complex amplitude of the least-squares sine of a period, and the RMS of the rest."""
    angle = 2.0 * np.pi * (at - at[0]) / period_s
    basis = np.column_stack((np.ones(at.size), np.cos(angle), np.sin(angle)))
    weights = np.linalg.lstsq(basis, values, rcond=None)[0]
    return complex(weights[1], -weights[2]), float(np.sqrt(np.mean((values - basis @ weights) ** 2)))


def slope_per_min(at: Array, values: Array) -> float:
    """Return the slope of the least-squares line, per minute."""
    centred = at - at.mean()
    return 60.0 * float(centred @ values / (centred @ centred))
