"""Estimate of the delay of a stream's frames since their sampling, from the count of its frames alone. Pure.

A frame has its arrival time, and not its sampling time. But a streaming device sends a frame each period. So a stream
that falls behind by 0.2 s has delivered twenty frames too few of a period of 10 ms, while its counter says that none is
lost. Neither a delay that grows in small steps nor one that creeps escapes this.

A device is never faster than its clock either. A stream that delivered twenty frames too many has delivered some twice,
or counts frames as lost that were not. They hide an equally long delay, so its frames count as that much later.

A delay that is present from the first frame on is not detected.
"""

import math

CLOCKS_APART = 0.02
"""Chosen: relative error of a device's stated period. A delay that grows more slowly is not detected."""
JITTER_S = 0.05
"""Lateness that still counts as jitter. Chosen: a quarter of the default limit, and above the jitter of all known
wires.
"""
JUMP_S = 1.0
"""Chosen: lead of a frame that indicates a jump of the counter instead of time."""
SETTLES_S = 1.0
"""Chosen: time after the first frame in which the stream may catch up with frames that waited to be read."""


class LatenessWatch:
    """Watch over the frames of one stream."""

    def __init__(self, period: float | None) -> None:
        """`period` is the time between two frames by the device's clock, s; None if each is requested."""
        self._period = period
        self._earliest = self._at = math.nan
        """Arrival less the time by frame count of the earliest frame, s; arrival of the last frame, s."""
        self._began = math.nan
        """Arrival of the first frame, s."""
        self._plausible = math.nan
        """Value of `_earliest` for a stream without duplicates, s: it falls no faster than the clocks differ."""
        self._jump = 0.0
        self._behind = 0.0
        """Lateness of the newest frame relative to the earliest one, s."""
        self.late = 0.0
        """Possible age of the newest frame at its arrival, s: its lateness relative to the earliest frame, plus the
        time of surplus frames. 0 if that is jitter, or unknown.
        """

    def begin(self) -> None:
        """Restart with the next frame, because the stream paused for a reason."""
        self._earliest = math.nan
        self._behind = self.late = 0.0

    def frame(self, at: float, count: int) -> None:
        """Check a frame that arrived at this time, s. `count` is its number: frames received plus frames known
        as lost.
        """
        if self._period is None:
            return
        offset = at - count * self._period + self._jump
        apart = CLOCKS_APART * max(at - self._at, 0.0)
        latest, self._at = self._earliest + apart, at
        if math.isnan(latest):
            self._earliest = self._plausible = offset
            self._began = at
            return
        if offset < latest - JUMP_S:
            before = latest + self._behind
            self._jump += before - offset
            offset = before
        earliest = self._earliest = min(offset, latest)
        lowest = self._plausible - apart
        self._plausible = earliest if earliest > lowest or at - self._began < SETTLES_S else lowest
        hidden, self._behind = self._plausible - earliest, offset - earliest
        late = self._behind + (hidden if hidden > JITTER_S else 0.0)
        self.late = late if late > JITTER_S else 0.0
