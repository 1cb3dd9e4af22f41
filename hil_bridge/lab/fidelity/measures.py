"""Figures of one or two signals: lag, residual, noise, share of slow variance, grid, sample intervals.

Pure functions of samples at ascending times, s. Values are in the unit of their quantity.
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
"""Chosen: number of parts of a recording from whose lags the spread is estimated."""
LONGEST_LAG_S = 0.5
"""Chosen: largest lag searched, three times the longest of any recording so far."""
LEAST_SAMPLES = 50
"""Chosen: smallest number of samples for a comparison."""
_LEAST_PART = 20
"""Chosen: smallest number of samples of a part for its own lag."""
_FINE_S = 1e-5
"""Chosen: resolution of a lag, far below any measured spread."""
_FEW = 300
"""Chosen: approximate number of samples in the coarse search for a lag."""
_COARSE = 81
"""Chosen: number of lags in the coarse search."""
_EXPLAINED = 0.2
"""Chosen: largest residual, as a share of the motion, with which a lag is accepted."""
_STILL = 1e-9
"""Chosen: relative motion below which an input is constant; that much is rounding."""
_AGREEING = 2
"""Chosen: smallest number of parts with their own lag, as the spread requires."""
_INCOHERENT = 0.1
"""Chosen: 1 minus the mean resultant length of the phases on a grid, below which values lie on it."""
_DIVISORS = (1, 2, 3, 4)
"""Chosen: possible sizes of the smallest differences in grid steps, larger than 1 while the value moves."""
_NEAR = 0.1
"""Chosen: tolerance within which a difference counts as two steps. Equal differences alone prove no grid."""
_EQUAL = 0.01
"""Chosen: relative tolerance within which differences are one step."""
_GRID_STEPS = 12.0
"""Chosen: largest difference used, in grid steps. Larger ones determine the grid less precisely."""
_FLOAT_STEPS = 8.0
"""Chosen: differences below this many steps of a 32-bit float are rounding."""


class Lag(NamedTuple):
    """Lag of an output behind its input."""

    seconds: float
    """Delay of the output, s; NaN if the input moves too little, overall or in all parts but one."""
    spread: float
    """Standard deviation of the lags of the parts, s."""
    rest: Floats
    """Residual: output minus shifted input; NaN outside the range of the input."""


class Gaps(Struct, frozen=True):
    """Statistics of the intervals between samples, s."""

    mean_s: float
    deviation_s: float
    percentile_99_s: float
    longest_s: float


def shift_of(times: Floats, source: Floats, output: Floats, free: int = 0) -> Lag:
    """Estimate the lag of `output` behind `source`, both (n,) at `times` (n,).

    `free` is 0 if both are the same quantity, 1 to ignore a constant offset between them, and 2 to ignore a linear
    drift too.
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
    """Input and output signals."""

    times: Floats
    """Times from 0, s."""
    source: Floats
    output: Floats
    free: int
    """As in `shift_of`."""

    def lag(self, part: slice) -> float | None:
        """Return the lag in a part; None if the input moves too little."""
        source = self.source[part]
        moved = float(np.std(source))
        if moved <= _STILL * float(np.max(np.abs(source))):
            return None
        lag = self._best(part)
        return lag if rms(self.rest(lag, part)) <= _EXPLAINED * moved else None

    def _best(self, part: slice) -> float:
        """Return the lag with the smallest residual: a coarse search over few samples, refined over all."""
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
    """Return the root mean square of the finite values; NaN without any."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else math.nan


def noise_of(values: Floats) -> float:
    """Return the standard deviation of white noise on a slow signal, from first differences divided by √2."""
    steps = np.diff(values[np.isfinite(values)])
    return float(np.std(steps) / math.sqrt(2.0)) if len(steps) else math.nan


def smooth_noise_of(values: Floats) -> float:
    """Return the same from third differences divided by √20, unaffected by motion smooth over four samples."""
    steps = np.diff(values[np.isfinite(values)], 3)
    return float(np.std(steps) / math.sqrt(20.0)) if len(steps) else math.nan


def share_below(times: Floats, values: Floats, hertz: float) -> float:
    """Return the share of the variance below `hertz`, after removal of a linear trend.

    NaN if half the sample rate is lower than that, or nothing varies.
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

    The differences of successive values are multiples of it, whatever the offset.
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
    """Return the grid closest to a guess, and 1 minus the mean resultant length of the phases of the steps on it."""
    near = steps[steps < _GRID_STEPS * guess]
    if len(near) < LEAST_SAMPLES // 2:
        return guess, 1.0
    if np.ptp(near) < _EQUAL * guess:  # they fit every grid
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
    """Integrate speeds from 0 by the trapezoidal rule."""
    steps = 0.5 * (speeds[1:] + speeds[:-1]) * np.diff(times)
    return np.concatenate([[0.0], np.cumsum(steps)])
