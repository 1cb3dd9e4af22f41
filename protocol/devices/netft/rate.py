"""Watches at the begin of a stream whether its internal samples come at the rate that the client was given.

The age of a force hangs on this rate: a Net Box takes 7000 samples a second, an Axia another number.
"""

from collections import deque

from protocol.devices.netft.records import AXIA_RATES_HZ, INTERNAL_RATE_HZ

KNOWN_RATES_HZ = (INTERNAL_RATE_HZ, *AXIA_RATES_HZ)
"""Source: manuals of the Net Box and of the Ethernet Axia."""
WINDOW_S = 0.2
"""Chosen: length of a look at the stream."""
WINDOWS = 3
"""Chosen: looks in a row that agree before another rate is believed; a computer that is late makes some that differ."""
APART = 0.05
"""Chosen: part by which another rate differs; the known ones are 11 % apart at least."""
_NEAR = 0.03
"""Chosen: part within which measured rates agree, and one is taken for a known one."""


class RateWatch:
    """Looks at the first samples of a stream, then no more."""

    def __init__(self, rate_hz: float) -> None:
        self._rate = rate_hz
        self._measured: deque[float] | None = None
        """Other rates of the newest looks; None while it does not look."""
        self._since = (0, 0.0)
        """Sample and time, s, at which the present look began."""

    def begin(self, sequence: int, at: float) -> None:
        """Begin a stream with this sample, received at this time, s."""
        self._measured, self._since = deque(maxlen=WINDOWS), (sequence, at)

    def take(self, sequence: int, at: float) -> float | None:
        """Look at a sample and its arrival, s; the rate where it is another, Hz."""
        begin, began_at = self._since
        if self._measured is None or at - began_at < WINDOW_S:
            return None
        rate, self._since = (sequence - begin) / (at - began_at), (sequence, at)
        if abs(rate / self._rate - 1.0) <= APART:
            self._measured = None
            return None
        self._measured.append(rate)
        agree = max(self._measured) <= min(self._measured) * (1.0 + _NEAR)
        if len(self._measured) < WINDOWS or not agree:
            return None
        self._measured = None
        return rate


def nearest_known(rate_hz: float) -> float:
    """Return the known rate that measures as this one, Hz, or this rate rounded to a whole number."""
    nearest = min(KNOWN_RATES_HZ, key=lambda known: abs(known - rate_hz))
    return nearest if abs(nearest / rate_hz - 1.0) < _NEAR else round(rate_hz)
