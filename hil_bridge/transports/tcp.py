"""Bytes over TCP: a client, and a server for one client at a time.

No client holds the server's port forever. A client whose computer or cable has failed is detected by TCP keep-alive
(`KEEPALIVE`). A client that has not sent a single byte for `SILENT_S` is replaced as soon as another one connects.
A client that has sent data may be silent indefinitely, because the link of a robot has pauses.
"""

import asyncio
import socket
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from hil_bridge.clock import Clock, Timer
from hil_bridge.errors import TransportEnded, TransportError
from hil_bridge.transports import reasons
from hil_bridge.transports.base import Transport
from hil_bridge.transports.listening import Exchange
from hil_bridge.transports.serial.files import FileWire

CONNECT_TIMEOUT_S = 5.0
"""Time-out for connecting, s. Chosen: a reachable host answers sooner."""

KEEPALIVE = {"TCP_KEEPIDLE": 5, "TCP_KEEPINTVL": 1, "TCP_KEEPCNT": 4}
"""Socket options of TCP keep-alive. A peer that has been silent for 5 s is probed once a second, and counts as gone
after four probes. Chosen: an unplugged cable is detected within 10 s even on a wire that only receives.
"""

BACKLOG = 64
"""Number of clients that can wait to be accepted, if many connect at once. Chosen: with 1, a third client retries
after 1 s.
"""

_UNREAD_BYTES = 1 << 16
"""Send buffer of the operating system for each of many clients, bytes. Chosen: a client that does not read is soon
detected; the default is millions of bytes.
"""

SILENT_S = 5.0
"""Time for which a client that sends no data keeps the port, s. Chosen: users of a link send at once."""


def keep_alive(connection: socket.socket) -> None:
    """Let the operating system detect that the peer is gone; see `KEEPALIVE`."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for option, value in KEEPALIVE.items():
        if hasattr(socket, option):  # not every system has these options
            connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)


async def connect_tcp(host: str, port: int, clock: Clock, name: str) -> Transport[bytes]:
    """Connect to a server, without Nagle's delay. Raises TransportUnavailable if the server cannot be reached."""
    try:
        async with asyncio.timeout(CONNECT_TIMEOUT_S):
            resolved = await clock.loop.getaddrinfo(host, port, type=socket.SOCK_STREAM)
            family, kind, protocol, _, address = resolved[0]
            connection = socket.socket(family, kind, protocol)
            try:
                connection.setblocking(False)
                await clock.loop.sock_connect(connection, address)
            except BaseException:
                connection.close()
                raise
    except OSError as error:
        raise reasons.unavailable("tcp", name, f"{host}:{port}", error) from error
    return FileWire(name, _Connection(connection, name), clock)


def _unwrap(wire: Transport[bytes]) -> Transport[bytes]:
    return wire


async def listen_tcp(
    host: str,
    port: int,
    clock: Clock,
    name: str,
    around: Callable[[Transport[bytes]], Transport[bytes]] = _unwrap,
) -> tuple[Transport[bytes], str, int]:
    """Wait for clients, one at a time. A new client waits until the present client has left. It replaces the
    present client if that client has been silent since it connected.

    `around` wraps the connection of a client. Return the transport, and the actual address and port. Raises
    TransportUnavailable if the port cannot be opened.
    """
    server, here = await _listen(host, port, clock, name)
    return _Server(server, name, clock, around).exchange, here[0], here[1]


async def _listen(host: str, port: int, clock: Clock, name: str) -> tuple[socket.socket, Any]:
    """Open the listening socket and return it with its address. Raises TransportUnavailable if the port cannot be
    opened.
    """
    try:
        resolved = await clock.loop.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        server = _open_listener(resolved[0])
    except OSError as error:
        raise reasons.unavailable("tcp-listen", name, f"{host}:{port}", error) from error
    return server, server.getsockname()


async def listen_tcp_clients(
    host: str, port: int, clock: Clock, name: str, on_client: Callable[[Transport[bytes]], object]
) -> tuple[Callable[[], None], str, int]:
    """Wait for any number of clients. `on_client` receives the transport of each client and closes it.

    Return a function that stops listening, and the actual address and port. Raises TransportUnavailable if the port
    cannot be opened.
    """
    server, here = await _listen(host, port, clock, name)

    def accept() -> None:
        try:
            connection, address = server.accept()
        except OSError:
            return  # the client disconnected before it was accepted
        connection.setblocking(False)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _UNREAD_BYTES)
        file = _Connection(connection, f"{address[0]}:{address[1]}")
        on_client(FileWire(name, file, clock, address[0]))

    def stop() -> None:
        if (listening := server.fileno()) >= 0:
            clock.loop.remove_reader(listening)
            server.close()

    clock.loop.add_reader(server.fileno(), accept)
    return stop, here[0], here[1]


