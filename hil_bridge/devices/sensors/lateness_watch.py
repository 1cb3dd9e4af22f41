"""How much later than they were sampled the frames of a stream may come, by the count of its frames alone. Pure.

A frame tells when it arrived and not when it was sampled. But a device that streams sends a frame each period. So a
stream that falls behind by 0.2 s has brought twenty frames too few of a period of 10 ms, and its counter says that
none is lost. Neither a delay that grows by small steps nor one that creeps is hidden by that.

A device is never quicker than its clock either. A stream that brought twenty frames too many has brought some twice, or
counts as lost what was not. They hide as long a delay, so that its frames count as so much later.

A delay that was there from the first frame on is not seen.
"""

import math

CLOCKS_APART = 0.02
"""Chosen: part by which a device's period may differ from what it says. A delay that grows more slowly is not seen."""
JITTER_S = 0.05
"""Lateness that is no delay yet. Chosen: a quarter of the usual limit, and above the jitter of all wires known."""
LEAP_S = 1.0
"""Chosen: frames that came so much too early tell of a counter that leapt, and not of time."""
SETTLES_S = 1.0
"""Chosen: for so long after the first frame the stream may catch up with frames that waited to be read."""


class LatenessWatch:
    """The frames of one stream since it began."""

    def __init__(self, period: float | None) -> None:
        """`period` is the time between two frames by the device's clock, s; None where each is asked for."""
        self._period = period
        self._earliest = self._at = math.nan
        """Arrival less the time that the frames count, s, of the quickest frame; when a frame came last, s."""
        self._began = math.nan
        """When the first frame came, s."""
        self._honest = math.nan
        """What a stream without copies has for `_earliest`, s: it falls no faster than the clocks are apart."""
        self._leapt = 0.0
        self._behind = 0.0
        """How much later than the quickest frame the newest came, s."""
        self.late = 0.0
        """How old the newest frame may have been when it came, s: how much later than the quickest frame it came, and
        the time for which there were too many. 0 where that is jitter, or cannot be known.
        """

    def begin(self) -> None:
        """The frames count from the next one: the stream stood still for a reason."""
        self._earliest = math.nan
        self._behind = self.late = 0.0

    def frame(self, at: float, count: int) -> None:
        """A frame arrived at this time, s. `count` is its number: those that came, and those that are known as lost."""
        if self._period is None:
            return
        offset = at - count * self._period + self._leapt
        apart = CLOCKS_APART * max(at - self._at, 0.0)
        latest, self._at = self._earliest + apart, at
        if math.isnan(latest):
            self._earliest = self._honest = offset
            self._began = at
            return
        if offset < latest - LEAP_S:
            before = latest + self._behind
            self._leapt += before - offset
            offset = before
        earliest = self._earliest = min(offset, latest)
        lowest = self._honest - apart
        self._honest = earliest if earliest > lowest or at - self._began < SETTLES_S else lowest
        hidden, self._behind = self._honest - earliest, offset - earliest
        late = self._behind + (hidden if hidden > JITTER_S else 0.0)
        self.late = late if late > JITTER_S else 0.0
