"""The board's samples: which have been computed, and how far ahead. They end when settings change, or when the sensor's
samples will differ from the predicted ones.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from emulators.devices.jr3.board.data_path import Block, PathSettings, PathState, block, held
from emulators.devices.jr3.sensor import Jr3Sensor

Samples = NDArray[np.int64]

_LONGEST = 8192
"""Most samples computed at once: as many as the processor's cache holds."""
_AHEAD = 2048
"""Most samples computed ahead. Chosen: more than a sensor predicts."""


class RawSamples:
    """The sensor's readings by absolute sample number; one that was taken too early is kept, none is taken twice."""

    def __init__(self, sensor: Jr3Sensor) -> None:
        self._sensor = sensor
        self._first = 0
        self._kept: Samples = np.empty((0, 6), np.int64)

    def take(self, first: int, last: int) -> Samples:
        """Return the readings of samples `first` … `last` − 1. Those before are lost."""
        kept = self._kept[max(0, first - self._first) :]
        if len(kept) >= last - first:
            self._first, self._kept = last, kept[last - first :]
            return kept[: last - first]
        self._first, self._kept = last, kept[:0]
        fresh = self._sensor.raw(first + len(kept), last)
        return np.concatenate([kept, fresh]) if len(kept) else fresh

    def give_back(self, samples: Samples) -> None:
        """Keep the readings that were taken last but not used."""
        self._first -= len(samples)
        self._kept = np.concatenate([samples, self._kept])

    def invalidate(self, first: int) -> None:
        """Drop samples from this number on: they will differ from those read."""
        self._kept = self._kept[: max(0, first - self._first)]


class Sampling:
    """Runs the data path up to the sample asked for, and further as far as the sensor predicts.

    Samples have the numbers 0, 1, … from `origin`, the absolute number of the first one.
    """

    def __init__(self, raw: RawSamples, origin: int, state: PathState) -> None:
        self._raw = raw
        self._origin = origin
        self.block: Block = held(state, 0, 0)
        self.sample = -1
        """The newest sample that a host may see."""

    def reach(self, sample: int) -> bool:
        """Let samples pass up to and including one, if they were computed already."""
        if sample >= self.block.end:
            return False
        if sample > self.sample:
            self.sample = sample
        return True

    def run(self, sample: int, settings: PathSettings | None, ahead: Callable[[], int]) -> None:
        """Let samples pass up to and including one; without settings nothing is computed of them.

        `ahead` tells the last sample that may be computed already.
        """
        while self.block.end <= sample:
            start, state = self.block.end, self.block.after()
            if settings is None:
                self.block = held(state, start, sample + 1)
                continue
            end = min(max(sample, min(ahead(), start + _AHEAD - 1)) + 1, start + _LONGEST)
            raw = self._raw.take(self._origin + start, self._origin + end)
            self.block = block(state, settings, raw, start)
        self.reach(sample)

    def cut(self) -> PathState:
        """Give up the samples computed ahead and tell the state after the newest sample."""
        self._end_block(self.sample + 1)
        state = self.block.after()
        self.resume(state)
        return state

    def invalidate(self, first: int) -> None:
        """Drop the sensor's samples from this absolute number on; those that a host has read stay."""
        self._end_block(max(first - self._origin, self.sample + 1))
        self._raw.invalidate(first)

    def _end_block(self, end: int) -> None:
        """Give up the words computed from this sample on."""
        ahead = self.block
        if ahead.source is not None and end < ahead.end:
            self._raw.give_back(ahead.source.raw[end - ahead.start : ahead.end - ahead.start])
            ahead.end = end

    def resume(self, state: PathState) -> None:
        """Go on from another state after a cut."""
        self.block = held(state, self.sample + 1, self.sample + 1)
