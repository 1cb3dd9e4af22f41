"""Estimate of the time at which a device sent a message, from the device's clock and the fastest messages.

The device's clock has a different rate and a different zero than the receiver's clock. The fastest messages give
the offset between the clocks. A message that arrives later than this offset predicts was delayed, and its contents
are older by the same amount.
"""

import math

CLOCKS_APART = 0.02
"""Largest relative difference between the rates of the device's and the receiver's clock. Chosen: any larger delay
counts as a delayed message, so that a slowly growing delay does not pass for fresh contents.
"""


class ArrivalClock:
    """Converter of times on a device's clock to times on the receiver's clock."""

    __slots__ = ("_difference", "arrived_at")

    def __init__(self) -> None:
        self._difference = math.inf
        """Time on the receiver's clock at time 0 of the device's clock, from the fastest messages, s."""
        self.arrived_at = math.inf
        """Arrival time of the newest message, s."""

    def sent_at(self, stamp: float, arrived: float) -> float:
        """Return the time at which a message would have arrived without a delay, s on the receiver's clock.

        `stamp` is the message's time stamp on the device's clock, s. `arrived` is its arrival time on the
        receiver's clock, s.
        """
        latest = self._difference + CLOCKS_APART * max(arrived - self.arrived_at, 0.0)
        self._difference, self.arrived_at = min(arrived - stamp, latest), arrived
        return arrived if arrived - stamp <= latest else self._difference + stamp
