"""Random delay of each frame of a gateway's stream."""

import random
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from emulators.quantiles import draw


@dataclass(frozen=True, slots=True)
class Sample:
    """Reading sent by a gateway."""

    counts: list[int]
    """Filtered and zeroed counts: fx fy fz mx my mz."""
    counter: int
    """Number of samples since the start, modulo 65536."""


class LateSamples:
    """Delays the samples of a stream, each by a random time, and keeps their order."""

    def __init__(self, quantiles_ms: Sequence[float], seed: int) -> None:
        self._quantiles_ms = quantiles_ms
        self._random = random.Random(f"{seed} gateway")
        self._waiting: deque[tuple[float, Sample]] = deque()

    def arrived(self, samples: Iterable[Sample], now: float) -> Iterator[Sample]:
        """Add samples. Return the samples that are due."""
        for sample in samples:
            at = now + draw(self._quantiles_ms, self._random) / 1000.0
            if self._waiting:
                at = max(at, self._waiting[-1][0])
            self._waiting.append((at, sample))
        while self._waiting and self._waiting[0][0] <= now:
            yield self._waiting.popleft()[1]

    def next_deadline(self, other: float | None) -> float | None:
        """Return the time at which the next sample is due, s, or `other` if that is earlier."""
        if not self._waiting:
            return other
        at = self._waiting[0][0]
        return at if other is None else min(at, other)
