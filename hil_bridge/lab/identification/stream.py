"""Sensor parameters identified from a recording: noise of each axis, filter cut-off, resolution, zero drift, and
frame times.
"""

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from hil_bridge.lab.fidelity.measures import Floats, grid_of
from hil_bridge.lab.identification.blocks import (
    LEAST_BLOCKS,
    Estimate,
    Ints,
    Mask,
    jackknife,
)
from hil_bridge.lab.identification.gaps import gap_values, step_value, usual_gaps
from hil_bridge.lab.identification.observations import Observations, Stream
from hil_bridge.lab.identification.values import Part, Quantity, Value, Why
from protocol.wrench import AXES

_SEGMENTS = 12
"""Number of segments with a stationary tool whose spectra are averaged, if there are enough frames. Chosen."""
_SHORTEST, _LONGEST = 16, 128
"""Smallest and largest number of frames in a segment. Chosen."""
_SLOW_HZ = 20.0
"""Frequency below which noise is not attributed to the sensor, Hz. Chosen: recorded arms vibrate at 9 to 16 Hz."""
_LEAKING = 3
"""Number of the lowest spectral lines into which a slow change leaks through Hann's window. Derived."""
_PEAK = 4.0
"""Height above the noise at which a spectral line is attributed to the arm and left out, in standard errors. Chosen."""
_DISTURBED = 5.0
"""Power above which a segment counts as disturbed, as a multiple of the usual power. Chosen."""
_SEEN_STEPS = 0.55
"""Deviation below which noise cannot be separated from rounding, in steps. Derived: noise of half a step, together
with the rounding.
"""
_MEMORY_LEAST = 0.05
"""Correlation between frames below which the frames count as uncorrelated. Chosen."""
_FREE_LEAST_S = 1.0
"""Shortest interval of free space at each end from which a drift is identified, s. Chosen."""
_MEAN_S = 0.5
"""Averaging window for the drift, s. Chosen: removes the vibrations of an arm."""
_CREEP_SHARE = 0.01
"""Share of the force that a sensor may retain after the tool is lifted. Chosen. Recorded: up to 1 %."""

UNITS = ("N",) * 3 + ("N·m",) * 3
NOISE = tuple(
    Quantity(f"sensor.noise.{axis}", Part.SENSOR, f"noise of {axis}", unit)
    for axis, unit in zip(AXES, UNITS, strict=True)
)
STEP = tuple(
    Quantity(f"sensor.step.{axis}", Part.SENSOR, f"step of {axis}", unit)
    for axis, unit in zip(AXES, UNITS, strict=True)
)
DRIFT = tuple(
    Quantity(f"sensor.drift.{axis}", Part.SENSOR, f"drift of the zero of {axis}", "N/min")
    for axis in AXES[:3]
)
CUTOFF = Quantity("sensor.cutoff", Part.SENSOR, "cut-off of the filter", "Hz")
PERIOD = Quantity("sensor.period", Part.SENSOR, "time between frames", "s")
JITTER = Quantity("sensor.jitter", Part.SENSOR, "deviation of the frame interval", "s")
ALL = (*NOISE, CUTOFF, *STEP, *DRIFT, PERIOD, JITTER)


def stream_values(observations: Observations) -> Iterator[Value]:
    """Yield all values identified for the sensor."""
    stream = observations.stream
    if stream is None:
        yield from (quantity.unseen(Why.NO_FORCE) for quantity in ALL)
        return
    yield from _noise(stream)
    for quantity, size in zip(STEP, _step_sizes(stream).tolist(), strict=True):
        yield step_value(quantity, size)
    yield from _drift(stream, observations)
    method = "mean time between frames, without lost ones"
    yield from gap_values(np.diff(stream.times), 2 * LEAST_BLOCKS, (PERIOD, JITTER), method)


# --- noise and filter


