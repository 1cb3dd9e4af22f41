"""Numbers and times of data packets, derived from the controller's clock."""

import math

from protocol.arrival_clock import ArrivalClock
from protocol.devices.rtde.profile import ClientProfile


class PacketClock:
    """Counter of the packets of a stream, which also estimates the time at which each packet was sent."""

    def __init__(self, profile: ClientProfile) -> None:
        self._cycle, self._silent = profile.cycle_s, profile.silent_ms / 1000.0
        self.number = 0
        self.stamp: float | None = None
        """Time stamp of the newest data packet on the controller's clock, s."""
        self._clock = ArrivalClock()

    def take(self, stamp: float) -> None:
        """Assign a number to the packet with this time stamp, by the controller's clock if the clock advances."""
        steps = 1
        if self.stamp is not None and math.isfinite(stamp) and stamp > self.stamp:
            steps = max(1, round(min((stamp - self.stamp) / self._cycle, 1e6)))
        self.stamp = stamp if math.isfinite(stamp) else self.stamp
        self.number += steps

    def sent_at(self, now: float) -> float:
        """Return the estimated time at which the newest packet was sent, s on the caller's clock.

        A packet that this computer reads late is correspondingly older. The comparison of the clocks restarts if
        the controller's clock jumps, or if a packet is older than the longest allowed silence.
        """
        if self.stamp is None:
            return now
        at = self._clock.sent_at(self.stamp, now)
        if now - at > self._silent:
            self._clock = ArrivalClock()
            return self._clock.sent_at(self.stamp, now)
        return at
