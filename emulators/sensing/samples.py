"""Samples of a wrench on an absolute grid: sample k of a sensor with a rate r is that of the time k / r.

Samples are computed as arrays, once, and ahead as far as the source predicts. Noise belongs to the number of a sample:
it is the same whatever the blocks in which samples are read.
"""

import math
from collections.abc import Callable

import numpy as np

from emulators.seams import Floats, WrenchSource
from protocol.geometry import Wrench

_AXES = 6
_AHEAD = 4096
"""Chosen: most samples computed before they are asked for."""
_CHUNK = 1024
"""Samples of noise drawn at once; part of what a seed means, so not to be changed."""
_CHUNKS = 4
"""Chosen: as many as hold the samples that may be invalidated and asked for again."""


def _unread(time: float) -> None:
    """No sensor has read anything."""


class KnownWrench:
    """A `WrenchSource` that a function of time tells: for a sensor without a cell.

    `wrench_at` is given times (n,), s, and answers with the wrench (n, 6), N and N·m. The others are given the present
    time and answer as those of `WrenchSource`; by default nothing is read ahead.
    """

    def __init__(
        self,
        wrench_at: Callable[[Floats], Floats],
        committed_until: Callable[[float], float] | None = None,
        predicted_until: Callable[[float], float] | None = None,
    ) -> None:
        self.wrench = wrench_at
        self.committed_until = committed_until or (lambda now: now)
        self.predicted_until = predicted_until or self.committed_until
        self.on_change: Callable[[float], object] = _unread


class Samples:
    """Samples of a sensor, each computed once and some of them ahead.

    `make` is given the number of the first sample and of the one behind the last, and answers with them (n, …).
    """

    def __init__(self, source: WrenchSource, rate_hz: float, make: Callable[[int, int], Floats]) -> None:
        self._source = source
        self._rate = rate_hz
        self._make = make
        self._ready: Floats | None = None
        """The samples from number `_ready_from` on that were computed already."""
        self._ready_from = 0
        self.on_invalidate: list[Callable[[int], object]] = []
        """Called with the number of the first sample that may differ from the one that was read ahead."""
        source.on_change = self.invalidate

    def starting(self, first: int, last: int) -> Floats:
        """Return samples from number `first` on: to `last`, the newest at present, and on behind it as far as they are
        predicted; see `on_invalidate`.
        """
        ready = self._ready
        if ready is None or not self._ready_from <= first <= self._ready_from + len(ready):
            ready, self._ready_from = None, first
        begin = self._ready_from
        stop = begin if ready is None else begin + len(ready)
        if last >= stop:
            # The first sample that is not predicted: the predicted moment itself is excluded.
            ahead = math.ceil(self.predicted_until(last / self._rate) * self._rate)
            fresh = self._make(stop, max(last + 1, min(ahead, last + _AHEAD)))
            # The last samples are kept: a reader may begin again at the same moment.
            ready = (
                fresh if ready is None or stop <= first else np.concatenate((ready[first - begin :], fresh))
            )
            self._ready, self._ready_from = ready, first
            return ready
        assert ready is not None
        return ready[first - begin :]

    def invalidate(self, time: float) -> None:
        """Drop samples from this time on, s: they will differ from those read."""
        self.invalidate_from(math.floor(time * self._rate))

    def invalidate_from(self, number: int) -> None:
        """Drop samples from this number on: they will differ from those read."""
        if self._ready is not None:
            self._ready = self._ready[: max(number - self._ready_from, 0)]
        for tell in self.on_invalidate:
            tell(number)

    def committed_until(self, now: float) -> float:
        """Time up to which samples may be read ahead, at least `now`, s."""
        return max(now, self._source.committed_until(now))

    def predicted_until(self, now: float) -> float:
        """Time up to which samples may be read ahead by a reader that minds `on_invalidate`, at least `now`, s."""
        return max(now, self._source.predicted_until(now))


class Draws:
    """Normal numbers of a seed in chunks, each of which is reached at once by its number."""

    def __init__(self, seed: int, stream: int = 0) -> None:
        """`stream` keeps apart what draws from one seed."""
        # A counter-based generator reaches every chunk at once; the upper words keep chunks and streams apart.
        self._bits = np.random.Philox(key=seed % 2**128, counter=0)
        self._begin = self._bits.state
        self._begin["state"]["counter"][3] = stream
        self._random = np.random.Generator(self._bits)

    def chunk(self, number: int, shape: tuple[int, ...]) -> Floats:
        """Return the numbers of this chunk, of variance 1."""
        self._begin["state"]["counter"][2] = number % 2**64
        self._bits.state = self._begin
        return self._random.standard_normal(shape)


class NumberedNoise:
    """Normal noise of six axes that belongs to the number of a sample."""

    def __init__(self, rms: float | Floats, seed: int) -> None:
        """`rms` is that of every axis, or of each (6, 1)."""
        self._rms = rms
        self._draws = Draws(seed)
        self._chunks: dict[int, Floats] = {}
        """Noise that was drawn last, by its number."""

    def add(self, samples: Floats, first: int, alter: Callable[[Floats, int], Floats] | None = None) -> None:
        """Add to six rows (6, n) of the samples from number `first` on, in place.

        `alter` is given the noise (6, m) of the samples from a number on, and answers with the noise to add instead.
        """
        stop = first + samples.shape[1]
        for number in range(first // _CHUNK, (stop - 1) // _CHUNK + 1):
            begin = number * _CHUNK
            here, end = max(first, begin), min(stop, begin + _CHUNK)
            noise = self._chunk(number)[:, here - begin : end - begin]
            samples[:, here - first : end - first] += noise if alter is None else alter(noise, here)

    def _chunk(self, number: int) -> Floats:
        chunk = self._chunks.get(number)
        if chunk is None:
            chunk = np.ascontiguousarray(self._draws.chunk(number, (_CHUNK, _AXES)).T)
            chunk *= self._rms
            self._chunks[number] = chunk
            if len(self._chunks) > _CHUNKS:
                del self._chunks[next(iter(self._chunks))]
        return chunk


class NoisyWrench:
    """The true wrench with noise, sample by sample: all that a sensor without properties of its own needs.

    `rms` is the noise of each axis, N and N·m; `rate_hz` the samples a second.
    """

    def __init__(self, source: WrenchSource, rate_hz: float, rms: Wrench, seed: int) -> None:
        self._source = source
        self._rate = rate_hz
        self._noise = NumberedNoise(np.array(rms)[:, np.newaxis], seed)
        self.samples = Samples(source, rate_hz, self._make)
        """The same as arrays (n, 6)."""

    def number_at(self, time: float) -> int:
        """Return the number of the newest sample at a time, s."""
        return math.floor(time * self._rate + 1e-6)  # a millionth keeps rounding from missing one

    def sample(self, number: int) -> Wrench:
        """Wrench of a sample in the sensor frame, N and N·m; numbers do not fall, and none lies ahead of its time."""
        fx, fy, fz, mx, my, mz = self.samples.starting(number, number)[0].tolist()
        return fx, fy, fz, mx, my, mz

    def _make(self, first: int, stop: int) -> Floats:
        wrench = np.array(self._source.wrench(np.arange(first, stop) / self._rate).T)
        self._noise.add(wrench, first)
        return wrench.T
