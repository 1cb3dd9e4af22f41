"""Errors of a sensor in addition to its white noise: drift of the zero, creep, and vibration of its arm. For
hysteresis and cross-talk, see `emulators.sensing.distortion`.

All errors depend only on the number of a sample. They depend neither on the blocks in which samples are read nor on
whether samples are computed again after an order. Knots lie on the grid of sample numbers. Creep and motion are
kept at the newest knots. If a reader skipped some knots, they are computed again from the source, as far back as a
path keeps its past.
"""

import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from emulators.seams import Floats, MovingSource, WrenchSource
from emulators.sensing.samples import Draws
from protocol.geometry import Vector

NO_FORCE: Vector = (0.0, 0.0, 0.0)

_AXES, _FORCES = 6, 3
_WANDER_STREAM, _MOTION_STREAM, _VIBRATION_STREAM = 1, 2, 3
"""Random streams of a seed in addition to its noise. They are part of the meaning of a seed, so do not change them."""
_WANDER_S = 10.0
"""Time within which the rms change of the zero reaches the value of the wander, s."""
_WANDER_KNOT_S = 0.1
"""Time between two steps of the random walk, s, which is linear in between. Chosen."""
_KNOTS = 64
"""Number of steps of the random walk that are drawn at once. It is part of the meaning of a seed, so do not change
it.
"""
_CHUNK = 1024
"""Number of samples of the wander that are computed at once. Chosen."""
_KNOT_S = 0.05
"""Time between two updates of creep and arm speed, s. Chosen."""
_KNOTS_KEPT = 1024
"""Number of knots that are kept. Chosen: enough to hold the samples that may be computed again."""
_PAST_S = 10.0
"""Age of the oldest wrench that can be read from a source, s. It equals the duration that a path keeps."""
_REPEAT_S = 4.0
"""Period after which the vibration repeats, s. Chosen: its spectral lines are 0.25 Hz apart."""


@dataclass(frozen=True, slots=True)
class SensorErrors:
    """Errors in addition to white noise. By default, there are no errors."""

    since: float = 0.0
    """Start of wander, slope and creep, s, which is the time of power-up."""
    wander: Vector = NO_FORCE
    """Random walk of the zero of each force axis, as the rms change within 10 s, N."""
    slope: Vector = NO_FORCE
    """Steady drift of the zero of each force axis, N/s."""
    hysteresis_share: float = 0.0
    """Difference of the readings of a rising and a falling load, as a share of the load's change."""
    cross_talk_share: float = 0.0
    """Largest reading of an axis due to another axis, in shares of their full scales."""
    creep_share: float = 0.0
    """Share of a load change, in force and moment, that is reported late."""
    creep_s: float = 1.0
    """Time constant of the share that is reported late, s."""
    vibration: Vector = NO_FORCE
    """Vibration of the arm in each force axis, rms, N."""
    vibration_hz: tuple[float, float] = (9.0, 16.0)
    """Frequency band of the vibration, Hz."""
    peak_hz: float = 71.0
    """Frequency of the vibration's peak outside the band, Hz."""
    peak_share: float = 0.0
    """Share of the vibration's variance that the peak contains."""
    motion: Vector = NO_FORCE
    """White noise of each force axis while the arm moves, rms, N."""
    motion_speed: float = 0.1
    """Tool speed from which the motion noise has its full value, m/s. Below this speed, the noise is proportional
    to the speed.
    """

    @property
    def mechanical(self) -> bool:
        """Whether there are errors caused by the load or by the arm."""
        return bool(self.creep_share or any(self.vibration) or any(self.motion))

    @property
    def distorting(self) -> bool:
        """Whether there is hysteresis or cross-talk."""
        return bool(self.hysteresis_share or self.cross_talk_share)

    @property
    def of_zero(self) -> bool:
        """Whether the zero drifts."""
        return any(self.wander) or any(self.slope)


