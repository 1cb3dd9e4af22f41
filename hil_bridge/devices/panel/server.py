"""Server of the panel on the loopback interface. It serves several clients, one request of one client per iteration
of the event loop.

There is no password, so the server listens on this computer only; other computers need a tunnel. A client that
sends anything but a request, such as a browser that was directed to the port, is disconnected. No client blocks a
slot forever: if all slots are occupied, a new client replaces the one that has been silent longest.
"""

import asyncio
import ipaddress
from collections.abc import Callable, Mapping
from typing import Any

from hil_bridge.clock import Clock
from hil_bridge.devices.panel.messages import REQUEST_LIMIT, decode, encode
from hil_bridge.errors import ConfigError
from hil_bridge.transports import reasons
from hil_bridge.transports.urls import LISTEN_BYTES, parse_url

CLIENT_LIMIT = 8
"""Maximum number of simultaneous clients. Chosen."""
_HIGH_BYTES = 65536
"""Number of unread bytes at which nothing more is sent to a client. Chosen."""

_SCHEMES = {"tcp-listen": LISTEN_BYTES["tcp-listen"]}


def panel_address(url: str) -> tuple[str, int]:
    """Return host and port of a panel's URL. Raises ConfigError if the URL is not tcp-listen on loopback."""
    wire = parse_url(url, _SCHEMES)
    host, port = wire.host_port
    if wire.options:
        raise ConfigError(f"{url!r}: a panel's URL takes no options")
    if not _is_loopback(host):
        raise ConfigError(
            f"{url!r}: the panel has no password and listens on this computer only; use 127.0.0.1"
        )
    return host, port


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


class PanelServer:
    """Server that passes requests to `perform` and returns the answers. A ValueError is sent to the client as an
    error.
    """

    def __init__(self, perform: Callable[[Mapping[str, Any]], Mapping[str, Any]], clock: Clock) -> None:
        self._perform = perform
        self._clock = clock
        self._server: asyncio.Server | None = None
        self._closed = False
        self._clients: dict[asyncio.StreamWriter, asyncio.Task[None]] = {}
        """Connected clients. The client that has been silent longest is first."""

    async def listen(self, url: str) -> str:
        """Start listening and return the URL for clients. Raises ConfigError for an invalid URL,
        TransportUnavailable if the port cannot be opened.
        """
        host, port = panel_address(url)
        try:
            self._server = await asyncio.start_server(self._serve, host, port, limit=REQUEST_LIMIT)
        except OSError as error:
            raise reasons.unavailable("tcp-listen", url, f"{host}:{port}", error) from error
        at, number = self._server.sockets[0].getsockname()[:2]
        return f"tcp://[{at}]:{number}" if ":" in at else f"tcp://{at}:{number}"

    async def aclose(self) -> None:
        """Stop listening and close all connections. Idempotent."""
        self._closed = True
        if self._server is not None:
            self._server.close()
        clients = dict(self._clients)
        for writer in clients:
            writer.transport.abort()
        await asyncio.gather(*clients.values(), return_exceptions=True)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one connection."""
        task = asyncio.current_task()
        assert task is not None
        if self._closed:  # the client connected in the same iteration of the loop
            writer.transport.abort()
            return
        writer.transport.set_write_buffer_limits(high=_HIGH_BYTES)
        if len(self._clients) >= CLIENT_LIMIT:
            silent = next(iter(self._clients))
            del self._clients[silent]
            _dismiss(silent, f"replaced by another client; this one was silent longest of {CLIENT_LIMIT}")
        self._clients[writer] = task
        try:
            understood = True
            while understood:
                line = await reader.readuntil(b"\n")
                if writer in self._clients:  # the client was just active: move it behind all others
                    self._clients[writer] = self._clients.pop(writer)
                answer, understood = self._answer(line)
                writer.write(answer)
                await writer.drain()
                await asyncio.sleep(0)  # let the other clients and the cell run before the next request
        except asyncio.LimitOverrunError:
            _dismiss(writer, f"a request has at most {REQUEST_LIMIT} bytes")
        except (asyncio.IncompleteReadError, ConnectionError):
            pass  # the client has disconnected
        finally:
            self._clients.pop(writer, None)
            _dismiss(writer)

    def _answer(self, line: bytes) -> tuple[bytes, bool]:
        """Return the answer to a line, and whether the line was a valid request."""
        try:
            request = decode(line)
        except ValueError as error:
            return encode({"error": str(error)}), False
        try:
            return encode(self._perform(request)), True
        except ValueError as error:
            return encode({"error": str(error)}), True


def _dismiss(writer: asyncio.StreamWriter, why: str = "") -> None:
    """Send a client the reason and close its connection. If the client has not read earlier data, abort the
    connection.
    """
    if why and not writer.is_closing():
        writer.write(encode({"error": why}))
    writer.close()
    if writer.transport.get_write_buffer_size():
        writer.transport.abort()
