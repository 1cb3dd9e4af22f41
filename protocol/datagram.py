"""One datagram, when it came and from which side. On a datagram wire an endpoint is given a sequence of `bytes`, each
one whole.
"""

import math
from collections.abc import Hashable


class Datagram(bytes):
    """The payload of a datagram; equal to the same bytes, whenever they came."""

    received_at: float
    """When it came, s on the receiver's clock: by the kernel's stamp where there is one. NaN: not known."""
    side: Hashable
    """The address that it came from, as its wire knows it; None: not known. A wire that listens sends a datagram to the
    side that it names, if that one has spoken to it, and every other one to the side that spoke last.
    """

    def __new__(
        cls,
        data: "bytes | bytearray | memoryview" = b"",
        received_at: float = math.nan,
        side: Hashable = None,
    ) -> "Datagram":
        """As `bytes`, with the time and the side."""
        datagram = super().__new__(cls, data)
        datagram.received_at = received_at
        datagram.side = side
        return datagram


def arrived_at(datagram: bytes, now: float) -> float:
    """When a datagram came, s: as its wire has stamped it, else `now`."""
    at = getattr(datagram, "received_at", math.nan)
    return now if math.isnan(at) else at


def side_of(datagram: bytes) -> Hashable:
    """Return the peer that a datagram came from, or is for; None if it names none."""
    side: Hashable = getattr(datagram, "side", None)
    return side
