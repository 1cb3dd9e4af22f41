"""Figures of one signal and of two: lag, rest, noise, share of slow variance, grid, times between samples. Pure.

All are over samples at ascending times, s. Values are in the unit of their quantity.
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
"""Chosen: parts of a recording whose lags tell the spread."""
LONGEST_LAG_S = 0.5
"""Chosen: lags are looked for up to this. Three times the longest that a recording has shown."""
LEAST_SAMPLES = 50
"""Chosen: samples below which nothing is compared."""
_LEAST_PART = 20
"""Chosen: samples that a part needs for a lag of its own."""
_FINE_S = 1e-5
"""Chosen: step to which a lag is worked out, far below any spread that was measured."""
_FEW = 300
"""Chosen: about so many samples stand for all while lags are tried."""
_COARSE = 81
"""Chosen: lags that are tried before the finest is looked for."""
_EXPLAINED = 0.2
"""Chosen: a lag is told where the rest is below this share of the motion."""
_STILL = 1e-9
"""Chosen: an input that moves by a smaller share of its value stands; that much is rounding."""
_AGREEING = 2
"""Chosen: parts that must tell a lag of their own. The spread needs as many."""
_INCOHERENT = 0.1
"""Chosen: 1 less the mean resultant length of the phases on a grid, below which values lie on it."""
_DIVISORS = (1, 2, 3, 4)
"""Chosen: the smallest differences may be so many steps of the grid, as while the value moves."""
_NEAR = 0.1
"""Chosen: a difference so near to two steps counts as two. Equal differences alone make no grid."""
_EQUAL = 0.01
"""Chosen: differences that differ by less than this share of them are one step."""
_GRID_STEPS = 12.0
"""Chosen: differences up to so many steps of a grid are looked at. Longer ones tell it less sharply."""
_FLOAT_STEPS = 8.0
"""Chosen: differences below so many steps of a 32-bit float are rounding."""


class Lag(NamedTuple):
    """How an output follows an input."""

    seconds: float
    """The output is later by this; NaN where the input moves too little, in all or in all parts but one."""
    spread: float
    """Standard deviation of the lags of the parts that tell one, s."""
    rest: Floats
    """Output less input, after the shift; NaN where the input does not reach."""


class Gaps(Struct, frozen=True):
    """Times between samples, s."""

    mean_s: float
    deviation_s: float
    percentile_99_s: float
    longest_s: float


def shift_of(times: Floats, source: Floats, output: Floats, free: int = 0) -> Lag:
    """The lag of `output` behind `source`, both (n,) at `times` (n,).

    `free` is 0 where both tell the same quantity, 1 where a constant between them has no meaning, and 2 where a drift
    has none either.
    """
    signals = _Signals(times - times[0], source, output, free)
    whole = slice(0, len(times))
    lag = signals.lag(whole)
    lags = [
        own
        for part in np.array_split(np.arange(len(times)), PARTS)
        if len(part) >= _LEAST_PART and (own := signals.lag(slice(part[0], part[-1] + 1))) is not None
    ]
    if lag is None or len(lags) < _AGREEING:
        return Lag(math.nan, math.nan, signals.rest(0.0, whole))
    return Lag(lag, float(np.std(lags, ddof=1)), signals.rest(lag, whole))


class _Signals(NamedTuple):
    """An input and an output."""

    times: Floats
    """s, from 0."""
    source: Floats
    output: Floats
    free: int
    """As of `shift_of`."""

    def lag(self, part: slice) -> float | None:
        """The lag in a part; None where the input moves too little to tell one."""
        source = self.source[part]
        moved = float(np.std(source))
        if moved <= _STILL * float(np.max(np.abs(source))):
            return None
        lag = self._best(part)
        return lag if rms(self.rest(lag, part)) <= _EXPLAINED * moved else None

    def _best(self, part: slice) -> float:
        """The lag with the least rest: first among some over a few samples, then next to the best over all."""
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
        """Output less the shifted input, less what is free."""
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
    """Root mean square of the values that are numbers; NaN without any."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else math.nan


def noise_of(values: Floats) -> float:
    """Standard deviation of successive differences, divided by √2: that of white noise, whatever moves slowly below."""
    steps = np.diff(values[np.isfinite(values)])
    return float(np.std(steps) / math.sqrt(2.0)) if len(steps) else math.nan


def smooth_noise_of(values: Floats) -> float:
    """The same from third differences, divided by √20: a motion that is smooth over four samples adds nothing."""
    steps = np.diff(values[np.isfinite(values)], 3)
    return float(np.std(steps) / math.sqrt(20.0)) if len(steps) else math.nan


def share_below(times: Floats, values: Floats, hertz: float) -> float:
    """Share of the variance at frequencies below `hertz`, after a straight line was taken off.

    NaN where half the rate of the samples is below, or nothing varies.
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
    whole = float(power.sum())
    return float(power[frequencies < hertz].sum()) / whole if whole > 0.0 else math.nan


def grid_of(values: Floats) -> float:
    """The step on which the values lie; NaN where there is none, or too few values differ.

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
    """The grid next to a guess, and 1 less the mean resultant length of the phases of the steps on it."""
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
    """Times between samples at `times`."""
    gaps = np.diff(times)
    return Gaps(float(gaps.mean()), float(gaps.std()), float(np.percentile(gaps, 99.0)), float(gaps.max()))


def integral_of(times: Floats, speeds: Floats) -> Floats:
    """The way that the speeds make from 0, by trapezia."""
    steps = 0.5 * (speeds[1:] + speeds[:-1]) * np.diff(times)
    return np.concatenate([[0.0], np.cumsum(steps)])
