"""Server of an emulated controller's web services, with limits per client and in total."""

import asyncio
import os
from contextlib import suppress

from aiohttp import WSMsgType, web

from emulators.devices.egm.web_login import Login
from emulators.devices.egm.web_services import BODY_MAX, WebAnswer, WebServices
from hil_bridge.devices.robots.egm.web_address import WebAddress
from hil_bridge.devices.wiring import Serving
from hil_bridge.transports import reasons
from protocol.devices.egm.web import SUBSCRIPTION

CONNECTIONS_MAX = 64
"""Maximum number of simultaneous connections; any further connection is closed at once. Chosen."""
IDLE_S = 75.0
"""Time after which an idle connection is closed, s. Chosen."""
POLL_S = 0.05
"""Interval at which a subscription is polled for changes, s. Chosen."""
SLOW_S = 5.0
"""Time after which a subscriber that does not read is disconnected, s. Chosen."""
MESSAGE_MAX = 4096
"""Maximum size of a message from a subscriber, bytes. Chosen: no message is expected."""


class _Rejected(asyncio.Protocol):
    """Connection that exceeds the limit and is rejected."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        transport.abort()


class WebServer:
    """Web server of one emulated controller."""

    def __init__(self, services: WebServices, serving: Serving) -> None:
        self._services, self._serving = services, serving
        self._login = Login(os.urandom(16))
        self._server: asyncio.Server | None = None
        app = web.Application(client_max_size=BODY_MAX)
        app.router.add_route("*", "/{path:.*}", self._handle)
        self._runner = web.AppRunner(app, access_log=None, keepalive_timeout=IDLE_S, shutdown_timeout=0.1)

    async def listen(self, address: WebAddress) -> WebAddress:
        """Start listening and return the address with the actual port. Raises TransportUnavailable if the port
        cannot be opened.
        """
        await self._runner.setup()
        self._serving.stack.push_async_callback(self._close)
        server = self._runner.server
        assert server is not None, "the runner is set up"

        def admit() -> asyncio.BaseProtocol:
            return server() if len(server.connections) < CONNECTIONS_MAX else _Rejected()

        try:
            self._server = await asyncio.get_running_loop().create_server(admit, address.host, address.port)
        except OSError as error:
            name = f"tcp-listen://{address.authority}"
            raise reasons.unavailable("tcp-listen", name, address.authority, error) from error
        return address._replace(port=self._server.sockets[0].getsockname()[1])

    async def _close(self) -> None:
        if self._server is not None:
            self._server.close()
        await self._runner.cleanup()

    async def _handle(self, request: web.Request) -> web.StreamResponse:
        now = self._serving.clock.now()
        cookies: dict[str, str] = {}
        target = request.raw_path
        if not self._login.knows(request.cookies, now):
            if not self._login.accepts(request.headers.get("Authorization", ""), request.method, target):
                await self._read(request)
                return web.Response(status=401, headers={"WWW-Authenticate": self._login.challenge()})
            opened = self._login.open(now)
            if opened is None:
                return web.Response(status=503)
            cookies.update(opened)
        number = request.path.removeprefix("/poll/")
        if number != request.path:
            return await self._publish(request, number)
        answer = self._services.answer(request.method, target, await self._read(request), now)
        self._serving.wake()
        if request.path == "/logout":
            self._login.close(request.cookies)
        return _respond(answer, cookies)

    async def _read(self, request: web.Request) -> str:
        return (await request.read()).decode("utf-8", "replace")

    async def _publish(self, request: web.Request, number: str) -> web.StreamResponse:
        """Send changes to a subscriber until either side ends the subscription."""
        subscriptions = self._services.subscriptions
        if not subscriptions.knows(number):
            return web.Response(status=404)
        socket = web.WebSocketResponse(protocols=(SUBSCRIPTION,), max_msg_size=MESSAGE_MAX)
        if not socket.can_prepare(request).ok:
            return web.Response(status=400)
        await socket.prepare(request)
        try:
            while subscriptions.knows(number):
                with suppress(TimeoutError):
                    message = await socket.receive(timeout=POLL_S)
                    if message.type in (
                        WSMsgType.CLOSE,
                        WSMsgType.CLOSING,
                        WSMsgType.CLOSED,
                        WSMsgType.ERROR,
                    ):
                        break
                if news := subscriptions.news(number):
                    async with asyncio.timeout(SLOW_S):
                        await socket.send_str(news.decode())
        except (TimeoutError, ConnectionError):
            pass  # the subscriber has disconnected, or does not read
        finally:
            subscriptions.end(number)
        with suppress(TimeoutError, ConnectionError):
            async with asyncio.timeout(SLOW_S):
                await socket.close()
        return socket


def _respond(answer: WebAnswer, cookies: dict[str, str]) -> web.Response:
    headers = dict(answer.headers)
    if answer.body:
        headers["Content-Type"] = answer.kind
    response = web.Response(status=answer.status, body=answer.body, headers=headers)
    for name, value in cookies.items():
        response.set_cookie(name, value, path="/", httponly=True)
    return response
