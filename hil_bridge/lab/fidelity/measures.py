"""Figures of one or two signals: lag, residual, noise, share of slow variance, quantisation step, and sample
intervals.

All functions are pure. They take samples at ascending times, s, with values in the unit of their quantity.
"""

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.signal import periodogram

Floats: TypeAlias = NDArray[np.float64]

PARTS = 5
"""Number of parts of a recording from whose lags the spread is estimated. Chosen."""
LONGEST_LAG_S = 0.5
"""Largest lag that is searched, s. Chosen: three times the longest lag of any recording so far."""
LEAST_SAMPLES = 50
"""Smallest number of samples for a comparison. Chosen."""
_LEAST_PART = 20
"""Smallest number of samples in a part that gets its own lag. Chosen."""
_FINE_S = 1e-5
"""Resolution of a lag, s. Chosen: far below any measured spread."""
_FEW = 300
"""Approximate number of samples in the coarse search for a lag. Chosen."""
_COARSE = 81
"""Number of lags that the coarse search tries. Chosen."""
_EXPLAINED = 0.2
"""Largest residual, as a share of the motion, with which a lag is accepted. Chosen."""
_STILL = 1e-9
"""Largest motion of a constant input, relative to its largest value. Chosen: a motion below this share is rounding."""
_AGREEING = 2
"""Smallest number of parts with their own lag. Chosen: the spread requires two."""
_INCOHERENT = 0.1
"""Largest incoherence at which values lie on a grid: 1 minus the mean resultant length of the phases on that grid.
Chosen.
"""
_DIVISORS = (1, 2, 3, 4)
"""Sizes that the smallest differences may have, in grid steps. Chosen: they are larger than 1 while the value moves."""
_NEAR = 0.1
"""Tolerance within which a difference counts as two steps, in grid steps. Chosen: a second size is required, since
equal differences alone prove no grid.
"""
_EQUAL = 0.01
"""Relative tolerance within which all differences count as one step. Chosen."""
_GRID_STEPS = 12.0
"""Largest difference that is used, in grid steps. Chosen: larger differences determine the grid less precisely."""
_FLOAT_STEPS = 8.0
"""Largest difference that counts as rounding, in steps of a 32-bit float. Chosen."""


class Lag(NamedTuple):
    """Lag of an output signal behind its input signal."""

    seconds: float
    """Delay of the output, s; NaN if the input moves too little in the complete recording, or in all parts but one."""
    spread: float
    """Standard deviation of the lags of the parts of a recording, s."""
    rest: Floats
    """Residual: output minus the shifted input. NaN outside the range of the input."""


class Gaps(Struct, frozen=True):
    """Statistics of the intervals between samples, s."""

    mean_s: float
    deviation_s: float
    percentile_99_s: float
    longest_s: float


def shift_of(times: Floats, source: Floats, output: Floats, free: int = 0) -> Lag:
    """Estimate the lag of `output` behind `source`, both (n,) at `times` (n,).

    `free` is the number of free parameters: 0 if both signals are the same quantity, 1 to ignore a constant offset
    between them, and 2 to ignore a linear drift as well.
    """
    signals = _Signals(times - times[0], source, output, free)
    everything = slice(0, len(times))
    lag = signals.lag(everything)
    lags = [
        own
        for part in np.array_split(np.arange(len(times)), PARTS)
        if len(part) >= _LEAST_PART and (own := signals.lag(slice(part[0], part[-1] + 1))) is not None
    ]
    if lag is None or len(lags) < _AGREEING:
        return Lag(math.nan, math.nan, signals.rest(0.0, everything))
    return Lag(lag, float(np.std(lags, ddof=1)), signals.rest(lag, everything))


