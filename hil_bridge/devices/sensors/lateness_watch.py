"""Estimate of the delay of a stream's frames since their sampling, from the number of frames alone. Pure.

A frame has an arrival time, but no sampling time. However, a streaming device sends one frame per period. If a
stream with a period of 10 ms falls behind by 0.2 s, it has delivered twenty frames too few, while its counter
indicates that none is lost. This detects both a delay that grows in small steps and a delay that grows
continuously.

A device is never faster than its clock either. A stream that has delivered twenty frames too many has delivered
some of them twice, or counts frames as lost that were not lost. The surplus frames hide a delay of the same
duration, so its frames count as that much later.

A delay that is present from the first frame on is not detected.
"""

import math

CLOCKS_APART = 0.02
"""Relative error of the period that a device states. Chosen. A delay that grows more slowly is not detected."""
JITTER_S = 0.05
"""Lateness that still counts as jitter, s. Chosen: a quarter of the default limit, and above the jitter of all
known wires.
"""
JUMP_S = 1.0
"""Lead of a frame above which the frame counter is assumed to have jumped, s. Chosen."""
SETTLES_S = 1.0
"""Time after the first frame during which the stream may catch up with frames that waited to be read, s. Chosen."""


class LatenessWatch:
    """Watch for late frames of one stream."""

    def __init__(self, period: float | None) -> None:
        """Create a watch. `period` is the time between two frames by the device's clock, s; None if each frame is
        requested.
        """
        self._period = period
        self._earliest = self._at = math.nan
        """Arrival of the earliest frame minus its time by frame count, s, and arrival of the last frame, s."""
        self._began = math.nan
        """Arrival of the first frame, s."""
        self._plausible = math.nan
        """Lowest plausible value of `_earliest` for a stream without duplicates, s. It decreases no faster than the
        clocks differ.
        """
        self._jump = 0.0
        self._behind = 0.0
        """Lateness of the newest frame relative to the earliest one, s."""
        self.late = 0.0
        """Possible age of the newest frame at its arrival, s: its lateness relative to the earliest frame, plus the
        time of surplus frames. 0 if the lateness is jitter or unknown.
        """

    def begin(self) -> None:
        """Restart with the next frame, after a pause of the stream with a known reason."""
        self._earliest = math.nan
        self._behind = self.late = 0.0

    def frame(self, at: float, count: int) -> None:
        """Check a frame that arrived at time `at`, s. `count` is the number of the frame: frames received plus
        frames known to be lost.
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