class _Spectra(NamedTuple):
    """Periodograms of the frames with a stationary tool."""

    power: Floats
    """Power (segments, lines, axes), scaled so that each line of white noise has the variance of the noise."""
    angles: Floats
    """Angular frequency of each line (lines,), rad per frame: 2π times the frequency divided by the frame rate."""
    rounding: Floats
    """Variance due to the rounding to a quantisation step (axes,)."""
    rate: float

    def shape(self, memory: float) -> Floats:
        """Return the spectrum (lines,) of noise with variance 1 after a first-order filter.

        `memory` is the correlation between successive frames that the filter causes.
        """
        lines: Floats = (1.0 - memory**2) / (1.0 - 2.0 * memory * np.cos(self.angles) + memory**2)
        return lines

    def variances(self, memory: float, segments: Mask, lines: Mask) -> Floats:
        """Return the variance (axes,) of the noise from these segments and lines, without the rounding."""
        shape, power = self.shape(memory)[lines], self.power[segments][:, lines].mean(axis=0)
        ratios = (power / shape[:, None]).mean(axis=0)
        for _ in range(3):  # weighted by the spectrum itself, including the rounding
            weight = (shape[:, None] / (ratios * shape[:, None] + self.rounding)) ** 2
            ratios = (weight * (power - self.rounding) / shape[:, None]).sum(axis=0) / weight.sum(axis=0)
            ratios = np.maximum(ratios, 1e-3 * self.rounding + 1e-30)
        variances: Floats = ratios
        return variances

    def unlikelihood(self, memory: float, segments: Mask, lines: Mask) -> float:
        """Return the negative log likelihood (Whittle) of this correlation between frames; lower is better."""
        model = np.outer(self.shape(memory)[lines], self.variances(memory, segments, lines)) + self.rounding
        power = self.power[segments][:, lines].mean(axis=0)
        return float((np.log(model) + power / model).sum())

    def memory(self, segments: Mask, lines: Mask) -> float:
        """Return the most likely correlation between successive frames."""
        best = minimize_scalar(
            lambda memory: self.unlikelihood(float(memory), segments, lines),
            bounds=(-0.5, 0.995),
            method="bounded",
        )
        return float(best.x)

    def calm_lines(self, segments: Mask) -> Mask:
        """Return the lines that do not exceed the noise in any axis, because peaks are vibrations."""
        lines = np.ones(len(self.angles), bool)
        error = 1.0 / math.sqrt(int(segments.sum()))
        for _ in range(4):
            memory = self.memory(segments, lines)
            model = np.outer(self.shape(memory), self.variances(memory, segments, lines)) + self.rounding
            excess = (self.power[segments].mean(axis=0) / model).max(axis=1)
            calm = excess < 1.0 + _PEAK * error
            if calm.sum() < len(lines) // 2 or (calm == lines).all():
                break
            lines = calm
        return lines


def _noise(stream: Stream) -> Iterator[Value]:
    spectra, axes = _spectra_of(stream), range(len(AXES))
    if spectra is None:
        yield from (quantity.unseen(Why.NO_FRAMES) for quantity in (*NOISE, CUTOFF))
        return
    total = np.sqrt(spectra.power.mean(axis=(0, 1)))
    steps = np.sqrt(12.0 * spectra.rounding)
    noisy = [k for k in axes if total[k] > _SEEN_STEPS * steps[k] and total[k] > 0.0]
    places = {axis: place for place, axis in enumerate(noisy)}
    if not noisy:
        yield from (NOISE[k].unseen(Why.BELOW_STEP if total[k] >= 0.0 else Why.NO_FORCE) for k in axes)
        yield CUTOFF.unseen(Why.NO_NOISE)
        return
    spectra = spectra._replace(power=spectra.power[:, :, noisy], rounding=spectra.rounding[noisy])
    numbers = np.arange(len(spectra.power))
    everything = np.ones(len(numbers), bool)
    lines = spectra.calm_lines(everything)

    def memory_of(mask: Mask) -> float:
        return spectra.memory(mask, lines)

    memory = jackknife(numbers, memory_of)
    white = memory.low < _MEMORY_LEAST
    if not white and _hertz(memory.low, spectra.rate) < _SLOW_HZ:
        yield from (NOISE[k].unseen(Why.SLOW_FILTER if k in places else Why.BELOW_STEP) for k in axes)
        yield CUTOFF.unseen(Why.SLOW_FILTER)
        return
    method = "level of the spectrum above 20 Hz while the tool is stationary in free space, without peaks and rounding"
    for axis in axes:
        if axis not in places:
            yield NOISE[axis].unseen(Why.BELOW_STEP)
            continue
        place = places[axis]

        def deviation(mask: Mask, place: int = place) -> float:
            used = 0.0 if white else memory_of(mask)
            return math.sqrt(float(spectra.variances(used, mask, lines)[place]))

        yield NOISE[axis].value(jackknife(numbers, deviation), method)
    yield _cutoff(memory, spectra.rate) if not white else CUTOFF.unseen(Why.WHITE)


def _hertz(memory: float, rate: float) -> float:
    """Return the cut-off frequency of a first-order filter with this correlation between frames, Hz."""
    return -math.log(min(max(memory, 1e-3), 0.9999)) * rate / (2.0 * math.pi)


def _cutoff(memory: Estimate, rate: float) -> Value:
    value, low, high = (_hertz(one, rate) for one in (memory.value, memory.high, memory.low))
    estimate = Estimate(value, low, high, memory.interval)
    return CUTOFF.value(estimate, "colour of that noise, attributed to a first-order filter")


