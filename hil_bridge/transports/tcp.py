"""Bytes over TCP: a client, and a server for one client at a time.

No client holds the server's port for ever. One whose computer or cable is gone is found by TCP's own questions
(`KEEPALIVE`). One that has not sent a single byte for `SILENT_S` makes room as soon as another comes. One that has
spoken may be silent for as long as it likes: a robot's link has its pauses.
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
"""Chosen: a host that is there answers sooner."""

KEEPALIVE = {"TCP_KEEPIDLE": 5, "TCP_KEEPINTVL": 1, "TCP_KEEPCNT": 4}
"""A peer that has said nothing for 5 s is asked, once a second, and is gone after four questions. Chosen: a pulled
cable is noticed within 10 s even on a wire that only listens.
"""

BACKLOG = 64
"""Clients that wait to be accepted, when many begin at once. Chosen: with 1, a third one tries again after 1 s."""

_UNREAD_BYTES = 1 << 16
"""Chosen: what the operating system keeps for one of many clients, so that one that does not read is soon noticed; by
default it keeps millions of bytes.
"""

SILENT_S = 5.0
"""For how long a client that has not said anything has the port to itself. Chosen: what uses a link speaks at once."""


def keep_alive(connection: socket.socket) -> None:
    """Let the system find out that the peer is gone, as `KEEPALIVE` says."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for option, value in KEEPALIVE.items():
        if hasattr(socket, option):  # not every system lets a program choose
            connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)


async def connect_tcp(host: str, port: int, clock: Clock, name: str) -> Transport[bytes]:
    """Connect to a server, without Nagle's delay. Raises TransportUnavailable."""
    try:
        async with asyncio.timeout(CONNECT_TIMEOUT_S):
            found = await clock.loop.getaddrinfo(host, port, type=socket.SOCK_STREAM)
            family, kind, protocol, _, address = found[0]
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


def _as_it_is(wire: Transport[bytes]) -> Transport[bytes]:
    return wire


async def listen_tcp(
    host: str,
    port: int,
    clock: Clock,
    name: str,
    around: Callable[[Transport[bytes]], Transport[bytes]] = _as_it_is,
) -> tuple[Transport[bytes], str, int]:
    """Wait for clients, one at a time. A client that comes while another is there waits until that one has left. It
    takes that one's place where that one has been silent since it came.

    `around` makes the transport of a client out of its connection. Gives the transport, and the address and port
    that it really has. Raises TransportUnavailable.
    """
    server, here = await _listen(host, port, clock, name)
    return _Server(server, name, clock, around).exchange, here[0], here[1]


async def _listen(host: str, port: int, clock: Clock, name: str) -> tuple[socket.socket, Any]:
    """Return the listening socket and its address. Raises TransportUnavailable."""
    try:
        found = await clock.loop.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        server = _listening(found[0])
    except OSError as error:
        raise reasons.unavailable("tcp-listen", name, f"{host}:{port}", error) from error
    return server, server.getsockname()


async def listen_tcp_clients(
    host: str, port: int, clock: Clock, name: str, on_client: Callable[[Transport[bytes]], object]
) -> tuple[Callable[[], None], str, int]:
    """Wait for clients, any number at a time: `on_client` is given the transport of each, and closes it.

    Gives a function that ends the waiting, and the address and port that it really has. Raises TransportUnavailable.
    """
    server, here = await _listen(host, port, clock, name)

    def accept() -> None:
        try:
            connection, address = server.accept()
        except OSError:
            return  # it has gone again before we came to it
        connection.setblocking(False)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _UNREAD_BYTES)
        on_client(FileWire(name, _Connection(connection, f"{address[0]}:{address[1]}"), clock))

    def stop() -> None:
        if (listening := server.fileno()) >= 0:
            clock.loop.remove_reader(listening)
            server.close()

    clock.loop.add_reader(server.fileno(), accept)
    return stop, here[0], here[1]


def _listening(found: Any) -> socket.socket:
    """Return a socket that listens on one of the resolved addresses. Raises OSError."""
    family, kind, protocol, _, address = found
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
    """Accepts the next client when there is none."""

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
        """The client that is there, as long as it has not said anything."""
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
            return  # it has gone again before we came to it
        self._clock.loop.remove_reader(self._server.fileno())
        connection.setblocking(False)
        self._silent = connection
        self._timer = self._clock.call_at(self._clock.now() + SILENT_S, self._yield)
        wire = FileWire(self._name, _Connection(connection, f"{address[0]}:{address[1]}"), self._clock)
        self.exchange.attach(self._around(_FirstByteWatch(wire, self._settle)))

    def _settle(self) -> None:
        """Settle the port: it is the client's, or there is none any more."""
        self._silent = None
        if (listening := self._server.fileno()) >= 0:
            self._clock.loop.remove_reader(listening)
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _yield(self) -> None:
        """Let the next client take the place of the silent one, from now on."""
        self._clock.loop.add_reader(self._server.fileno(), self._make_room)

    def _make_room(self) -> None:
        self._clock.loop.remove_reader(self._server.fileno())
        if self._silent is not None:
            with suppress(OSError):
                self._silent.shutdown(socket.SHUT_RDWR)  # its wire sees the end of the stream, and leaves

    def _stop(self) -> None:
        self._settle()
        self._server.close()


class _FirstByteWatch:
    """A client's wire as it is, but that `on_first` is told of the first data."""

    __slots__ = ("_inner", "_on_first", "aclose", "name", "send")

    def __init__(self, wire: Transport[bytes], on_first: Callable[[], None]) -> None:
        self._inner = wire
        self.name, self.send, self.aclose = wire.name, wire.send, wire.aclose
        self._on_first: Callable[[], None] | None = on_first

    def start(self, on_data: Callable[[bytes], None], on_end: Callable[[TransportError], None]) -> None:
        """As the wire does."""

        def heard(data: bytes) -> None:
            if self._on_first is not None:
                first, self._on_first = self._on_first, None
                first()
            on_data(data)

        self._inner.start(heard, on_end)


class _Connection:
    """The file behind a TCP connection."""

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