def peer_of(wire: Transport[bytes]) -> str:
    """Return the host of the client of a wire of `listen_tcp_clients`; "" for any other wire."""
    return wire.peer if isinstance(wire, FileWire) else ""


def _open_listener(resolved: Any) -> socket.socket:
    """Open a socket that listens on a resolved address. Raises OSError if that fails."""
    family, kind, protocol, _, address = resolved
    server = socket.socket(family, kind, protocol)
    try:
        server.setblocking(False)
        server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        server.bind(address)
        server.listen(BACKLOG)
    except BaseException:
        server.close()
        raise
    return server


class _Server:
    """Server that accepts the next client when no client is connected."""

    def __init__(
        self,
        server: socket.socket,
        name: str,
        clock: Clock,
        around: Callable[[Transport[bytes]], Transport[bytes]],
    ) -> None:
        self._server = server
        self._around = around
        self._clock = clock
        self._name = name
        self._silent: socket.socket | None = None
        """Socket of the present client while it has not sent anything; otherwise None."""
        self._timer: Timer | None = None
        self.exchange = Exchange(name, self._wait, self._stop)
        self._wait()

    def _wait(self) -> None:
        self._settle()
        self._clock.loop.add_reader(self._server.fileno(), self._accept)

    def _accept(self) -> None:
        try:
            connection, address = self._server.accept()
        except OSError:
            return  # the client disconnected before it was accepted
        self._clock.loop.remove_reader(self._server.fileno())
        connection.setblocking(False)
        self._silent = connection
        self._timer = self._clock.call_at(self._clock.now() + SILENT_S, self._yield)
        wire = FileWire(self._name, _Connection(connection, f"{address[0]}:{address[1]}"), self._clock)
        self.exchange.attach(self._around(_FirstByteWatch(wire, self._settle)))

    def _settle(self) -> None:
        """End the wait for the first data. Either the client has sent data and keeps the port, or there is no
        client.
        """
        self._silent = None
        if (listening := self._server.fileno()) >= 0:
            self._clock.loop.remove_reader(listening)
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _yield(self) -> None:
        """Let the next client replace the silent client from now on."""
        self._clock.loop.add_reader(self._server.fileno(), self._make_room)

    def _make_room(self) -> None:
        self._clock.loop.remove_reader(self._server.fileno())
        if self._silent is not None:
            with suppress(OSError):
                self._silent.shutdown(socket.SHUT_RDWR)  # its wire receives the end of the stream, and ends

    def _stop(self) -> None:
        self._settle()
        self._server.close()


class _FirstByteWatch:
    """Wire of a client that calls back on its first data."""

    __slots__ = ("_inner", "_on_first", "aclose", "name", "send")

    def __init__(self, wire: Transport[bytes], on_first: Callable[[], None]) -> None:
        self._inner = wire
        self.name, self.send, self.aclose = wire.name, wire.send, wire.aclose
        self._on_first: Callable[[], None] | None = on_first

    def start(self, on_data: Callable[[bytes], None], on_end: Callable[[TransportError], None]) -> None:
        """Start the wire; see `Transport.start`."""

        def received(data: bytes) -> None:
            if self._on_first is not None:
                first, self._on_first = self._on_first, None
                first()
            on_data(data)

        self._inner.start(received, on_end)


class _Connection:
    """File of a TCP connection."""

    def __init__(self, connection: socket.socket, name: str) -> None:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        keep_alive(connection)
        self._connection = connection
        self._name = name
        self.fd = connection.fileno()

    def unsent(self) -> bool:
        return False

    def close(self) -> None:
        with suppress(OSError):
            self._connection.shutdown(socket.SHUT_WR)
        self._connection.close()

    def at_end(self) -> TransportError:
        return TransportEnded(f"{self._name}: the other side closed the connection")

    def broken(self, error: OSError) -> TransportError:
        return reasons.broken("tcp", self._name, self._name, error)
