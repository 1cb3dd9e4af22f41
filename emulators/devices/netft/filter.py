"""Filter of an emulated Net F/T, or of a sensor with similar filters, applied to the samples of its sensor."""

import math
from collections import deque
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from emulators.seams import Floats
from emulators.sensing import MeasuredWrench


@lru_cache(maxsize=64)
def _powers(share: float, count: int) -> Floats:
    """Return the weights of the last `count` samples in a filter's output, oldest first.

    `share` is the ratio of a sample's weight to that of the next sample.
    """
    return np.asarray(share ** np.arange(count - 1, -1, -1), np.float64)


class SampleFilter:
    """Low-pass filter of one pole. Its outputs are counts from which no bias is subtracted."""

    def __init__(self, measured: MeasuredWrench, weights: Sequence[float], number: int, hold: int) -> None:
        """`weights` are those of a new sample in each of the sensor's filters, `number` is the present filter.
        `hold` is the number of samples for which saturation is still reported after its end.
        """
        self._measured, self._weights, self._hold = measured, weights, hold
        measured.on_invalidate.append(self._forget)
        self.number = number
        """Number of the filter."""
        self._ahead: deque[tuple[int, list[float]]] = deque()
        """Unfiltered outputs for the next records, each with its sample number."""
        self.restart(0)

    def restart(self, first: int) -> None:
        """Restart at power-up. `first` is the number of the next sample."""
        self.newest = first - 1
        """Number of the newest sample read."""
        self.output: list[float] | None = None
        self.saturated_until = -1
        """Number of the last sample that is reported as saturated."""

    def read(self, number: int, step: int) -> list[float]:
        """Read every sample up to this number and return the output. Records are `step` samples apart."""
        weight = self._weights[self.number]
        # After a long pause, older samples have no weight, so the filter reads only the newest ones.
        most = step if weight == 1.0 else math.ceil(20.0 / weight)
        first = max(self.newest + 1, number - most + 1)
        state: list[float]
        if weight == 1.0:
            state = self._read_unfiltered(first, number, step)
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

    def _read_unfiltered(self, first: int, number: int, step: int) -> list[float]:
        """Return the output of a sample, and read the samples from `first` on. Outputs for the next records are
        stored.
        """
        ahead = self._ahead
        if not (ahead and ahead[0][0] == number):
            rows = self._measured.outputs_ahead(first, number)[number - first :: step].tolist()
            ahead.clear()
            ahead.extend(zip(range(number, number + len(rows) * step, step), rows, strict=True))
        return ahead.popleft()[1]

    def _forget(self, number: int) -> None:
        """Drop the outputs from this number on, because the samples will differ from those that were read."""
        while self._ahead and self._ahead[-1][0] >= number:
            self._ahead.pop()