def _spectra_of(stream: Stream) -> _Spectra | None:
    """Return the periodograms of all segments; None if there are too few frames, lines or undisturbed segments."""
    begin, end = stream.standing
    inside = (stream.times >= begin) & (stream.times < end)
    times, wrench = stream.times[inside], stream.wrench[inside]
    length = 2 ** int(math.log2(max(1, min(_LONGEST, len(times) // _SEGMENTS * 2))))
    length = max(length, _SHORTEST)
    if len(times) < LEAST_BLOCKS * length:
        return None
    rate = 1.0 / float(usual_gaps(np.diff(times)).mean())
    window = np.hanning(length + 1)[:-1]
    scale = 1.0 / float(window @ window)
    frequencies = np.fft.rfftfreq(length, 1.0 / rate)
    lines = (frequencies > _SLOW_HZ) & (np.arange(len(frequencies)) >= _LEAKING)
    lines[-1] = False
    if lines.sum() < 3:
        return None
    about = np.linspace(-1.0, 1.0, length)
    power = []
    for place in range(0, len(times) - length + 1, length):
        part = wrench[place : place + length]
        level = part - part.mean(axis=0)
        level = level - np.outer(about, about @ level / (about @ about))
        power.append(np.abs(np.fft.rfft(level * window[:, None], axis=0)[lines]) ** 2 * scale)
    powers = np.array(power)
    sums = powers.sum(axis=1)
    calm = (sums <= _DISTURBED * np.median(sums, axis=0) + 1e-30).all(axis=1)
    if calm.sum() < LEAST_BLOCKS:
        return None
    steps = np.where(np.isfinite(stream.step), stream.step, 0.0)
    step = _step_sizes(stream)
    rounding: Floats = np.where(np.isfinite(step), step, steps) ** 2 / 12.0
    angles = np.asarray(2.0 * math.pi * frequencies[lines] / rate, np.float64)
    return _Spectra(powers[calm], angles, rounding, rate)


# --- step


def _step_sizes(stream: Stream) -> Floats:
    """Return the quantisation step of each axis (6,); NaN for an axis without a recognisable step."""
    return np.array([grid_of(stream.wrench[:, axis]) for axis in range(len(AXES))])


# --- drift


def _drift(stream: Stream, observations: Observations) -> Iterator[Value]:
    spans = [span for span in stream.free if span[1] - span[0] >= _FREE_LEAST_S]
    if len(spans) < 2 or observations.contact is None:
        yield from (quantity.unseen(Why.NO_FREE_ENDS) for quantity in DRIFT)
        return
    means = [_means(stream, span) for span in spans]
    times = np.concatenate([part[0] for part in means])
    zeros = np.concatenate([part[1] for part in means])
    blocks: Ints = np.arange(len(times))
    apart = float(means[1][0].mean() - means[0][0].mean()) / 60.0
    walk = _walk(means) * math.sqrt(max(apart, 1e-9) * 60.0) / max(apart, 1e-9)
    loads = np.abs(observations.contact.press).mean() * np.ones(3)
    for axis, quantity in enumerate(DRIFT):

        def slope(mask: Mask, axis: int = axis) -> float:
            about = times[mask] - times[mask].mean()
            return 60.0 * float(about @ zeros[mask, axis] / (about @ about))

        own = jackknife(blocks, slope)
        half = (
            math.hypot(own.half, 1.96 * walk)
            - own.half
            + _CREEP_SHARE * float(loads[axis]) / max(apart, 1e-9)
        )
        yield quantity.value(
            own.wider(half, "and a random walk of the zero, and creep of 1 % of the contact force"),
            "line through means over 0.5 s in free space before and after the contact",
        )


def _means(stream: Stream, span: tuple[float, float]) -> tuple[Floats, Floats]:
    """Return the times and the forces (n, 3) of means over windows of `_MEAN_S`."""
    begin, end = span
    count = int((end - begin) / _MEAN_S)
    edges = np.searchsorted(stream.times, begin + _MEAN_S * np.arange(count + 1))
    parts = [slice(a, b) for a, b in pairwise(edges.tolist()) if b > a]
    times = np.array([stream.times[part].mean() for part in parts])
    return times, np.array([stream.wrench[part, :3].mean(axis=0) for part in parts])


def _walk(means: list[tuple[Floats, Floats]]) -> float:
    """Return the random walk of the zero over all three axes, N/√s, in excess of the noise of the means."""
    steps = np.concatenate([np.diff(zeros, axis=0) for _, zeros in means])
    far = np.concatenate([zeros[4:] - zeros[:-4] for _, zeros in means if len(zeros) > 4] or [steps[:0]])
    if not len(far) or not len(steps):
        return 0.0
    more = float((far**2).mean() - (steps**2).mean()) / (3.0 * _MEAN_S)
    return math.sqrt(max(more, 0.0))
