"""Bytes over TCP: a client, and a server for one client at a time."""

import asyncio
import socket
from collections.abc import Callable
from contextlib import suppress

from hil_bridge.clock import Clock
from hil_bridge.errors import TransportEnded, TransportError
from hil_bridge.transports import reasons
from hil_bridge.transports.base import Transport
from hil_bridge.transports.files import FileWire
from hil_bridge.transports.listening import Exchange

CONNECT_TIMEOUT_S = 5.0
"""Chosen: a host that is there answers sooner."""

KEEPALIVE = {"TCP_KEEPIDLE": 5, "TCP_KEEPINTVL": 1, "TCP_KEEPCNT": 4}
"""A peer that has said nothing for 5 s is asked, once a second, and is gone after four questions. Chosen: a pulled
cable is noticed within 10 s even on a wire that only listens.
"""


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
    """Wait for clients, one at a time: who comes while another is there waits until that one has left.

    `around` makes the transport of a client out of its connection. Gives the transport, and the address and port
    that it really has. Raises TransportUnavailable.
    """
    try:
        found = await clock.loop.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        family, kind, protocol, _, address = found[0]
        server = socket.socket(family, kind, protocol)
        try:
            server.setblocking(False)
            server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            server.bind(address)
            server.listen(1)
        except BaseException:
            server.close()
            raise
    except OSError as error:
        raise reasons.unavailable("tcp-listen", name, f"{host}:{port}", error) from error
    here = server.getsockname()
    return _Server(server, name, clock, around).exchange, here[0], here[1]


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
        self.exchange = Exchange(name, self._wait, self._stop)
        self._wait()

    def _wait(self) -> None:
        self._clock.loop.add_reader(self._server.fileno(), self._accept)

    def _accept(self) -> None:
        try:
            connection, address = self._server.accept()
        except OSError:
            return  # it has gone again before we came to it
        self._clock.loop.remove_reader(self._server.fileno())
        connection.setblocking(False)
        wire = FileWire(self._name, _Connection(connection, f"{address[0]}:{address[1]}"), self._clock)
        self.exchange.attach(self._around(wire))

    def _stop(self) -> None:
        self._clock.loop.remove_reader(self._server.fileno())
        self._server.close()


class _Connection:
    """The file behind a TCP connection."""

    def __init__(self, connection: socket.socket, name: str) -> None:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in KEEPALIVE.items():
            if hasattr(socket, option):  # not every system lets a program choose
                connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)
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
