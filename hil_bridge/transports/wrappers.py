"""Tap on a transport, for the recorder."""

from collections.abc import Callable, Sized
from enum import StrEnum
from typing import Generic, TypeVar

from hil_bridge.errors import TransportError
from hil_bridge.transports.base import Transport

Data = TypeVar("Data", bound=Sized)


class Direction(StrEnum):
    """Direction of data, relative to the side that holds the transport."""

    RECEIVED = "rx"
    SENT = "tx"


_SENT = Direction.SENT


class Tap(Generic[Data]):
    """Transport that passes all traffic to `on_traffic(direction, data)`: sent data once the wire has accepted it,
    received data before it is delivered. Exceptions of `on_traffic` propagate to the sender or to the receiving
    wire.
    """

    __slots__ = ("_inner", "_on_traffic")

    def __init__(self, transport: Transport[Data], on_traffic: Callable[[Direction, Data], object]) -> None:
        self._inner = transport
        self._on_traffic = on_traffic

    @property
    def name(self) -> str:
        return self._inner.name

    def start(self, on_data: Callable[[Data], None], on_end: Callable[[TransportError], None]) -> None:
        def arrived(data: Data) -> None:
            on_traffic(received, data)
            on_data(data)

        on_traffic, received = self._on_traffic, Direction.RECEIVED

        self._inner.start(arrived, on_end)

    def send(self, data: Data) -> None:
        self._inner.send(data)
        if len(data):
            self._on_traffic(_SENT, data)

    async def aclose(self) -> None:
        await self._inner.aclose()
