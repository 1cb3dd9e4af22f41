"""Detection of a stream that repeats a part of itself, frame by frame. Pure.

A converter, a driver or a recorder that hangs in a loop sends its last second again and again, including noise.
Noise never repeats: a sequence of frames that equals an earlier one, in order, contains nothing new. Quiet sensors
repeat single values by chance. Each repeated frame therefore counts by its information, which is small for a common
value. A sensor without noise while stationary is not watched, because the force of a held contact may repeat
itself.
"""

import math
from collections import Counter, deque
from collections.abc import Sequence

_ROW = 8
"""Number of frames by which an earlier part of the stream is recognized. Chosen."""
_LEAST_LAG = 16
"""Minimum number of frames between a sequence and its repetition. Chosen: aliased hum repeats sooner."""
_BITS = 64.0
"""Information of the repeated frames above which chance is excluded, bits. Chosen: a probability of 10⁻¹⁹."""
_AT_REST = 64
"""Number of frames at the start of a stream, with a stationary tool, from which its noise is measured. Chosen."""
_LIVELY_BITS = 3.0
"""Mean information of these frames above which the stream is watched, bits per frame. Chosen; the maximum is six
bits.
"""


class ReplayWatch:
    """Watch for repetitions among the newest frames of one stream."""

    def __init__(self, frames: int) -> None:
        """Create a watch. `frames` is the number of frames that are kept for comparison."""
        self._frames = frames
        self._lively: bool | None = None
        self.since = math.nan
        """Arrival of the first frame of a repetition in progress, s; NaN while the stream is new."""
        self.zeroed()

    def zeroed(self) -> None:
        """Restart with the next frame, because a zero changes the values."""
        self._kept: deque[tuple[Sequence[float], int, float]] = deque(maxlen=self._frames)
        """Kept frames: values, hash of the sequence that ends with the frame, and arrival, s."""
        self._common: Counter[Sequence[float]] = Counter()
        self._row: deque[Sequence[float]] = deque(maxlen=_ROW)
        self._rows: dict[int, int] = {}
        """Number of the last frame of each sequence, by the hash of the sequence."""
        self._number = self._lag = 0
        self._bits = 0.0
        self._began = self.since = math.nan

    def frame(self, values: Sequence[float], at: float) -> None:
        """Check a frame that arrived at time `at`, s."""
        if self._lively is False:
            return
        if self._lag and self._kept[-self._lag][0] == values:
            self._bits += self._information(values)
        else:
            self._lag, self._bits, self.since = 0, 0.0, math.nan
        self._keep(values, at)
        if self._lively is None:
            self._judge_noise()
        elif self._lag and self._bits >= _BITS and math.isnan(self.since):
            self.since = self._began

    def _keep(self, values: Sequence[float], at: float) -> None:
        """Store a frame, discard the oldest one, and search for the sequence that ends with the new frame."""
        kept, common = self._kept, self._common
        if len(kept) == kept.maxlen:
            oldest, mark, _ = kept[0]
            common[oldest] -= 1
            if not common[oldest]:
                del common[oldest]
            if self._rows.get(mark) == self._number - len(kept):
                del self._rows[mark]
        self._row.append(values)
        mark = hash(tuple(self._row))
        kept.append((values, mark, at))
        common[values] += 1
        if not self._lag and len(self._row) == _ROW and (before := self._rows.get(mark)) is not None:
            self._find(self._number - before)
        self._rows[mark] = self._number
        self._number += 1

    def _judge_noise(self) -> None:
        if len(self._kept) == _AT_REST:
            bits = sum(self._information(values) for values, _, _ in self._kept)
            self._lively = bits >= _LIVELY_BITS * _AT_REST

    def _find(self, lag: int) -> None:
        """Check an earlier occurrence of the newest sequence, this many frames ago."""
        if not _LEAST_LAG <= lag < len(self._kept) - _ROW:
            return
        newest = [self._kept[-k] for k in range(_ROW, 0, -1)]
        if any(self._kept[-k - lag][0] != newest[-k][0] for k in range(1, _ROW + 1)):
            return  # the hashes are equal by chance
        self._lag, self._began = lag, newest[0][2]
        self._bits = sum(self._information(values) for values, _, _ in newest)

    def _information(self, values: Sequence[float]) -> float:
        return math.log2(len(self._kept) / (self._common[values] or 1))
