"""Register server on TCP for several clients of one board. No client can affect the other clients or the board.

No client blocks a slot forever. A client whose computer or cable has failed is detected by TCP keep-alive. If all
slots are occupied, a client that has not sent a single byte is replaced by the next one. A client that has sent a
request, and neither sends more nor streams, is dropped after `idle_timeout_s`. A client that does not read is
disconnected.
"""

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar

from hil_bridge.clock import Clock
from hil_bridge.errors import TransportBroken, TransportClosed, TransportEnded, TransportError
from hil_bridge.transports import reasons
from hil_bridge.transports.pump import Pump
from hil_bridge.transports.tcp import keep_alive
from protocol.devices.jr3.board import Registers
from protocol.devices.jr3.registers import (
    ConnectionOver,
    RegisterServer,
    RegisterServerProfile,
    Status,
    farewell,
)
from protocol.marks import Mark, between, check_settings, setting

_READ_BYTES = 4096
"""Number of bytes that are read at once. Chosen: the server answers at most 292 requests of a flooding client per
iteration of the event loop, then serves other clients.
"""
_HIGH_BYTES = 65536
"""Number of unread bytes at which reading from a client is suspended. Chosen."""
_BACKLOG_BYTES = 262144
"""Number of unread bytes at which a client is disconnected. Chosen: more than the answers to one read of the server."""
_FLUSH_S = 1.0
"""Time for which a closing connection sends queued data, s. Chosen."""


