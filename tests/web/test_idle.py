"""Idle connections do not block other clients of the page."""

import asyncio
import socket
import time
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager, suppress
from typing import Any

import aiohttp
import pytest

from hil_bridge.show.web import server as serving
from hil_bridge.show.web.admission import Admission
from hil_bridge.show.web.server import CONNECTIONS, Server

pytestmark = pytest.mark.live
IDLE = CONNECTIONS + 16
PROMPT_S = 2.0
"""Longest time for serving a page, also on a busy machine."""
Streams = tuple[asyncio.StreamReader, asyncio.StreamWriter]


class Nothing:
    """Page source without updates."""

    over = False

    def first(self) -> object:
        return None

    def updates(self, state: Any) -> Mapping[str, Any] | None:
        return None

    def handle_request(self, state: Any, message: Mapping[str, Any]) -> None:
        raise ValueError("nothing to ask for")


@asynccontextmanager
async def served() -> AsyncIterator[int]:
    """Serve a page in this process; return its port."""
    source = Nothing()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.setblocking(False)
        task = asyncio.create_task(Server(source, Admission("")).serve(listener))
        try:
            yield listener.getsockname()[1]
        finally:
            source.over = True
            await task


async def answer_s(port: int) -> float:
    """Return the time until a new client has the page, s."""
    began = time.monotonic()
    async with (
        asyncio.timeout(30.0),
        aiohttp.ClientSession() as session,
        session.get(f"http://127.0.0.1:{port}/") as answer,
    ):
        assert answer.status == 200
        await answer.read()
    return time.monotonic() - began


async def open_connection(port: int, count: int, data: bytes = b"") -> list[Streams]:
    connections = []
    for _ in range(count):
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(data)
        connections.append((reader, writer))
    await answer_s(port)  # the server accepts connections in order: it has accepted all
    return connections


SLOW = b"GET / HTTP/1.1\r\nHost: 127.0.0.1"
"""Request that never ends."""


@pytest.mark.parametrize(
    "data",
    [b"", SLOW, b"GET /static/page.css HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"],
    ids=["idle", "slow", "asked-once"],
)
async def test_many_connections_do_not_block_a_client(data: bytes) -> None:
    async with served() as port:
        crowd = await open_connection(port, IDLE, data)
        for _ in range(3):
            assert await answer_s(port) < PROMPT_S
        for _, writer in crowd:
            writer.transport.abort()


async def test_live_pages_survive_many_connections() -> None:
    async with served() as port, aiohttp.ClientSession() as session:
        live = await session.ws_connect(f"http://127.0.0.1:{port}/live")
        crowd = await open_connection(port, 2 * IDLE)
        assert await answer_s(port) < PROMPT_S
        assert not live.closed
        await live.ping()
        with pytest.raises(TimeoutError):
            await live.receive(timeout=0.2)
        for _, writer in crowd:
            writer.transport.abort()
        await live.close()


async def test_idle_connection_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serving, "FIRST_S", 0.2)
    async with served() as port:
        [(reader, writer)] = await open_connection(port, 1)
        async with asyncio.timeout(10.0):
            with suppress(ConnectionResetError):
                assert await reader.read() == b""
        writer.transport.abort()
