"""Wires of one device, combined into one transport."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AsyncExitStack, suppress
from functools import partial
from typing import Any, Generic, TypeVar

from hil_bridge.errors import TransportError
from hil_bridge.transports.base import Transport
from protocol.pieces import Piece

Port = TypeVar("Port", bound=str)


class Bundle(Generic[Port]):
    """`Transport` of pieces over several wires. It ends when its main wire ends; the device may close the others."""

    def __init__(
        self,
        name: str,
        wires: Mapping[Port, Transport[Any]],
        main: Port,
        farewell: Callable[[], Sequence[Piece[Port, Any]]] = tuple,
    ) -> None:
        """Combine the wires, which are started in this order. `farewell` returns the last data, which are sent
        before the wires are closed.
        """
        self.name = name
        self._wires, self._main, self._farewell = wires, main, farewell
        self._closing = False

    def start(
        self,
        on_data: Callable[[Sequence[Piece[Port, Any]]], None],
        on_end: Callable[[TransportError], None],
    ) -> None:
        for port, wire in self._wires.items():
            wire.start(partial(_forward, on_data, port), on_end if port == self._main else _ignore)

    def send(self, data: Sequence[Piece[Port, Any]]) -> None:
        for piece in data:
            if (wire := self._wires.get(piece.port)) is not None:
                wire.send(piece.data)

    async def aclose(self) -> None:
        if not self._closing:
            self._closing = True
            with suppress(TransportError):
                self.send(self._farewell())
        async with (
            AsyncExitStack() as stack
        ):  # close all wires, even if one cannot be closed or the wait is cancelled
            for wire in reversed([*self._wires.values()]):
                stack.push_async_callback(wire.aclose)


def _forward(on_data: Callable[[Sequence[Piece[Port, Any]]], None], port: Port, data: Any) -> None:
    on_data((Piece(port, data),))


def _ignore(error: TransportError) -> None:
    """Ignore the end of a wire. A client that needs the wire reports a time-out."""
