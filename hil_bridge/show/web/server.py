"""HTTP server of a page: static files and live data, with limits per client and in total."""

import asyncio
import json
import time
from collections.abc import Awaitable, Callable, Mapping, Sequence
from contextlib import suppress
from importlib.resources import files
from typing import Any, Protocol

import msgspec
from aiohttp import WSCloseCode, WSMsgType, web

from hil_bridge.errors import ConfigError
from hil_bridge.show.pages import asset, cell_script, chart_script, skeleton, style
from hil_bridge.show.web.admission import HEADERS, TOKEN_HEADER, Admission, Bucket

CLIENTS = 12
"""Maximum number of concurrent WebSockets of pages and Foxglove together."""
CONNECTIONS = 64
"""Maximum number of concurrent connections. One more connection replaces the connection that has been idle longest."""
MESSAGE_BYTES = 1 << 14
"""Largest message of a client, bytes. The messages of a page are far smaller."""
MESSAGES_PER_S, MESSAGES_BURST = 40.0, 80.0
REQUESTS_PER_S, REQUESTS_BURST = 100.0, 200.0
TRIES_PER_S, TRIES_BURST = 1.0, 5.0
"""Rate limit of requests with a wrong token: requests per second, and burst size. A request with the right token is
always accepted.
"""
SLOW_S = 5.0
"""Time after which a client that does not read its data is dropped, s. Chosen."""
IDLE_S = 20.0
"""Time without a complete request after which an open connection is closed, s. Chosen."""
FIRST_S = 3.0
"""Time after which a new connection without any complete request is closed, s.

Chosen: a browser sends a request at once, or opens another connection if it has opened one in advance.
"""
PICTURE_S = 0.05
"""Time between two messages to a page, s. Chosen: motion looks continuous."""
BODY_BYTES = 1024
END, PANEL = "/end", "/panel"

_TYPES = {"js": "text/javascript", "css": "text/css", "svg": "image/svg+xml"}
_SHARED: Mapping[str, Callable[[], str]] = {
    "charts.js": chart_script,
    "copy.js": lambda: asset("copy.js"),
    "cell.js": cell_script,
    "charts.css": style,
}
"""Scripts and styles of `hil_bridge.show.pages`, each combined into one file."""
_OWN = ("page.js", "page.css", "panel.js", "panel.css", "robot.js", "table.js", "icon.svg")
_STYLES: Mapping[str, Sequence[str]] = {
    "page.html": ("charts.css", "page.css", "panel.css"),
    "panel.html": ("charts.css", "page.css", "panel.css"),
    "table.html": ("charts.css",),
}
"""Style sheets of each page."""

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class PageSource(Protocol):
    """Source of a page's updates, and handler of its requests."""

    def first(self) -> object:
        """Return the state of a new page, for `updates`."""

    def updates(self, state: Any) -> Mapping[str, Any] | None:
        """Return the changes since the last call for this state, or None."""

    def handle_request(self, state: Any, message: Mapping[str, Any]) -> None:
        """Handle a request of a page. Raises ValueError for an invalid request."""

    @property
    def over(self) -> bool:
        """Whether the source has no more updates. The server may then end once every page has received all updates."""


