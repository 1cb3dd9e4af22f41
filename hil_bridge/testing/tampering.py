"""Tampered transport of the suites, which can be cut, alters data in both directions, and records whether it was
closed.
"""

from collections.abc import Callable, Sequence
from typing import Any

from hil_bridge.errors import TransportError
from hil_bridge.transports import Transport

Alter = Callable[[Any], Sequence[Any]]
"""Function that replaces an arrival by none, one or several other arrivals."""


class TamperedTransport:
    """Tampered transport between a client and its device."""

    def __init__(self, inner: Transport[Any]) -> None:
        self._inner = inner
        self.name = inner.name
        self.closed = False
        """Whether the client has closed the transport."""
        self.cut = False
        """Whether the cable is cut: nothing passes in either direction, and neither side is notified."""
        self.alter: Alter | None = None
        """Function that alters data from the device."""
        self.alter_sent: Alter | None = None
        """Function that alters data to the device."""
        self.arrivals: list[Any] = []
        """All arrivals from the device, unaltered."""
        self.deliver: Callable[[Any], None] = lambda data: None
        """Function that delivers data to the client as if it had arrived."""

    def start(self, on_data: Callable[[Any], None], on_end: Callable[[TransportError], None]) -> None:
        self.deliver = on_data
        self._inner.start(self._arrived, on_end)

    def send(self, data: Any) -> None:
        if self.cut:
            return
        for part in (data,) if self.alter_sent is None else self.alter_sent(data):
            if len(part):
                self._inner.send(part)

    async def aclose(self) -> None:
        self.closed = True
        await self._inner.aclose()

    def _arrived(self, data: Any) -> None:
        if self.cut:
            return
        self.arrivals.append(data)
        for part in (data,) if self.alter is None else self.alter(data):
            if len(part) and not self.closed:
                self.deliver(part)


def flipped(data: Any, bit: int) -> Any:
    """Flip one bit of the bytes, or of the first datagram; CAN frames are unchanged."""
    if isinstance(data, (bytes, bytearray)):
        changed = bytearray(data)
        changed[bit // 8 % len(changed)] ^= 1 << bit % 8
        return bytes(changed)
    if len(data) and isinstance(data[0], bytes) and data[0]:
        return [flipped(data[0], bit), *data[1:]]
    return data


def shortened(data: Any) -> Any:
    """Remove the last byte."""
    if isinstance(data, (bytes, bytearray)):
        return bytes(data[:-1])
    return [one[:-1] if isinstance(one, bytes) else one for one in data]


def garbage(data: Any) -> Any:
    """Return meaningless bytes or a meaningless datagram; for CAN frames return nothing."""
    noise = bytes(range(7, 250, 9))
    if isinstance(data, (bytes, bytearray)):
        return noise
    return [noise] if len(data) and isinstance(data[0], bytes) else data[:0]


def lengthened(data: Any) -> Any:
    """Append a byte."""
    if isinstance(data, (bytes, bytearray)):
        return bytes(data) + b"\0"
    return [bytes(one) + b"\0" if isinstance(one, bytes) else one for one in data]
