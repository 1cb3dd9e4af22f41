"""Numbers and times of data packets, by the controller's clock."""

import math

from protocol.arrival_clock import ArrivalClock
from protocol.devices.rtde.profile import ClientProfile


class PacketClock:
    """Counts the packets of a stream, and estimates when each was sent."""

    def __init__(self, profile: ClientProfile) -> None:
        self._cycle, self._silent = profile.cycle_s, profile.silent_ms / 1000.0
        self.number = 0
        self.stamp: float | None = None
        """Time of the newest data packet, by the controller's clock, s."""
        self._clock = ArrivalClock()

    def take(self, stamp: float) -> None:
        """Assign the packet its number, by the controller's clock if that advances."""
        steps = 1
        if self.stamp is not None and math.isfinite(stamp) and stamp > self.stamp:
            steps = max(1, round(min((stamp - self.stamp) / self._cycle, 1e6)))
        self.stamp = stamp if math.isfinite(stamp) else self.stamp
        self.number += steps

    def sent_at(self, now: float) -> float:
        """When the newest packet was sent, s: one that this computer reads late is as much older.

        A clock of the controller that jumps, and a packet older than the longest silence, restart the comparison.
        """
        if self.stamp is None:
            return now
        at = self._clock.sent_at(self.stamp, now)
        if now - at > self._silent:
            self._clock = ArrivalClock()
            return self._clock.sent_at(self.stamp, now)
        return at