class Server:
    """Server of one page."""

    def __init__(self, source: PageSource, admission: Admission, page: str = "page.html") -> None:
        self._source = source
        self._admission = admission
        self._page = page
        self._requests = Bucket(REQUESTS_PER_S, REQUESTS_BURST, time.monotonic)
        self._tries = Bucket(TRIES_PER_S, TRIES_BURST, time.monotonic)
        self._sockets: dict[web.WebSocketResponse, web.Request] = {}
        self._tasks: set[asyncio.Task[Any]] = set()
        self._opened_at: dict[asyncio.BaseTransport, float] = {}
        """Time at which each connection opened."""
        self._requested_at: dict[asyncio.BaseTransport, float] = {}
        """Time of each connection's newest request."""
        self._busy: set[asyncio.BaseTransport] = set()
        """Connections with a request in progress."""
        self.retract: Callable[[], object] | None = None
        """Callback that ends the run like the key `r`; None if there is no run."""
        self.operate: Callable[[Mapping[str, Any]], Awaitable[str]] | None = None
        """Callback that carries out a request to the panel of an emulated controller, and returns the error; empty
        on success.

        None if there is no panel. Raises ConnectionError if the run does not respond.
        """
        self.splice: Handler | None = None
        """Callback that serves a Foxglove client."""
        self.dropped: list[str] = []
        """Reasons why the last few clients were dropped."""

    # --- requests

    @web.middleware
    async def _guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Check every request before it is handled."""
        transport = request.transport
        if transport is None:
            return _refuse(400, "the connection was closed")
        self._requested_at[transport] = time.monotonic()
        self._busy.add(transport)
        try:
            return await self._check(request, handler)
        finally:
            self._busy.discard(transport)

    async def _check(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        try:
            origin = request.headers.getall("Origin", [])
            hosts = request.headers.getall("Host", [])
            if len(hosts) != 1 or len(origin) > 1:
                return _refuse(400, "expected exactly one Host and at most one Origin header")
            opened = request.headers.get("Sec-Fetch-Mode") == "navigate"  # by a link to the page
            site = "" if opened else request.headers.get("Sec-Fetch-Site", "")
            if refusal := self._admission.refusal(hosts[0], origin[0] if origin else None, site):
                return _refuse(403, refusal)
            if request.path not in (END, PANEL) and not self._requests.take():
                return _refuse(429, "too many requests")
            response = await handler(request)
        except web.HTTPException as error:
            return _refuse(error.status, error.reason)
        if not response.prepared:
            response.headers.update(HEADERS)
        return response

    async def _root(self, request: web.Request) -> web.StreamResponse:
        if request.headers.get("Upgrade", "").lower() == "websocket":
            if self.splice is None:
                return _refuse(404, "no live run here; open the recording in Foxglove instead")
            return await self.splice(request)
        return _page(self._page)

    async def _static(self, request: web.Request) -> web.StreamResponse:
        name = request.match_info["name"]
        if name not in (*_SHARED, *_OWN):
            return _refuse(404, "no such file")
        return _file(name)

    async def _end(self, request: web.Request) -> web.StreamResponse:
        """Retract the tool and end the run.

        The request needs the token in a header, and JSON, which no form of another page can send.
        """
        if self.retract is None:
            return _refuse(404, "no live run here")
        request_body = await self._read_trusted(request)
        if isinstance(request_body, web.Response):
            return request_body
        if request_body != {"do": "retract and end"}:
            return _refuse(400, 'send {"do": "retract and end"}')
        self.retract()
        return web.json_response({"done": "asked the run to retract and end"})

    async def _panel(self, request: web.Request) -> web.StreamResponse:
        """Operate the panel of an emulated controller. The token and the format are as for `_end`."""
        if self.operate is None:
            return _refuse(404, "no emulated robot to operate here")
        request_body = await self._read_trusted(request)
        if isinstance(request_body, web.Response):
            return request_body
        if not isinstance(request_body, dict):
            return _refuse(400, "send a JSON object")
        try:
            refusal = await self.operate(request_body)
        except ConnectionError as error:
            return _refuse(503, str(error))
        return _refuse(409, refusal) if refusal else web.json_response({"done": "carried out"})

    async def _read_trusted(self, request: web.Request) -> Any:
        """Return the JSON of a page that has the token, or the refusal."""
        if not self._admission.may_end(request.headers.get(TOKEN_HEADER, "")):
            if not self._tries.take():
                return _refuse(429, "too many attempts; wait a few seconds")
            return _refuse(403, "this needs the token in the run's URL")
        if request.content_type != "application/json" or (request.content_length or 0) > BODY_BYTES:
            return _refuse(415, "send JSON")
        try:
            return await request.json()
        except (ValueError, RecursionError):
            return _refuse(400, "send JSON")

    # --- persistent clients

    def admit(self) -> bool:
        """Return whether one more WebSocket is admitted."""
        return len(self._sockets) < CLIENTS

    def hold(self, socket: web.WebSocketResponse, request: web.Request) -> None:
        """Count a WebSocket that the current task serves."""
        self._sockets[socket] = request
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)

    def release(self, socket: web.WebSocketResponse) -> None:
        """Remove a WebSocket from the count."""
        self._sockets.pop(socket, None)
        task = asyncio.current_task()
        assert task is not None
        self._tasks.discard(task)

    def record_drop(self, why: str) -> None:
        """Store the reason why a client was dropped."""
        self.dropped = [*self.dropped[-20:], why]

    async def _live(self, request: web.Request) -> web.StreamResponse:
        if not self.admit():
            return _refuse(503, f"too many clients: {CLIENTS} are connected, which is the limit")
        socket = web.WebSocketResponse(
            max_msg_size=MESSAGE_BYTES, compress=False, heartbeat=20.0, timeout=2.0
        )
        self.hold(socket, request)
        try:
            await socket.prepare(request)
            state = self._source.first()
            receiving = asyncio.create_task(self._receive(socket, state))
            try:
                await self._send_updates(request, socket, state, receiving)
            finally:
                receiving.cancel()
                with suppress(asyncio.CancelledError, ConnectionError):
                    await receiving
        finally:
            self.release(socket)
        return socket

    async def _send_updates(
        self,
        request: web.Request,
        socket: web.WebSocketResponse,
        state: object,
        receiving: "asyncio.Task[None]",
    ) -> None:
        """Send updates until the page closes, one message at a time, so that a slow page receives fewer messages."""
        while not (socket.closed or receiving.done()):
            over = self._source.over
            update = self._source.updates(state)
            if update is not None:
                try:
                    async with asyncio.timeout(SLOW_S):
                        await socket.send_str(msgspec.json.encode(update).decode())
                except TimeoutError:
                    self.record_drop("a page did not read for too long")
                    abort(request)
                    return
                except (ConnectionError, RuntimeError):
                    return
            if over:
                with suppress(TimeoutError, ConnectionError):
                    async with asyncio.timeout(1.0):
                        await socket.close(code=WSCloseCode.GOING_AWAY, message=b"the run has ended")
                return
            await asyncio.wait({receiving}, timeout=PICTURE_S)

    async def _receive(self, socket: web.WebSocketResponse, state: object) -> None:
        allowed = Bucket(MESSAGES_PER_S, MESSAGES_BURST, time.monotonic)
        async for message in socket:
            if not allowed.take():
                self.record_drop("a page sent too many messages")
                await socket.close(code=WSCloseCode.POLICY_VIOLATION, message=b"too many messages")
                return
            try:
                if message.type is not WSMsgType.TEXT:
                    raise ValueError("no text")
                request = json.loads(message.data)
                if not isinstance(request, dict):
                    raise ValueError("no object")
                self._source.handle_request(state, request)
            except (ValueError, RecursionError):
                self.record_drop("a page sent an invalid request")
                await socket.close(code=WSCloseCode.UNSUPPORTED_DATA, message=b"not understood")
                return

    # --- the server

    async def serve(self, listener: Any) -> None:
        """Serve on this listening socket until the source has no more updates, or forever."""
        app = web.Application(middlewares=[self._guard], client_max_size=BODY_BYTES)
        app.router.add_get("/", self._root)
        app.router.add_get("/static/{name}", self._static)
        app.router.add_get("/live", self._live)
        app.router.add_post(END, self._end)
        app.router.add_post(PANEL, self._panel)
        runner = web.AppRunner(app, access_log=None, keepalive_timeout=IDLE_S, handle_signals=False)
        await runner.setup()
        inner = runner.server
        assert inner is not None
        made = inner

        def protocol() -> asyncio.BaseProtocol:
            return made() if self._has_room(made) else _Refusing()

        server = await asyncio.get_running_loop().create_server(protocol, sock=listener)
        try:
            while not self._source.over:
                await asyncio.sleep(0.1)
                self._close_idle(made)
            server.close()
            if self._tasks:
                await asyncio.wait(self._tasks, timeout=2.0)
        finally:
            server.close()
            with suppress(TimeoutError):
                async with asyncio.timeout(1.0):
                    await runner.cleanup()

    def _has_room(self, server: web.Server) -> bool:
        """Return whether one more connection is admitted.

        At the limit, the connection that has been idle longest is closed.
        """
        present = _transports(server)
        if len(present) < CONNECTIONS:
            return True
        idle = [one for one in present if one not in self._busy]
        if not idle:
            return False
        _abort(min(idle, key=lambda one: self._requested_at.get(one, 0.0)))  # without requests, the oldest
        return True

    def _close_idle(self, server: web.Server) -> None:
        """Close connections that are not WebSockets after IDLE_S, or after FIRST_S if they have sent no request.

        This includes connections with a slow request in progress.
        """
        now = time.monotonic()
        live = {request.transport for request in self._sockets.values()}
        present = _transports(server)
        self._opened_at = {one: self._opened_at.get(one, now) for one in present}
        self._requested_at = {one: at for one, at in self._requested_at.items() if one in self._opened_at}
        for one, since in self._opened_at.items():
            if one not in live and now - since > (IDLE_S if one in self._requested_at else FIRST_S):
                _abort(one)


def _transports(server: web.Server) -> list[asyncio.BaseTransport]:
    """Return the open connections of a server, oldest first."""
    transports = (connection.transport for connection in server.connections)
    return [one for one in transports if one is not None and not one.is_closing()]


class _Refusing(asyncio.Protocol):
    """Protocol that closes a connection at once."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        transport.abort()


