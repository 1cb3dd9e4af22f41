"""Watches at the begin of a stream whether its internal samples come at the rate that the client was given.

The age of a force hangs on this rate: a Net Box takes 7000 samples a second, an Axia another number.
"""

from protocol.devices.netft.records import AXIA_RATES_HZ, INTERNAL_RATE_HZ

KNOWN_RATES_HZ = (INTERNAL_RATE_HZ, *AXIA_RATES_HZ)
"""Source: manuals of the Net Box and of the Ethernet Axia."""
WINDOW_S = 0.2
"""Chosen: length of a look at the stream."""
WINDOWS = 3
"""Chosen: looks in a row that agree before another rate is believed; a packet that is late makes one."""
APART = 0.05
"""Chosen: part by which another rate differs; the known ones are 11 % apart at least."""
_NEAR = 0.03
"""Chosen: part within which a rate that was measured is taken for a known one."""


class RateWatch:
    """Looks at the first samples of a stream, then no more."""

    def __init__(self, rate_hz: float) -> None:
        self._rate = rate_hz
        self._left = 0
        """Looks that are still to come."""
        self._since = (0, 0.0)
        """Sample and time, s, at which the present look began."""

    def begin(self, sequence: int, at: float) -> None:
        """A stream begins with this sample, which came at this time, s."""
        self._left, self._since = WINDOWS, (sequence, at)

    def take(self, sequence: int, at: float) -> float | None:
        """Look at a sample and its arrival, s; the rate where it is another, Hz."""
        if not self._left or at - self._since[1] < WINDOW_S:
            return None
        rate = (sequence - self._since[0]) / (at - self._since[1])
        self._left = self._left - 1 if abs(rate / self._rate - 1.0) > APART else 0
        self._since = sequence, at
        return rate if abs(rate / self._rate - 1.0) > APART and not self._left else None


def nearest_known(rate_hz: float) -> float:
    """The known rate that was measured so, Hz; else this one in whole numbers."""
    nearest = min(KNOWN_RATES_HZ, key=lambda known: abs(known - rate_hz))
    return nearest if abs(nearest / rate_hz - 1.0) < _NEAR else round(rate_hz)