@dataclass(frozen=True)
class ListenerProfile:
    """Client limit of a register server, and settings for each client."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    clients: int = setting(8, Mark.CHOSEN, "clients at a time; a further one is rejected", between(1, 256))
    connection: RegisterServerProfile = field(default_factory=RegisterServerProfile)

    def __post_init__(self) -> None:
        check_settings(self)


class SharedRegisters:
    """Board shared by several connections. Their common time never runs backwards."""

    def __init__(self, registers: Registers) -> None:
        self._registers = registers
        self._latest = float("-inf")

    def read(self, address: int, count: int, now: float) -> tuple[int, ...]:
        """Return words as one snapshot. Raises RemoteProtocolError for an address outside the memory."""
        return self._registers.read(address, count, self._time(now))

    def burst(self, address: int, count: int, now: float) -> bytes:
        """Return words in the encoding of the wire. Raises RemoteProtocolError for an address outside the memory."""
        return self._registers.burst(address, count, self._time(now))

    def write(self, address: int, words: Sequence[int], now: float) -> None:
        """Write words in order of address. Raises RemoteProtocolError for an address outside the memory."""
        self._registers.write(address, words, self._time(now))

    def reset(self, now: float) -> None:
        """Restart the board. Raises ResetRefused if a reset is not allowed."""
        self._registers.reset(self._time(now))

    def load(self, address: int, words: Sequence[int], now: float) -> None:
        """Write instructions, or reset the board before a program is written if there are none. Raises
        RemoteProtocolError if the instructions cannot be loaded.
        """
        self._registers.load(address, words, self._time(now))

    def _time(self, now: float) -> float:
        # a deadline is handled at its own time, which may be a rounding step ahead of the clock
        self._latest = max(self._latest, now)
        return self._latest


class RegisterListener:
    """Listening register server. `on_log` receives one line for each connection that ends with an error."""

    def __init__(
        self, registers: Registers, profile: ListenerProfile, clock: Clock, on_log: Callable[[str], None]
    ) -> None:
        self._registers = SharedRegisters(registers)
        self._profile = profile
        self._clock = clock
        self._on_log = on_log
        self._server: asyncio.Server | None = None
        self._wires: dict[_ClientWire, None] = {}
        """Wires of the clients, in order of connection."""
        self._rejection_logged = False
        """Whether a client was rejected since the last client was accepted. Only the first of these rejections is
        logged.
        """

    @property
    def clients(self) -> int:
        """Number of connected clients."""
        return len(self._wires)

    async def listen(self, host: str, port: int, name: str) -> tuple[str, int]:
        """Start listening and return the actual address and port. Raises TransportUnavailable, which contains
        `name`, if the port cannot be opened.
        """
        try:
            self._server = await self._clock.loop.create_server(
                lambda: _ClientWire(self._arrived, self._gone), host, port
            )
        except OSError as error:
            raise reasons.unavailable("tcp-listen", name, f"{host}:{port}", error) from error
        address = self._server.sockets[0].getsockname()
        return address[0], address[1]

    async def aclose(self) -> None:
        """Stop listening and close every connection. Idempotent."""
        if self._server is not None:
            self._server.close()
        await asyncio.gather(*(wire.aclose() for wire in self._wires))

    def _gone(self, wire: "_ClientWire") -> None:
        self._wires.pop(wire, None)

    def _make_room(self) -> None:
        """Disconnect the first client that has not sent anything, if any."""
        silent = next((wire for wire in self._wires if not wire.has_sent), None)
        if silent is not None:
            self._on_log(f"{silent.name}: disconnected in favour of another client: it had not sent anything")
            self._gone(silent)
            silent.send(farewell(Status.TOO_MANY_CLIENTS))
            silent.close()

    def _arrived(self, wire: "_ClientWire") -> None:
        if len(self._wires) >= self._profile.clients:
            self._make_room()
        if len(self._wires) >= self._profile.clients:
            if not self._rejection_logged:
                self._rejection_logged = True
                self._on_log(f"{wire.name}: rejected, {self._profile.clients} clients are connected")
            wire.start(lambda data: None, lambda error: None)
            wire.send(farewell(Status.TOO_MANY_CLIENTS))
            wire.close()
            return
        self._wires[wire] = None
        self._rejection_logged = False
        now = self._clock.now()
        pump: Pump[bytes, ConnectionOver] = Pump(
            RegisterServer(self._registers, self._profile.connection, now),
            wire,
            self._clock,
            partial(self._over, wire),
            partial(self._ended, wire),
        )
        pump.start()

    def _over(self, wire: "_ClientWire", event: ConnectionOver) -> None:
        self._on_log(f"{wire.name}: connection closed: {event.text}")
        # the answer is sent first, at the end of this iteration of the loop
        self._clock.loop.call_soon(wire.close)

    def _ended(self, wire: "_ClientWire", cause: Exception) -> None:
        match cause:
            case TransportEnded() | TransportClosed():
                return
            case TransportError():
                self._on_log(str(cause))
            case _:
                self._on_log(f"{wire.name}: connection closed: {cause!r}")
        wire.abort()


class _ClientWire(asyncio.BufferedProtocol):
    """Connection to one client, as a transport for a pump."""

    def __init__(
        self, on_arrival: Callable[["_ClientWire"], None], on_gone: Callable[["_ClientWire"], None]
    ) -> None:
        self.name = ""
        self.has_sent = False
        """Whether anything was received from the client."""
        self._buffer = bytearray(_READ_BYTES)
        self._on_arrival = on_arrival
        self._on_gone = on_gone
        self._on_data: Callable[[bytes], None] = lambda data: None
        self._on_end: Callable[[TransportError], None] = lambda error: None
        self._gone = asyncio.Event()
        self._closing = False
        self._deadline: asyncio.TimerHandle | None = None

    # --- called by asyncio

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        transport.set_write_buffer_limits(high=_HIGH_BYTES)
        keep_alive(transport.get_extra_info("socket"))
        host, port = (transport.get_extra_info("peername") or ("client", 0))[:2]
        self.name = f"{host}:{port}"
        self._on_arrival(self)

    def get_buffer(self, sizehint: int) -> bytearray:
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        self.has_sent = True
        self._on_data(bytes(self._buffer[:nbytes]))

    def pause_writing(self) -> None:
        self._transport.pause_reading()

    def resume_writing(self) -> None:
        self._transport.resume_reading()

    def connection_lost(self, exc: Exception | None) -> None:
        self._gone.set()
        if self._deadline is not None:
            self._deadline.cancel()
        self._on_gone(self)
        if self._closing:
            self._on_end(TransportClosed(f"{self.name}: closed"))
        elif exc is None:
            self._on_end(TransportEnded(f"{self.name}: the client disconnected"))
        else:
            self._on_end(TransportBroken(f"{self.name}: connection failed: {exc}"))

    # --- called by the pump

    def start(self, on_data: Callable[[bytes], None], on_end: Callable[[TransportError], None]) -> None:
        self._on_data = on_data
        self._on_end = on_end

    def send(self, data: bytes) -> None:
        if self._closing or self._transport.is_closing():
            raise TransportClosed(f"{self.name}: closed")
        if self._transport.get_write_buffer_size() + len(data) > _BACKLOG_BYTES:
            raise TransportError(f"{self.name}: disconnected: it does not read its answers")
        self._transport.write(data)

    async def aclose(self) -> None:
        self.close()
        await self._gone.wait()

    def close(self) -> None:
        """Close the connection as soon as queued data are sent, at the latest after a second."""
        if not self._closing:
            self._closing = True
            self._transport.close()
            self._deadline = asyncio.get_running_loop().call_later(_FLUSH_S, self._transport.abort)

    def abort(self) -> None:
        """Close the connection without sending queued data."""
        self._closing = True
        self._transport.abort()
