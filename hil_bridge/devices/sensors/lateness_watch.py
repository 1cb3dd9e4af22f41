"""How much later a sensor's frames come than its quickest ones did, by the count of its frames alone. Pure.

A frame tells when it arrived and not when it was sampled. But a device that streams sends a frame each period. So a
stream that falls behind by 0.2 s has brought twenty frames too few of a period of 10 ms, and its counter says that
none is lost. Neither a delay that grows by small steps nor one that creeps is hidden by that. A delay that was there
from the first frame on is not seen.
"""

import math

CLOCKS_APART = 0.02
"""Chosen: part by which a device's period may differ from what it says. A delay that grows more slowly is not seen."""
JITTER_S = 0.05
"""Lateness that is no delay yet. Chosen: a quarter of the usual limit, and above the jitter of all wires known."""
LEAP_S = 1.0
"""Chosen: frames that came so much too early tell of a counter that leapt, and not of time."""


class LatenessWatch:
    """The frames of one stream since it began."""

    def __init__(self, period: float | None) -> None:
        """`period` is the time between two frames by the device's clock, s; None where each is asked for."""
        self._period = period
        self._earliest = self._at = math.nan
        """Arrival less the time that the frames count, s, of the quickest frame; when a frame came last, s."""
        self._leapt = 0.0
        self.late = 0.0
        """How much later than the quickest frames the newest came, s; 0 where it is jitter, or cannot be known."""

    def begin(self) -> None:
        """The frames count from the next one: the stream stood still for a reason."""
        self._earliest = math.nan
        self.late = 0.0

    def frame(self, at: float, count: int) -> None:
        """A frame arrived at this time, s. `count` is its number: those that came, and those that are known as lost."""
        if self._period is None:
            return
        offset = at - count * self._period + self._leapt
        latest = self._earliest + CLOCKS_APART * max(at - self._at, 0.0)
        self._at = at
        if math.isnan(latest):
            self._earliest = offset
            return
        if offset < latest - LEAP_S:
            before = latest + self.late
            self._leapt += before - offset
            offset = before
        self._earliest = min(offset, latest)
        late = offset - self._earliest
        self.late = late if late > JITTER_S else 0.0
