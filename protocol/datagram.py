"""One datagram and when it came. On a datagram wire an endpoint is given a sequence of `bytes`, each one whole."""

import math


class Datagram(bytes):
    """The payload of a datagram that was received; equal to the same bytes, whenever they came."""

    received_at: float
    """When it came, s on the receiver's clock: by the kernel's stamp where there is one. NaN: not known."""

    def __new__(
        cls, data: "bytes | bytearray | memoryview" = b"", received_at: float = math.nan
    ) -> "Datagram":
        """As `bytes`, with the time."""
        datagram = super().__new__(cls, data)
        datagram.received_at = received_at
        return datagram


def arrived_at(datagram: bytes, now: float) -> float:
    """When a datagram came, s: as its wire has stamped it, else `now`."""
    at = getattr(datagram, "received_at", math.nan)
    return now if math.isnan(at) else at
