"""Port of an emulated URCap. The first clients share one stream of text; further clients wait."""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any

from hil_bridge.devices.wiring import Serving
from hil_bridge.errors import TransportError
from hil_bridge.transports import Transport
from hil_bridge.transports.memory import listen_memory_clients
from hil_bridge.transports.tcp import listen_tcp_clients
from hil_bridge.transports.urls import LISTEN_BYTES, parse_url

_WIRES = {scheme: replace(LISTEN_BYTES[scheme], options={}) for scheme in ("tcp-listen", "memory")}


async def serve_texts(url: str, server: Any, most: int, serving: Serving) -> str:
    """Let a URCap serve up to `most` clients at a time, and return the URL for a client. Raises ConfigError for an
    invalid URL, TransportUnavailable if the port cannot be opened.
    """
    parsed = parse_url(url, _WIRES)
    port = _Port(parsed.name, most, server.begin)
    if parsed.scheme == "memory":
        port.stop = listen_memory_clients(parsed.target, serving.clock, port.welcome)
        address = f"memory:{parsed.target}"
    else:
        host, number = parsed.host_port
        port.stop, host, number = await listen_tcp_clients(
            host, number, serving.clock, parsed.name, port.welcome
        )
        address = f"tcp://{f'[{host}]' if ':' in host else host}:{number}"
    serving.attach(server.endpoint, port)
    return address


class _Port:
    """`Transport` of bytes that combines the wires of all clients. Data from the clients are ignored."""

    stop: Callable[[], None]
    """Stops listening."""

    def __init__(self, name: str, most: int, on_first: Callable[[], object]) -> None:
        self.name = name
        self._most, self._on_first = most, on_first
        self._wires: list[Transport[bytes]] = []
        """Wires of the clients, in order of connection."""
        self._closing: set[asyncio.Task[None]] = set()

    def welcome(self, wire: Transport[bytes]) -> None:
        """Add a new client."""
        self._wires.append(wire)
        if len(self._wires) == 1:
            self._on_first()
        wire.start(lambda data: None, lambda error: self._left(wire))

    def start(self, on_data: Callable[[bytes], None], on_end: Callable[[TransportError], None]) -> None:
        """Do nothing, because a client that disconnects does not end the stream."""

    def send(self, data: bytes) -> None:
        for wire in self._wires[: self._most]:
            with suppress(TransportError):  # the client disconnects, or does not read
                wire.send(data)

    async def aclose(self) -> None:
        self.stop()
        wires, self._wires = self._wires, []
        for wire in wires:
            await wire.aclose()
        await asyncio.gather(*self._closing)

    def _left(self, wire: Transport[bytes]) -> None:
        if wire not in self._wires:
            return
        first = self._wires[0]
        self._wires.remove(wire)
        if self._wires and self._wires[0] is not first:
            self._on_first()
        task = asyncio.get_running_loop().create_task(wire.aclose())
        self._closing.add(task)
        task.add_done_callback(self._closing.discard)