class _Signals(NamedTuple):
    """Input and output signals with their times."""

    times: Floats
    """Times of the samples, beginning at 0, s."""
    source: Floats
    output: Floats
    free: int
    """Number of free parameters, as in `shift_of`."""

    def lag(self, part: slice) -> float | None:
        """Return the lag in a part, s; None if the input moves too little, or the residual is too large."""
        source = self.source[part]
        motion = float(np.std(source))
        if motion <= _STILL * float(np.max(np.abs(source))):
            return None
        lag = self._best(part)
        return lag if rms(self.rest(lag, part)) <= _EXPLAINED * motion else None

    def _best(self, part: slice) -> float:
        """Return the lag with the smallest residual, s: a coarse search over few samples, refined over all samples."""
        few = slice(part.start, part.stop, max(1, (part.stop - part.start) // _FEW))
        most = min(LONGEST_LAG_S, 0.25 * float(self.times[-1]))
        tried = np.linspace(-most, most, _COARSE)
        nearest = int(np.argmin([rms(self.rest(float(lag), few)) for lag in tried]))
        bounds = tried[max(nearest - 1, 0)], tried[min(nearest + 1, _COARSE - 1)]
        least_rest = minimize_scalar(
            lambda lag: rms(self.rest(lag, part)), bounds=bounds, method="bounded", options={"xatol": _FINE_S}
        )
        return float(least_rest.x)

    def rest(self, lag: float, part: slice) -> Floats:
        """Return the residual: output minus the shifted input, without the free offset and drift."""
        at = self.times[part]
        shifted = np.interp(at - lag, self.times, self.source, left=math.nan, right=math.nan)
        rest: Floats = self.output[part] - shifted
        known = np.isfinite(rest)
        if not self.free or known.sum() <= self.free:
            return rest
        rest = rest - rest[known].mean()
        if self.free > 1:
            about = at - at[known].mean()
            rest = rest - about * (about[known] @ rest[known]) / (about[known] @ about[known])
        return rest


def rms(values: Floats) -> float:
    """Return the root mean square of the finite values; NaN if there are none."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else math.nan


def noise_of(values: Floats) -> float:
    """Return the standard deviation of white noise on a slow signal, from first differences divided by √2."""
    steps = np.diff(values[np.isfinite(values)])
    return float(np.std(steps) / math.sqrt(2.0)) if len(steps) else math.nan


def smooth_noise_of(values: Floats) -> float:
    """Return the standard deviation of white noise on a smooth motion, from third differences divided by √20.

    Motion that is smooth over four samples does not affect the result.
    """
    steps = np.diff(values[np.isfinite(values)], 3)
    return float(np.std(steps) / math.sqrt(20.0)) if len(steps) else math.nan


def share_below(times: Floats, values: Floats, hertz: float) -> float:
    """Return the share of the variance below `hertz`, after removal of a linear trend.

    NaN if `hertz` is above half the sample rate, if there are too few samples, or if nothing varies.
    """
    known = np.isfinite(values)
    times, values = times[known], values[known]
    if len(values) < LEAST_SAMPLES:
        return math.nan
    rate = (len(times) - 1) / float(times[-1] - times[0])
    if rate < 2.0 * hertz:
        return math.nan
    even = np.linspace(times[0], times[-1], len(times))
    frequencies, power = periodogram(np.interp(even, times, values), rate, detrend="linear")
    total = float(power.sum())
    return float(power[frequencies < hertz].sum()) / total if total > 0.0 else math.nan


def grid_of(values: Floats) -> float:
    """Return the quantisation step of the values; NaN if there is none, or too few values differ.

    The differences of successive values are multiples of the step, even if the values have an offset.
    """
    values = values[np.isfinite(values)]
    if len(values) < LEAST_SAMPLES:
        return math.nan
    rounding = _FLOAT_STEPS * float(np.finfo(np.float32).eps) * float(np.max(np.abs(values)))
    steps = np.sort(np.abs(np.diff(values)))
    repeated = bool((steps <= rounding).any())
    steps = steps[steps > rounding]
    if len(steps) < LEAST_SAMPLES // 2:
        return math.nan
    least = float(np.median(steps[: max(3, len(steps) // 20)]))
    for divisor in _DIVISORS:
        size, incoherence = _grid_near(steps, least / divisor)
        several = repeated or float(np.min(np.abs(steps / size - 2.0))) < _NEAR
        if incoherence < _INCOHERENT and several:
            return size
    return math.nan


def _grid_near(steps: Floats, guess: float) -> tuple[float, float]:
    """Return the grid closest to a guess, and its incoherence: 1 minus the mean resultant length of the phases of
    the steps.
    """
    near = steps[steps < _GRID_STEPS * guess]
    if len(near) < LEAST_SAMPLES // 2:
        return guess, 1.0
    if np.ptp(near) < _EQUAL * guess:  # equal differences fit every grid
        return float(np.median(near)), 0.0

    def incoherence(size: float) -> float:
        return 1.0 - float(abs(np.mean(np.exp(2j * math.pi * near / size))))

    tried = np.linspace(0.85 * guess, 1.15 * guess, _COARSE)
    best = float(min(tried, key=lambda size: incoherence(float(size))))
    width = float(tried[1] - tried[0])
    finest = minimize_scalar(
        incoherence, bounds=(best - width, best + width), method="bounded", options={"xatol": 1e-6 * guess}
    )
    size = float(finest.x)
    return size, incoherence(size)


def gaps_of(times: Floats) -> Gaps:
    """Return statistics of the intervals between `times`."""
    gaps = np.diff(times)
    return Gaps(float(gaps.mean()), float(gaps.std()), float(np.percentile(gaps, 99.0)), float(gaps.max()))


def integral_of(times: Floats, speeds: Floats) -> Floats:
    """Integrate speeds by the trapezoidal rule, beginning at 0."""
    steps = 0.5 * (speeds[1:] + speeds[:-1]) * np.diff(times)
    return np.concatenate([[0.0], np.cumsum(steps)])
