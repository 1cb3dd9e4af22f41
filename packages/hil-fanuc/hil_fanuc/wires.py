"""Wires of one controller: addresses of its channels, the client's wires as one transport, and the emulator's ports.

| URL | channels |
|---|---|
| `udp://10.0.0.5` | Stream Motion at port 60015, the Remote Motion Interface at port 16001 |
| `udp://127.0.0.1:40000?rmi=40001` | both ports from the URL |
| `udp-bind://127.0.0.1:0` | the emulated controller, at free ports |
| `udp+memory:NAME` | in memory |
"""

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass
from itertools import groupby
from typing import Protocol

from hil_bridge.clock import Clock
from hil_bridge.devices.wiring import Serving, Wiring
from hil_bridge.errors import BridgeError, ConfigError, TransportError
from hil_bridge.transports import Datagrams, Transport
from hil_bridge.transports.urls import (
    CONNECT_DATAGRAMS,
    LISTEN_DATAGRAMS,
    parse_url,
    split_option,
    with_option,
)
from hil_fanuc import rmi
from hil_fanuc.channels import Channel, Ended, OpenSession, Piece, Pieces
from hil_fanuc.controller import FanucController
from hil_fanuc.rmi_server import Connection, Door

STREAM_PORT = 60015
OPTION = "rmi"
"""Option of a URL with the port of the first door."""
_MEMORY = "udp+memory:"
REST_S = 1.0
"""Longest wait for the arm to come to rest before the session is ended, s. Derived: that of the maker's client."""


@dataclass(frozen=True, slots=True)
class Address:
    """Addresses of a controller's channels."""

    stream: str
    """URL of the datagrams."""
    host: str
    """Host in the notation of a URL; the name in memory."""
    door: int
    """Port of the first door."""

    def line_url(self, port: int) -> str:
        """Return the URL of a connection of the Remote Motion Interface."""
        if self.stream.startswith(_MEMORY):
            return f"memory:{self.host}-rmi-{port}"
        return f"tcp://{self.host}:{port}"


def parse_address(url: str, listens: bool = False) -> Address:
    """Parse the URL of a controller. Raises ConfigError if it is invalid."""
    stream, text = split_option(url, OPTION)
    if not stream.startswith(_MEMORY) and not stream.rpartition(":")[2].partition("?")[0].isdigit():
        head, mark, options = stream.partition("?")
        stream = f"{head}:{STREAM_PORT}{mark}{options}"
    parsed = parse_url(stream, LISTEN_DATAGRAMS if listens else CONNECT_DATAGRAMS)
    usual = f"{rmi.PORT}"
    if text is not None and not (text.isascii() and text.isdigit() and int(text[:9]) <= 65535):
        raise ConfigError(f"{url!r}: {OPTION} must be a TCP port, got {text!r}")
    if stream.startswith(_MEMORY):
        return Address(stream, parsed.target, rmi.PORT)
    host, port = parsed.host_port
    if listens and text is None and port == 0:
        usual = "0"
    return Address(stream, f"[{host}]" if ":" in host else host, int(text or usual))


class Leaving(Protocol):
    """Part of a client that ends its session."""

    @property
    def is_at_rest(self) -> bool:
        """Whether the controller has reported that the arm does not move."""

    def leave(self) -> Pieces:
        """Return the data that end the movement."""

    def farewell(self) -> Pieces:
        """Return the data that end the session, once the arm is at rest."""


