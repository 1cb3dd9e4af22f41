"""The filter of an emulated Net F/T, over the samples of its sensor."""

import math
from collections import deque
from functools import lru_cache

import numpy as np

from emulators.devices.netft.profile import NetFtProfile
from emulators.seams import Floats
from emulators.sensing import MeasuredWrench
from protocol.devices.netft.page import FILTERS_HZ, filter_weight


@lru_cache(maxsize=64)
def _powers(share: float, count: int) -> Floats:
    """Weight of each of so many samples in a filter's output, oldest first; `share` is left from one to the next."""
    return np.asarray(share ** np.arange(count - 1, -1, -1), np.float64)


@lru_cache(maxsize=len(FILTERS_HZ))
def _weight(number: int) -> float:
    """Weight of a new sample in the filter of this number."""
    return filter_weight(FILTERS_HZ[number])


class SampleFilter:
    """A low pass. Outputs are counts without the bias."""

    def __init__(self, measured: MeasuredWrench, profile: NetFtProfile) -> None:
        self._measured, self._hold = measured, profile.saturation_hold_samples
        measured.on_invalidate.append(self._forget)
        self.number = profile.filter
        """Number of the filter, as its page has it."""
        self._ahead: deque[tuple[int, list[float]]] = deque()
        """Unfiltered outputs for the records that come next, by the numbers of their samples."""
        self.restart(0)

    def restart(self, first: int) -> None:
        """Restart at power-up: the sample `first` is the next one. Sample 0 is the first after it."""
        self.newest = first - 1
        """Number of the newest sample that was read."""
        self.output: list[float] | None = None
        self.saturated_until = -1
        """Number of the last sample that is reported as saturated."""

    def read(self, number: int, step: int) -> list[float]:
        """Read every sample up to this number and return the output. Records are `step` samples apart."""
        weight = _weight(self.number)
        # After a pause the filter has long forgotten: it begins where it would have come to.
        most = step if weight == 1.0 else math.ceil(20.0 / weight)
        first = max(self.newest + 1, number - most + 1)
        state: list[float]
        if weight == 1.0:
            state = self._unfiltered(first, number, step)
        else:
            outputs = self._measured.outputs(first, number)
            state = outputs[-1].tolist()
            if self.output is not None:
                share = 1.0 - weight
                newer = weight * (_powers(share, len(outputs)) @ outputs)
                state = (share ** len(outputs) * np.array(self.output) + newer).tolist()
        if (at_end := self._measured.last_at_end(first, number)) is not None:
            self.saturated_until = at_end + self._hold
        self.newest, self.output = number, state
        return state

    def _unfiltered(self, first: int, number: int, step: int) -> list[float]:
        """Return the output of a sample; those from `first` on are read. Outputs of the next records are kept."""
        ahead = self._ahead
        if not (ahead and ahead[0][0] == number):
            rows = self._measured.outputs_ahead(first, number)[number - first :: step].tolist()
            ahead.clear()
            ahead.extend(zip(range(number, number + len(rows) * step, step), rows, strict=True))
        return ahead.popleft()[1]

    def _forget(self, number: int) -> None:
        """Drop the outputs from this number on: they differ from those read."""
        while self._ahead and self._ahead[-1][0] >= number:
            self._ahead.pop()
