"""Check, at the start of a stream, that the internal samples arrive at the configured rate.

The age of a force depends on this rate. A Net Box takes 7000 samples per second, an Axia takes another number.
"""

from collections import deque

from protocol.devices.netft.records import AXIA_RATES_HZ, INTERNAL_RATE_HZ

KNOWN_RATES_HZ = (INTERNAL_RATE_HZ, *AXIA_RATES_HZ)
"""Known internal sample rates, Hz. Source: manuals of the Net Box and of the Ethernet Axia."""
WINDOW_S = 0.2
"""Duration of a measurement window, s. Chosen."""
WINDOWS = 3
"""Number of consecutive windows that must agree before a different rate is accepted. Chosen: a delayed computer
produces some windows that do not agree.
"""
APART = 0.05
"""Relative difference from which a rate counts as a different rate. Chosen: the known rates differ by at least 11 %."""
_NEAR = 0.03
"""Relative difference within which measured rates agree with each other and with a known rate. Chosen."""


class RateWatch:
    """Measurement of the rate of the first samples of a stream."""

    def __init__(self, rate_hz: float) -> None:
        self._rate = rate_hz
        self._measured: deque[float] | None = None
        """Rates measured in the newest windows that deviate from the configured rate, Hz; None while no measurement
        is in progress.
        """
        self._since = (0, 0.0)
        """Sequence number and arrival time, s, of the sample with which the current window started."""

    def begin(self, sequence: int, at: float) -> None:
        """Begin the measurement with a sample that arrived at time `at`, s."""
        self._measured, self._since = deque(maxlen=WINDOWS), (sequence, at)

    def take(self, sequence: int, at: float) -> float | None:
        """Use a sample that arrived at time `at`, s. Return the measured rate, Hz, if it differs from the
        configured rate.
        """
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
    """Return the known rate that matches a measured rate, Hz; if none matches, the measured rate rounded to an
    integer.
    """
    nearest = min(KNOWN_RATES_HZ, key=lambda known: abs(known - rate_hz))
    return nearest if abs(nearest / rate_hz - 1.0) < _NEAR else round(rate_hz)
