"""Proxy from an admitted Foxglove client to the inner server."""

import asyncio
import time
from contextlib import suppress

from aiohttp import ClientError, ClientSession, ClientWebSocketResponse, WSCloseCode, WSMsgType, web

from hil_bridge.show.web.admission import Bucket
from hil_bridge.show.web.panels import PROTOCOLS
from hil_bridge.show.web.server import SLOW_S, Server, abort

CLIENT_BYTES = 1 << 16
"""Largest message of a client, bytes. A client only names the channels that it requests."""
PER_S, BURST = 100.0, 300.0
"""Maximum number of messages of a client per second, and in a burst."""


class Splicing:
    """Bidirectional proxy. Messages for a slow client wait in the inner server, whose queue is bounded."""

    def __init__(self, server: Server, session: ClientSession, url: str) -> None:
        self._server, self._session, self._url = server, session, url

    async def __call__(self, request: web.Request) -> web.StreamResponse:
        """Serve one client until it disconnects or is dropped."""
        protocols = [each.strip() for each in request.headers.get("Sec-WebSocket-Protocol", "").split(",")]
        chosen = next((one for one in PROTOCOLS if one in protocols), None)
        if chosen is None:
            return web.Response(status=400, text=f"this WebSocket speaks {' and '.join(PROTOCOLS)}\n")
        if not self._server.admit():
            return web.Response(status=503, text="too many clients\n")
        outer = web.WebSocketResponse(
            protocols=(chosen,), max_msg_size=CLIENT_BYTES, compress=False, heartbeat=20.0, timeout=2.0
        )
        self._server.hold(outer, request)
        try:
            async with self._session.ws_connect(
                self._url, protocols=PROTOCOLS[:1], max_msg_size=0, compress=0
            ) as inner:
                await outer.prepare(request)
                await self._forward(request, outer, inner)
        except (ClientError, ConnectionError, TimeoutError):
            if not outer.prepared:
                return web.Response(status=502, text="Foxglove's server does not answer\n")
        finally:
            self._server.release(outer)
        return outer

    async def _forward(
        self, request: web.Request, outer: web.WebSocketResponse, inner: ClientWebSocketResponse
    ) -> None:
        tasks = [
            asyncio.create_task(self._inwards(outer, inner)),
            asyncio.create_task(self._outwards(request, outer, inner)),
        ]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            with suppress(TimeoutError, ConnectionError):
                async with asyncio.timeout(1.0):
                    await outer.close(code=WSCloseCode.GOING_AWAY, message=b"closed")

    async def _inwards(self, outer: web.WebSocketResponse, inner: ClientWebSocketResponse) -> None:
        allowed = Bucket(PER_S, BURST, time.monotonic)
        async for message in outer:
            if not allowed.take():
                self._server.record_drop("a client of Foxglove's protocol sent too many messages")
                await outer.close(code=WSCloseCode.POLICY_VIOLATION, message=b"too many messages")
                return
            if message.type is WSMsgType.TEXT:
                await inner.send_str(message.data)
            elif message.type is WSMsgType.BINARY:
                await inner.send_bytes(message.data)

    async def _outwards(
        self, request: web.Request, outer: web.WebSocketResponse, inner: ClientWebSocketResponse
    ) -> None:
        async for message in inner:
            try:
                async with asyncio.timeout(SLOW_S):
                    if message.type is WSMsgType.TEXT:
                        await outer.send_str(message.data)
                    elif message.type is WSMsgType.BINARY:
                        await outer.send_bytes(message.data)
            except TimeoutError:
                self._server.record_drop("a client of Foxglove's protocol did not read for too long")
                abort(request)
                return
