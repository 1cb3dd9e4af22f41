"""A datagram with its arrival time and its peer. An endpoint on a datagram wire receives a sequence of `bytes`, one
for each datagram.
"""

import math
from collections.abc import Hashable


class Datagram(bytes):
    """Payload of a datagram. It compares equal to `bytes` with the same contents, regardless of its arrival time."""

    received_at: float
    """Arrival time on the receiver's clock, s: the kernel's time stamp if available. NaN if unknown."""
    side: Hashable
    """Address of the peer, in the form that the transport uses; None if unknown. A listening wire sends a datagram
    to this peer if the peer has sent to it before, and otherwise to the peer that sent most recently.
    """

    def __new__(
        cls,
        data: "bytes | bytearray | memoryview" = b"",
        received_at: float = math.nan,
        side: Hashable = None,
    ) -> "Datagram":
        """Create a datagram from `bytes`, an arrival time and a peer."""
        datagram = bytes.__new__(cls, data)
        datagram.received_at = received_at
        datagram.side = side
        return datagram


def arrived_at(datagram: bytes, now: float) -> float:
    """Return the arrival time of a datagram, s: its time stamp, or `now` if it has none."""
    at: float = getattr(datagram, "received_at", now)
    return at if at == at else now


def side_of(datagram: bytes) -> Hashable:
    """Return the peer that sent a datagram or that it is addressed to; None if the datagram names no peer."""
    side: Hashable = getattr(datagram, "side", None)
    return side
