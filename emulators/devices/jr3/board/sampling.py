"""Samples that the board has computed, including those computed ahead. The samples ahead end when settings change,
or when the sensor's samples will differ from the predicted ones.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from emulators.devices.jr3.board.data_path import Block, PathSettings, PathState, block, skipped_block
from emulators.devices.jr3.sensor import Jr3Sensor

Samples = NDArray[np.int64]

_LONGEST = 8192
"""Maximum number of samples computed at once: as many as fit the processor's cache."""
_AHEAD = 2048
"""Maximum number of samples computed ahead. Chosen: more than a sensor predicts."""


class RawSamples:
    """Readings of the sensor by absolute sample number. Readings that are taken early are stored; no reading is
    taken twice.
    """

    def __init__(self, sensor: Jr3Sensor) -> None:
        self._sensor = sensor
        self._first = 0
        self._kept: Samples = np.empty((0, 6), np.int64)

    def take(self, first: int, last: int) -> Samples:
        """Return the readings of samples `first` … `last` − 1. Earlier ones are discarded."""
        kept = self._kept[max(0, first - self._first) :]
        if len(kept) >= last - first:
            self._first, self._kept = last, kept[last - first :]
            return kept[: last - first]
        self._first, self._kept = last, kept[:0]
        fresh = self._sensor.raw(first + len(kept), last)
        return np.concatenate([kept, fresh]) if len(kept) else fresh

    def give_back(self, samples: Samples) -> None:
        """Store readings that were taken but not used."""
        self._first -= len(samples)
        self._kept = np.concatenate([samples, self._kept])

    def invalidate(self, first: int) -> None:
        """Drop the samples from this number on, because they will differ from those that were read."""
        self._kept = self._kept[: max(0, first - self._first)]


class Sampling:
    """Runs the data path up to the requested sample, and further as far as the sensor predicts.

    Samples are numbered 0, 1, … from `origin`, which is the absolute number of the first sample.
    """

    def __init__(self, raw: RawSamples, origin: int, state: PathState) -> None:
        self._raw = raw
        self._origin = origin
        self.block: Block = skipped_block(state, 0, 0)
        self.sample = -1
        """Newest sample visible to a host."""

    def reach(self, sample: int) -> bool:
        """Advance to a sample, inclusive, if it is already computed. Return whether it is."""
        if sample >= self.block.end:
            return False
        if sample > self.sample:
            self.sample = sample
        return True

    def run(self, sample: int, settings: PathSettings | None, ahead: Callable[[], int]) -> None:
        """Advance to a sample, inclusive. Without settings, nothing is computed.

        `ahead` returns the number of the last sample that may be computed already.
        """
        while self.block.end <= sample:
            start, state = self.block.end, self.block.after()
            if settings is None:
                self.block = skipped_block(state, start, sample + 1)
                continue
            end = min(max(sample, min(ahead(), start + _AHEAD - 1)) + 1, start + _LONGEST)
            raw = self._raw.take(self._origin + start, self._origin + end)
            self.block = block(state, settings, raw, start)
        self.reach(sample)

    def cut(self) -> PathState:
        """Discard the samples computed ahead, and return the state after the newest sample."""
        self._end_block(self.sample + 1)
        state = self.block.after()
        self.resume(state)
        return state

    def invalidate(self, first: int) -> None:
        """Discard the sensor's samples from this absolute number on. Samples that a host has read remain."""
        self._end_block(max(first - self._origin, self.sample + 1))
        self._raw.invalidate(first)

    def _end_block(self, end: int) -> None:
        """Discard the words computed from this sample on."""
        ahead = self.block
        if ahead.source is not None and end < ahead.end:
            self._raw.give_back(ahead.source.raw[end - ahead.start : ahead.end - ahead.start])
            ahead.end = end

    def resume(self, state: PathState) -> None:
        """Continue from another state after a cut."""
        self.block = skipped_block(state, self.sample + 1, self.sample + 1)
