"""The panel's server on loopback: several clients, one request of one client a turn of the event loop.

There is no password, so it listens on this computer alone: whoever is elsewhere brings a tunnel. Whoever says
something that is no request is sent away, a browser that was lured here among them.
"""

import asyncio
import ipaddress
from collections.abc import Callable, Mapping
from typing import Any

from hil_bridge.clock import Clock
from hil_bridge.errors import ConfigError
from hil_bridge.panel.messages import REQUEST_LIMIT, decode, encode
from hil_bridge.transports import reasons
from hil_bridge.transports.urls import LISTEN_BYTES, parse_url

CLIENT_LIMIT = 8
"""Clients at a time; the next is told so. Mark: chosen."""
_HIGH_BYTES = 65536
"""Chosen: with so much unread by a client, nothing more is read from it."""

_SCHEMES = {"tcp-listen": LISTEN_BYTES["tcp-listen"]}


def panel_address(url: str) -> tuple[str, int]:
    """Host and port of a panel's URL. Raises ConfigError for all but tcp-listen on loopback."""
    wire = parse_url(url, _SCHEMES)
    host, port = wire.host_port
    if wire.options:
        raise ConfigError(f"{url!r}: a panel's URL takes no options")
    if not _is_loopback(host):
        raise ConfigError(
            f"{url!r}: the panel has no password and listens on this computer alone; use 127.0.0.1"
        )
    return host, port


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


class PanelServer:
    """Gives requests to `perform` and what it returns back; a ValueError of it is told to who asked."""

    def __init__(self, perform: Callable[[Mapping[str, Any]], Mapping[str, Any]], clock: Clock) -> None:
        self._perform = perform
        self._clock = clock
        self._server: asyncio.Server | None = None
        self._clients: set[_Client] = set()

    async def listen(self, url: str) -> str:
        """Begin; the URL that a client asks. Raises ConfigError for the URL, TransportUnavailable for the port."""
        host, port = panel_address(url)
        try:
            self._server = await self._clock.loop.create_server(lambda: _Client(self), host, port)
        except OSError as error:
            raise reasons.unavailable("tcp-listen", url, f"{host}:{port}", error) from error
        at, number = self._server.sockets[0].getsockname()[:2]
        return f"tcp://[{at}]:{number}" if ":" in at else f"tcp://{at}:{number}"

    async def aclose(self) -> None:
        """Stop listening and send everybody away. Harmless when called again."""
        if self._server is not None:
            self._server.close()
        clients = tuple(self._clients)
        for client in clients:
            client.abort()
        await asyncio.gather(*(client.gone.wait() for client in clients))

    def admit(self, client: "_Client") -> bool:
        """Whether there is room for one more."""
        if len(self._clients) >= CLIENT_LIMIT:
            return False
        self._clients.add(client)
        return True

    def forget(self, client: "_Client") -> None:
        """A client has left."""
        self._clients.discard(client)

    def answer(self, line: bytes) -> tuple[bytes, bool]:
        """The answer to a line, and whether it was a request at all."""
        try:
            request = decode(line)
        except ValueError as error:
            return encode({"error": str(error)}), False
        try:
            return encode(self._perform(request)), True
        except ValueError as error:
            return encode({"error": str(error)}), True


class _Client(asyncio.BufferedProtocol):
    """One connection."""

    def __init__(self, server: PanelServer) -> None:
        self.gone = asyncio.Event()
        self._server = server
        self._buffer = bytearray(REQUEST_LIMIT)
        self._pending = b""
        self._full = False
        """It does not read what it asked for."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        transport.set_write_buffer_limits(high=_HIGH_BYTES)
        if not self._server.admit(self):
            self._refuse(f"{CLIENT_LIMIT} clients are here already")

    def get_buffer(self, sizehint: int) -> bytearray:
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        self._pending += self._buffer[:nbytes]
        self._turn()

    def pause_writing(self) -> None:
        self._full = True

    def resume_writing(self) -> None:
        self._full = False
        self._turn()

    def connection_lost(self, exc: Exception | None) -> None:
        self._server.forget(self)
        self.gone.set()

    def abort(self) -> None:
        """Close without handing anything over."""
        self._transport.abort()

    def _turn(self) -> None:
        """Answer one request; more of them wait until the loop has looked after everything else."""
        if self._transport.is_closing():
            return
        line, end, rest = self._pending.partition(b"\n")
        if not end or len(line) > REQUEST_LIMIT:
            if len(self._pending) > REQUEST_LIMIT:
                self._refuse(f"a request has at most {REQUEST_LIMIT} bytes")
            else:
                self._transport.resume_reading()
            return
        self._transport.pause_reading()
        if self._full:
            return
        self._pending = rest
        answer, understood = self._server.answer(line)
        self._transport.write(answer)
        if understood:
            asyncio.get_running_loop().call_soon(self._turn)
        else:
            self._transport.close()

    def _refuse(self, text: str) -> None:
        self._transport.write(encode({"error": text}))
        self._transport.close()