class RobotWires:
    """`Transport` of pieces over the client's wires. It ends when the wire of the datagrams ends."""

    def __init__(
        self,
        name: str,
        stream: Transport[Datagrams],
        door: Transport[bytes],
        connect: Callable[[int], Awaitable[Transport[bytes]]],
        clock: Clock,
    ) -> None:
        """Combine the wires. `connect` opens the second connection of the Remote Motion Interface, at a port."""
        self.name = name
        self._stream, self._door, self._connect, self._clock = stream, door, connect, clock
        self._session: Transport[bytes] | None = None
        self._opening: asyncio.Task[None] | None = None
        self._unsent: list[bytes] = []
        """Lines for the second connection, which is not open yet."""
        self._on_data: Callable[[Pieces], None] = _ignore
        self._is_closed = False
        self._is_at_rest = asyncio.Event()
        self.client: Leaving | None = None
        """Client that says what is sent before the wires are closed."""

    def start(self, on_data: Callable[[Pieces], None], on_end: Callable[[TransportError], None]) -> None:
        self._on_data = on_data

        def receive(data: Datagrams) -> None:
            on_data([Piece(Channel.STREAM, datagram) for datagram in data])
            if self.client is not None and self.client.is_at_rest:
                self._is_at_rest.set()

        self._stream.start(receive, on_end)
        self._begin(Channel.DOOR, self._door)

    def _begin(self, channel: Channel, wire: Transport[bytes]) -> None:
        wire.start(
            lambda data: self._on_data((Piece(channel, data),)),
            lambda error: self._on_data(() if self._is_closed else (Ended(channel, str(error)),)),
        )

    def send(self, data: Pieces) -> None:
        for channel, pieces in groupby(data, _channel_of):
            for_wire = [piece.data for piece in pieces if isinstance(piece, Piece)]
            if channel is Channel.STREAM:
                self._stream.send(for_wire)
            elif channel is Channel.DOOR:
                self._send_lines(self._door, for_wire)
            elif channel is Channel.SESSION:
                self._send_lines(self._session, for_wire)
        for piece in data:
            if isinstance(piece, OpenSession) and self._opening is None:
                self._opening = self._clock.loop.create_task(self._open(piece.port))

    def _send_lines(self, wire: Transport[bytes] | None, lines: list[bytes]) -> None:
        if wire is None:
            self._unsent += lines
            return
        with suppress(TransportError):  # its end has been reported
            wire.send(b"".join(lines))

    async def _open(self, port: int) -> None:
        try:
            wire = await self._connect(port)
        except BridgeError as error:
            self._on_data((Ended(Channel.SESSION, str(error)),))
            return
        if self._is_closed:
            await wire.aclose()
            return
        self._session = wire
        self._begin(Channel.SESSION, wire)
        self._send_lines(wire, self._unsent)
        self._unsent = []

    async def _leave(self, client: "Leaving") -> None:
        """End the movement, wait until the arm is at rest, and end the session."""
        try:
            with suppress(TransportError):
                self.send(client.leave())
                self._is_at_rest.clear()
                if not client.is_at_rest:
                    with suppress(TimeoutError):
                        async with asyncio.timeout(REST_S):
                            await self._is_at_rest.wait()
        finally:
            with suppress(TransportError):
                self.send(client.farewell())

    async def aclose(self) -> None:
        if self._is_closed:
            return
        self._is_closed = True
        try:
            if self._session is not None and self.client is not None:
                await self._leave(self.client)
        finally:
            await self._close()

    async def _close(self) -> None:
        """Close all connections, even if the wait for the arm was cancelled."""
        if self._opening is not None and not self._opening.done():
            self._opening.cancel()
            with suppress(asyncio.CancelledError):
                await self._opening
        try:
            if self._session is not None:
                await self._session.aclose()
        finally:
            try:
                await self._door.aclose()
            finally:
                await self._stream.aclose()


def _channel_of(piece: Piece | OpenSession | Ended) -> Channel | None:
    return piece.channel if isinstance(piece, Piece) else None


def _ignore(data: Pieces) -> None:
    """Ignore data before the start."""


async def connect_wires(url: str, wiring: Wiring) -> RobotWires:
    """Open the wires of a client. Raises ConfigError for an invalid URL, TransportUnavailable if a wire cannot be
    opened.
    """
    address = parse_address(url)
    stream = await wiring.datagrams(address.stream)
    try:
        door = await wiring.bytes(address.line_url(address.door))
    except BaseException:
        await stream.aclose()
        raise
    return RobotWires(url, stream, door, lambda port: wiring.bytes(address.line_url(port)), wiring.clock)


async def serve_robot(url: str, robot: FanucController, serving: Serving) -> str:
    """Let an emulated controller listen, and return the URL for its client."""
    address = parse_address(url, listens=True)
    door = await serving.serve_clients(
        _listening(address, address.door), lambda wire, now: Door(robot.interface)
    )
    port = 0 if address.door != rmi.PORT else rmi.SESSION_PORT
    session = await serving.serve_clients(
        _listening(address, port), lambda wire, now: Connection(robot.interface, now)
    )
    stream = await serving.serve_datagrams(address.stream, robot.endpoint)
    if address.stream.startswith(_MEMORY):
        return stream
    robot.interface.port = int(session.rpartition(":")[2])
    number = door.rpartition(":")[2]
    return stream if number == f"{rmi.PORT}" else with_option(stream, OPTION, number)


def _listening(address: Address, port: int) -> str:
    return address.line_url(port).replace("tcp://", "tcp-listen://", 1)