class ZeroWander:
    """Random walk and slope of a sensor's zero, in units of its outputs (rows, n)."""

    def __init__(self, unrest: SensorErrors, rate_hz: float, matrix: Floats, seed: int) -> None:
        """`matrix` (rows, 6) maps N and N·m to outputs."""
        self._matrix = matrix[:, :_FORCES]
        self._begin = math.floor(unrest.since * rate_hz)
        self._per_knot = max(1, round(_WANDER_KNOT_S * rate_hz))
        knot_s = self._per_knot / rate_hz
        self._step = np.array(unrest.wander)[:, np.newaxis] * math.sqrt(knot_s / _WANDER_S)
        self._slope = np.array(unrest.slope)[:, np.newaxis] / rate_hz
        self._draws = Draws(seed, _WANDER_STREAM)
        self._bases = [np.zeros((_FORCES, 1))]
        """Random walk at the first knot of each chunk of knots computed so far."""
        self._chunk_number: int | None = None
        self._chunk = np.zeros((len(matrix), 0))
        """Outputs of the chunk of samples that was read last."""

    def add(self, outputs: Floats, first: int) -> None:
        """Add the drift of the zero in place to the outputs (rows, n) of the samples from number `first` on."""
        stop = first + outputs.shape[1]
        for number in range(first // _CHUNK, (stop - 1) // _CHUNK + 1):
            begin = number * _CHUNK
            here, end = max(first, begin), min(stop, begin + _CHUNK)
            if number != self._chunk_number:
                self._chunk_number, self._chunk = number, self._matrix @ self._zeros(begin)
            outputs[:, here - first : end - first] += self._chunk[:, here - begin : end - begin]

    def _zeros(self, begin: int) -> Floats:
        """Return the zero (3, n) of the samples of a chunk that begins at sample number `begin`, N."""
        since = np.maximum(np.arange(begin, begin + _CHUNK) - self._begin, 0)
        low, high = int(since[0]) // self._per_knot, int(since[-1]) // self._per_knot + 1
        knots = np.arange(low, high + 1)
        walk = np.concatenate(
            [self._walk(chunk)[:, :_KNOTS] for chunk in range(low // _KNOTS, high // _KNOTS + 1)], axis=1
        )[:, knots - low // _KNOTS * _KNOTS]
        zeros = np.stack([np.interp(since, knots * self._per_knot, row) for row in walk])
        zeros += self._slope * since
        return zeros

    def _walk(self, chunk: int) -> Floats:
        """Return the random walk (3, 65) at the knots of a chunk and at the first knot after it, N."""
        while len(self._bases) <= chunk:
            self._bases.append(self._walk(len(self._bases) - 1)[:, -1:])
        steps = self._draws.chunk(chunk, (_FORCES, _KNOTS)) * self._step
        return self._bases[chunk] + np.concatenate((np.zeros((_FORCES, 1)), np.cumsum(steps, axis=1)), axis=1)


class _Knot(NamedTuple):
    """Load and motion at a knot."""

    number: int
    load: Floats
    """Load (6,), N and N·m."""
    late: Floats
    """Load (6,) after the creep filter, N and N·m."""
    moving: float
    """Share of the motion noise at the knot, 0 … 1."""


class Mechanics:
    """Creep of a sensor's body and vibration of its arm, added to the true wrench."""

    def __init__(self, unrest: SensorErrors, source: WrenchSource, rate_hz: float, seed: int) -> None:
        self._unrest, self._source, self._rate = unrest, source, rate_hz
        self._per_knot = max(1, round(_KNOT_S * rate_hz))
        self._gain = -math.expm1(-self._per_knot / rate_hz / unrest.creep_s)
        """Share of the remaining difference from the load that the creep filter covers from one knot to the next."""
        self._ramp = np.arange(self._per_knot) / self._per_knot
        self._first_knot = math.ceil(unrest.since * rate_hz / self._per_knot)
        self._knots: deque[_Knot] = deque(maxlen=_KNOTS_KEPT)
        """Knots in ascending order, without gaps."""
        self._table = _vibration(unrest, rate_hz, seed) if any(unrest.vibration) else None
        self._motion = np.array(unrest.motion)[:, np.newaxis]
        self._moving = source if any(unrest.motion) and isinstance(source, MovingSource) else None
        self._by_knots = bool(unrest.creep_share) or self._moving is not None
        self._share, self._keep = unrest.creep_share, 1.0 - unrest.creep_share
        self._draws = Draws(seed, _MOTION_STREAM)
        self._chunk_number: int | None = None
        self._chunk = np.zeros((_FORCES, 0))
        self._disturbed: _Knot | None = None
        self._disturbance = np.zeros((_AXES, 0))
        """Disturbance after the knot `_disturbed`; see `_disturbance_after`."""

    def load(self, wrench: Floats, first: int) -> Floats:
        """Return the load (6, n) of the samples from number `first` on, N and N·m, for their true wrench (6, n)."""
        if not self._by_knots:
            load = np.array(wrench)
            self._vibrate(load, first)
            return load
        knots, count = self._knots, wrench.shape[1]
        since = first - knots[-1].number * self._per_knot if knots else -1
        if since > 0 and since + count <= self._per_knot:  # nearly always
            return self._keep * wrench + self._disturbance_after(knots[-1])[:, since : since + count]
        self.forget(first)
        load = self._keep * wrench
        for part, knot in self._stretches(wrench, first):
            since = first - knot.number * self._per_knot
            load[:, part] += self._disturbance_after(knot)[:, since + part.start : since + part.stop]
        return load

    def forget(self, number: int) -> None:
        """Drop the knots from this sample number on.

        The samples will differ from the samples that were read.
        """
        while self._knots and self._knots[-1].number * self._per_knot >= number:
            self._knots.pop()

    def _disturbance_after(self, knot: _Knot) -> Floats:
        """Return creep, motion noise and vibration (6, m) of the samples from a knot to the next knot, N and N·m."""
        if knot is not self._disturbed:
            self._disturbed, first = knot, knot.number * self._per_knot
            crept, creeps = self._share * knot.late, self._share * self._gain * (knot.load - knot.late)
            self._disturbance = crept[:, np.newaxis] + creeps[:, np.newaxis] * self._ramp
            if knot.moving:
                self._shake(self._disturbance[:_FORCES], first, knot.moving)
            self._vibrate(self._disturbance, first)
        return self._disturbance

    def _vibrate(self, load: Floats, first: int) -> None:
        """Add the vibration of the arm in place to the load (6, n) of the samples from number `first` on."""
        if self._table is not None:
            _add_table(load[:_FORCES], self._table, first)

    def _shake(self, forces: Floats, first: int, share: float) -> None:
        stop = first + forces.shape[1]
        for number in range(first // _CHUNK, (stop - 1) // _CHUNK + 1):
            begin = number * _CHUNK
            here, end = max(first, begin), min(stop, begin + _CHUNK)
            if number != self._chunk_number:
                self._chunk_number = number
                self._chunk = self._draws.chunk(number, (_FORCES, _CHUNK)) * self._motion
            forces[:, here - first : end - first] += share * self._chunk[:, here - begin : end - begin]

    # --- knots

    def _stretches(self, wrench: Floats, first: int) -> Iterator[tuple[slice, _Knot]]:
        """Yield slices that cover these samples, each with the newest knot that is not after it.

        `wrench` is the wrench without errors.
        """
        per_knot, stop = self._per_knot, first + wrench.shape[1]
        inside = range(-(-first // per_knot), (stop - 1) // per_knot + 1)
        loads = wrench[:, [number * per_knot - first for number in inside]].T
        end = min(inside.start * per_knot, stop)
        self._fill(inside.start - 1)
        if end > first:
            if not self._knots:  # read immediately after power-up
                self._append(inside.start - 1, wrench[:, 0], 0.0)
            yield slice(0, end - first), self._knots[-1]
        for number, load, moving in zip(inside, loads, self._moving_at(inside), strict=True):
            self._append(number, load, moving)
            begin = number * per_knot - first
            yield slice(begin, min(begin + per_knot, stop - first)), self._knots[-1]

    def _fill(self, last: int) -> None:
        """Compute all missing knots up to this knot, as far back as the source can be read."""
        oldest = last - math.floor(_PAST_S * self._rate / self._per_knot)
        begin = self._knots[-1].number + 1 if self._knots else self._first_knot
        numbers = range(max(begin, oldest), last + 1)
        if not numbers:
            return
        loads = self._source.wrench(np.asarray(numbers) * self._per_knot / self._rate)
        if self._knots and numbers[0] > begin:  # the load in between is no longer available
            before, missed = self._knots[-1], numbers[0] - begin
            late = loads[0] + (before.late - loads[0]) * (1.0 - self._gain) ** (missed + 1)
            self._knots.clear()
            self._knots.append(_Knot(numbers[0] - 1, loads[0], late, 0.0))
        for number, load, moving in zip(numbers, loads, self._moving_at(numbers), strict=True):
            self._append(number, load, moving)

    def _append(self, number: int, load: Floats, moving: float) -> None:
        late = load
        if self._knots:
            before = self._knots[-1]
            late = before.late + self._gain * (before.load - before.late)
        self._knots.append(_Knot(number, load.copy(), late, moving))

    def _moving_at(self, numbers: Sequence[int]) -> list[float]:
        """Return the share of the motion noise at each knot."""
        if self._moving is None or not numbers:
            return [0.0] * len(numbers)
        speeds = self._moving.speeds(np.asarray(numbers) * self._per_knot / self._rate)
        shares: list[float] = np.minimum(speeds / self._unrest.motion_speed, 1.0).tolist()
        return shares


def _vibration(unrest: SensorErrors, rate_hz: float, seed: int) -> Floats:
    """Return one period of the vibration (3, n) from sample 0 on, N, as spectral lines with phases from the seed."""
    count = round(_REPEAT_S * rate_hz)
    low, high = (frequency * _REPEAT_S for frequency in unrest.vibration_hz)
    band = range(math.ceil(low), max(math.ceil(low), math.floor(high)) + 1)
    lines = [*band, round(unrest.peak_hz * _REPEAT_S)]
    variances = [(1.0 - unrest.peak_share) / len(band)] * len(band) + [unrest.peak_share]
    drawn = Draws(seed, _VIBRATION_STREAM).chunk(0, (2, _FORCES, len(lines)))
    phases = np.arctan2(drawn[0], drawn[1])
    spectrum = np.zeros((_FORCES, count // 2 + 1), complex)
    for line, variance, phase in zip(lines, variances, phases.T, strict=True):
        folded = line % count  # a line above half the sample rate is aliased
        if folded > count - folded:
            folded, phase = count - folded, -phase
        spectrum[:, folded] += 0.5 * count * math.sqrt(2.0 * variance) * np.exp(1j * phase)
    table: Floats = np.fft.irfft(spectrum, count)
    table *= np.array(unrest.vibration)[:, np.newaxis]
    return table


def _add_table(rows: Floats, table: Floats, first: int) -> None:
    """Add a periodic table in place to rows of samples from a given sample number on."""
    count, length = rows.shape[1], table.shape[1]
    begin = first % length
    if begin + count <= length:  # nearly always
        rows += table[:, begin : begin + count]
    else:
        rows += np.take(table, range(begin, begin + count), axis=1, mode="wrap")
