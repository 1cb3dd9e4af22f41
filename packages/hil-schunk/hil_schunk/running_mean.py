"""Noise filter of an emulated SCHUNK FTS: the mean of its newest samples."""

from collections import deque

from emulators.sensing import MeasuredWrench
from hil_schunk.messages import FILTERS

_LONGEST = max(FILTERS)


class RunningMean:
    """Mean of the outputs of the newest samples. The sensor changes `length` at any time."""

    def __init__(self, measured: MeasuredWrench) -> None:
        self._measured = measured
        self.length = FILTERS[0]
        """Number of samples in the mean."""
        self._rows: deque[tuple[int, list[float]]] = deque()
        """Outputs by sample number, oldest first, including outputs that were read ahead."""
        measured.on_invalidate.append(self._forget)

    def read(self, number: int) -> list[float]:
        """Return the mean up to a sample, which must not be older than that of the previous call."""
        rows = self._rows
        if rows and rows[-1][0] < number - _LONGEST:
            rows.clear()
        if not rows or rows[-1][0] < number:
            first = rows[-1][0] + 1 if rows else number - _LONGEST + 1
            outputs = self._measured.outputs_ahead(first, number).tolist()
            rows.extend(zip(range(first, first + len(outputs)), outputs, strict=True))
        while rows[0][0] <= number - _LONGEST:
            rows.popleft()
        newest = number - rows[0][0]
        if self.length == 1:
            return rows[newest][1]
        window = [rows[place][1] for place in range(max(0, newest - self.length + 1), newest + 1)]
        return [sum(column) / len(window) for column in zip(*window, strict=True)]

    def _forget(self, number: int) -> None:
        """Drop the outputs from this number on, because the samples will differ from those that were read."""
        while self._rows and self._rows[-1][0] >= number:
            self._rows.pop()
