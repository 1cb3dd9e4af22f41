"""Listening side of wires whose clients may connect and disconnect."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Generic, TypeVar

from hil_bridge.errors import TransportError
from hil_bridge.transports.base import Transport
from hil_bridge.transports.delivery import QUEUE_BYTES, Delivery

Wire = TypeVar("Wire", covariant=True)


@dataclass(frozen=True, slots=True)
class Listening(Generic[Wire]):
    """Wire that waits for the other side."""

    transport: Wire
    """Transport that exists until it is closed, which also stops listening. Clients may connect and disconnect."""
    address: str
    """URL for a client."""


class Exchange:
    """Transport of a listener, connected to the present client.

    Bytes sent without a client are lost, as on an unplugged cable. `lost` counts them.
    """

    def __init__(self, name: str, free: Callable[[], None], stop: Callable[[], None]) -> None:
        self._delivery: Delivery[bytes] = Delivery(name, QUEUE_BYTES)
        self._client: Transport[bytes] | None = None
        self._started = False
        self._stopped = False
        self._free = free
        self._stop = stop
        self.lost = 0
        """Number of sent bytes that no client received."""

    @property
    def name(self) -> str:
        return self._delivery.name

    @property
    def busy(self) -> bool:
        """Whether a client is connected."""
        return self._client is not None

    def attach(self, client: Transport[bytes]) -> None:
        """Add a client."""
        self._client = client
        if self._started:
            client.start(self._delivery.data, self._left)

    def start(self, on_data: Callable[[bytes], None], on_end: Callable[[TransportError], None]) -> None:
        self._delivery.start(on_data, on_end)
        self._started = True
        if self._client is not None:
            self._client.start(self._delivery.data, self._left)

    def send(self, data: bytes) -> None:
        self._delivery.check()
        if self._client is None:
            self.lost += len(data)
            return
        try:
            self._client.send(data)
        except TransportError:
            self.lost += len(data)

    async def aclose(self) -> None:
        if not self._delivery.begin_close():
            return
        self._stopped = True
        self._stop()
        try:
            if self._client is not None:
                with suppress(TransportError):
                    await self._client.aclose()
        finally:
            self._delivery.closed()

    def _left(self, error: TransportError) -> None:
        self._client = None
        if not self._stopped:
            self._free()
