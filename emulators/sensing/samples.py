"""Samples of a wrench on an absolute time grid: sample k of a sensor with rate r belongs to the time k / r.

Samples are computed once, as arrays, and as far ahead as the source can predict. Noise depends on the number of a
sample, not on the blocks in which samples are read.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np

from emulators.seams import Floats, WrenchSource
from protocol.geometry import Wrench

_AXES = 6
_AHEAD = 4096
"""Maximum number of samples that are computed ahead. Chosen."""
_CHUNK = 1024
"""Number of noise samples that are drawn at once. It is part of the meaning of a seed, so do not change it."""
_CHUNKS = 4
"""Number of chunks that are kept. Chosen: enough to hold the samples that may be invalidated and read again."""


def _unread(time: float) -> None:
    """Do nothing, because no sensor has read anything."""


class KnownWrench:
    """`WrenchSource` that is defined by a function of time, for a sensor without a cell.

    `wrench_at` maps times (n,), s, to the wrench (n, 6), N and N·m. The other functions map the present time to the
    results of the `WrenchSource` methods with the same names. By default, nothing is read ahead.
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


class SteppedWrench(KnownWrench):
    """`WrenchSource` that changes in steps, for a sensor without a cell."""

    def __init__(self, wrench: Sequence[float]) -> None:
        """Begin with a wrench (6,), N and N·m."""
        super().__init__(self._wrench_at)
        self._times, self._wrenches = [-math.inf], np.array([wrench], dtype=float)

    def step(self, wrench: Sequence[float], now: float) -> None:
        """Change to a wrench (6,), N and N·m, at the time `now`, s."""
        self._times.append(now)
        self._wrenches = np.vstack((self._wrenches, wrench))
        self.on_change(now)

    def _wrench_at(self, times: Floats) -> Floats:
        wrenches: Floats = self._wrenches[np.searchsorted(self._times, times, side="right") - 1]
        return wrenches


class Samples:
    """Samples of a sensor. Each sample is computed once, and some samples are computed ahead.

    `make` receives the number of the first sample and the number after the last sample, and returns the samples (n,
    …).
    """

    def __init__(self, source: WrenchSource, rate_hz: float, make: Callable[[int, int], Floats]) -> None:
        self._source = source
        self._rate = rate_hz
        self._make = make
        self._ready: Floats | None = None
        """Samples that are already computed, from sample number `_ready_from` on."""
        self._ready_from = 0
        self.on_invalidate: list[Callable[[int], object]] = []
        """Callback for the number of the first sample that may differ from the sample that was read ahead."""
        source.on_change = self.invalidate

    def starting(self, first: int, last: int) -> Floats:
        """Return the samples from `first` on: up to `last`, the newest sample at present, and then the predicted
        samples.

        For predicted samples, see `on_invalidate`.
        """
        ready = self._ready
        if ready is None or not self._ready_from <= first <= self._ready_from + len(ready):
            ready, self._ready_from = None, first
        begin = self._ready_from
        stop = begin if ready is None else begin + len(ready)
        if last >= stop:
            # Number of the first sample that is not predicted; `predicted_until` itself is excluded.
            ahead = math.ceil(self.predicted_until(last / self._rate) * self._rate)
            fresh = self._make(stop, max(last + 1, min(ahead, last + _AHEAD)))
            # The last samples are kept, because a reader may restart at the same time.
            ready = (
                fresh if ready is None or stop <= first else np.concatenate((ready[first - begin :], fresh))
            )
            self._ready, self._ready_from = ready, first
            return ready
        assert ready is not None
        return ready[first - begin :]

    def invalidate(self, time: float) -> None:
        """Drop samples from this time on, s, because they will differ from the samples that were read."""
        self.invalidate_from(math.floor(time * self._rate))

    def invalidate_from(self, number: int) -> None:
        """Drop samples from this number on, because they will differ from the samples that were read."""
        if self._ready is not None:
            self._ready = self._ready[: max(number - self._ready_from, 0)]
        for listener in self.on_invalidate:
            listener(number)

    def committed_until(self, now: float) -> float:
        """Return the time up to which any reader may read ahead, s. The result is at least `now`."""
        return max(now, self._source.committed_until(now))

    def predicted_until(self, now: float) -> float:
        """Return the time up to which a reader that handles `on_invalidate` may read ahead, s.

        The result is at least `now`.
        """
        return max(now, self._source.predicted_until(now))


class Draws:
    """Normal random numbers from a seed in chunks, with random access to each chunk by its number."""

    def __init__(self, seed: int, stream: int = 0) -> None:
        """`stream` separates the different uses of one seed."""
        # A counter-based generator gives random access to every chunk; the upper words separate chunks and streams.
        self._bits = np.random.Philox(key=seed % 2**128, counter=0)
        self._begin = self._bits.state
        self._begin["state"]["counter"][3] = stream
        self._random = np.random.Generator(self._bits)

    def chunk(self, number: int, shape: tuple[int, ...]) -> Floats:
        """Return the normal random numbers of a chunk, with variance 1."""
        self._begin["state"]["counter"][2] = number % 2**64
        self._bits.state = self._begin
        return self._random.standard_normal(shape)


class NumberedNoise:
    """Normal noise of six axes that depends only on the number of a sample."""

    def __init__(self, rms: float | Floats, seed: int) -> None:
        """`rms` is one value for all axes, or one value for each axis (6, 1)."""
        self._rms = rms
        self._draws = Draws(seed)
        self._chunks: dict[int, Floats] = {}
        """Most recently drawn chunks of noise, by number."""

    def add(self, samples: Floats, first: int, alter: Callable[[Floats, int], Floats] | None = None) -> None:
        """Add noise in place to the samples (6, n) from number `first` on.

        `alter` receives the noise (6, m) of the samples from a given number on, and returns the noise to add
        instead.
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
    """True wrench plus noise, one sample at a time, for a simple sensor.

    `rms` is the noise of each axis, N and N·m; `rate_hz` is the number of samples per second.
    """

    def __init__(self, source: WrenchSource, rate_hz: float, rms: Wrench, seed: int) -> None:
        self._source = source
        self._rate = rate_hz
        self._noise = NumberedNoise(np.array(rms)[:, np.newaxis], seed)
        self.samples = Samples(source, rate_hz, self._make)
        """Samples as arrays (n, 6)."""

    def number_at(self, time: float) -> int:
        """Return the number of the newest sample at a given time, s."""
        return math.floor(time * self._rate + 1e-6)  # a margin of one millionth allows for rounding

    def sample(self, number: int) -> Wrench:
        """Return the wrench of a sample in the sensor frame, N and N·m.

        Successive calls must not decrease the number, and a sample must not be read before its time.
        """
        fx, fy, fz, mx, my, mz = self.samples.starting(number, number)[0].tolist()
        return fx, fy, fz, mx, my, mz

    def _make(self, first: int, stop: int) -> Floats:
        wrench = np.array(self._source.wrench(np.arange(first, stop) / self._rate).T)
        self._noise.add(wrench, first)
        return wrench.T
