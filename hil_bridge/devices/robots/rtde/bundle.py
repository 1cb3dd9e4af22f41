"""Wires of one controller, combined into one transport."""

from collections.abc import Callable, Mapping
from contextlib import AsyncExitStack, suppress
from functools import partial

from hil_bridge.errors import TransportError
from hil_bridge.transports import Transport
from protocol.devices.rtde.wires import Piece, Pieces, Port


class Bundle:
    """`Transport` over several wires. It ends when the RTDE wire ends; the controller may close the other wires."""

    def __init__(
        self, name: str, wires: Mapping[Port, Transport[bytes]], farewell: Callable[[], Pieces]
    ) -> None:
        """Combine the wires. `farewell` returns the last data, which are sent before the wires are closed."""
        self.name = name
        self._wires, self._farewell = wires, farewell
        self._closing = False

    def start(self, on_data: Callable[[Pieces], None], on_end: Callable[[TransportError], None]) -> None:
        for port, wire in self._wires.items():
            wire.start(partial(_forward, on_data, port), on_end if port is Port.RTDE else _ignore)

    def send(self, data: Pieces) -> None:
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


def _forward(on_data: Callable[[Pieces], None], port: Port, data: bytes) -> None:
    on_data((Piece(port, data),))


def _ignore(error: TransportError) -> None:
    """Ignore the end of a wire. A client that needs the wire reports a time-out."""