def abort(request: web.Request) -> None:
    """End a connection without waiting for its client."""
    _abort(request.transport)


def _abort(transport: asyncio.BaseTransport | None) -> None:
    if isinstance(transport, asyncio.Transport):
        transport.abort()


def _file(name: str) -> web.Response:
    kind = _TYPES[name.rpartition(".")[2]]
    try:
        if name in _SHARED:
            text = _SHARED[name]()
        else:
            text = files("hil_bridge.show.web").joinpath("static", name).read_text(encoding="utf-8")
    except (ConfigError, OSError) as error:
        return _refuse(500, str(error))
    return web.Response(text=text, content_type=kind, charset="utf-8")


def _page(name: str) -> web.Response:
    """Render a page: its body inside the common skeleton."""
    links = "\n".join(f'<link rel="stylesheet" href="/static/{sheet}">' for sheet in _STYLES[name])
    body = files("hil_bridge.show.web").joinpath("static", name).read_text(encoding="utf-8")
    icon = '<link rel="icon" href="/static/icon.svg" type="image/svg+xml">'
    return web.Response(
        text=skeleton("hil-bridge", f"{icon}\n{links}", body), content_type="text/html", charset="utf-8"
    )


def _refuse(status: int, why: str) -> web.Response:
    return web.Response(text=f"{why}\n", status=status, headers=HEADERS)
