"""When a device sent a message, by its own clock and by the messages that came quickest. Pure.

The device's clock runs at another rate than the receiver's and from another zero. The quickest messages give the
difference. A message that is later by this difference was held up, and its contents are as much older.
"""

import math

CLOCKS_APART = 0.02
"""Chosen: part by which the clocks of device and receiver may differ. What a message is later than that was held up. So
a delay that grows in small steps does not pass for fresh contents."""


class ArrivalClock:
    """Maps a device's time to the receiver's."""

    __slots__ = ("_difference", "arrived_at")

    def __init__(self) -> None:
        self._difference = math.inf
        """The receiver's time at the device's time 0, by the quickest messages, s."""
        self.arrived_at = math.inf
        """Arrival of the newest message, s."""

    def sent_at(self, stamp: float, arrived: float) -> float:
        """Return when a message would have come without a delay on its path, s on the receiver's clock.

        `stamp` is its time by the device's clock, s, and `arrived` when it came.
        """
        latest = self._difference + CLOCKS_APART * max(arrived - self.arrived_at, 0.0)
        self._difference, self.arrived_at = min(arrived - stamp, latest), arrived
        return arrived if arrived - stamp <= latest else self._difference + stamp
