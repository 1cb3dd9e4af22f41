"""Base of transports that delay data on the way to and from an inner transport."""

from collections.abc import Callable
from typing import Generic

from hil_bridge.errors import TransportError
from hil_bridge.transports.base import Transport
from hil_bridge.transports.delivery import QUEUE_BYTES, Data, Delivery


class Around(Generic[Data]):
    """Transport that wraps another transport."""

    __slots__ = ("_delivery", "_inner")

    def __init__(self, transport: Transport[Data]) -> None:
        self._inner = transport
        self._delivery: Delivery[Data] = Delivery(transport.name, QUEUE_BYTES)

    @property
    def name(self) -> str:
        """Name of the wire."""
        return self._inner.name

    def start(self, on_data: Callable[[Data], None], on_end: Callable[[TransportError], None]) -> None:
        """Start this transport and the inner one."""
        self._delivery.start(on_data, on_end)
        self._inner.start(self._arrived, self._inner_ended)

    def _arrived(self, data: Data) -> None:
        """Handle data of the inner transport."""
        raise NotImplementedError

    def _inner_ended(self, error: TransportError) -> None:
        """Handle the end of the inner transport."""
        raise NotImplementedError

    def _leave(self, data: Data) -> None:
        """Send data to the inner transport. If that fails, handle the end of the inner transport."""
        try:
            self._inner.send(data)
        except TransportError as error:
            self._inner_ended(error)
