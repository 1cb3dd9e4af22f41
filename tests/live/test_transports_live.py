"""Tests of wires in real time: the common suite on pseudo-terminals, TCP and python-can, and failures of TCP."""

import asyncio
import os
import re
import socket
import struct
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, closing, suppress
from typing import Any

import pytest

from hil_bridge.clock import Clock
from hil_bridge.errors import (
    TransportBroken,
    TransportClosed,
    TransportEnded,
    TransportError,
    TransportUnavailable,
)
from hil_bridge.testing.transports import Ear, StreamCase, TestStreamWire
from hil_bridge.transports import Frames, Transport, connect_bytes, connect_can, listen_bytes, listen_can
from protocol.can.frame import CanFrame
from tests.live.wires import BYTES, pty_wire, wait_for_bytes

__all__ = ["TestStreamWire"]

pytestmark = [
    pytest.mark.live,
    pytest.mark.skipif(os.name != "posix", reason="needs pseudo-terminals"),
]


class ScriptedSlcan:
    """The adapter's side of slcan, written from the protocol's text, on a byte transport.

    Lines end with CR: `S8` bit rate, `O` open, `C` close, `tIIIL…` frame; each is answered by CR.
    """

    def __init__(self, wire: Transport[bytes]) -> None:
        self._wire = wire
        self.commands: list[bytes] = []
        self._text = b""
        self._early: list[CanFrame] = []
        self._on_data: Callable[[Frames], None] | None = None
        self._on_end: Callable[[TransportError], None] = lambda error: None
        self.name = wire.name
        # the client opens the channel before the test starts this end
        wire.start(self._arrived, lambda error: self._on_end(error))

    def start(self, on_data: Callable[[Frames], None], on_end: Callable[[TransportError], None]) -> None:
        self._on_data, self._on_end = on_data, on_end
        if self._early:
            on_data(self._early)

    def send(self, data: Frames) -> None:
        self._wire.send(
            b"".join(
                b"t%03X%d%s\r" % (f.identifier, len(f.data), f.data.hex().upper().encode()) for f in data
            )
        )

    async def aclose(self) -> None:
        await self._wire.aclose()

    def _arrived(self, data: bytes) -> None:
        *lines, self._text = (self._text + data).split(b"\r")
        frames = []
        for line in lines:
            if frame := re.fullmatch(rb"t([0-9A-F]{3})([0-8])((?:[0-9A-F]{2})*)", line):
                frames.append(CanFrame(int(frame[1], 16), bytes.fromhex(frame[3].decode())))
            else:
                self.commands.append(line)
            with suppress(TransportError):
                self._wire.send(b"z\r" if frame else b"\r")
        if self._on_data is None:
            self._early += frames
        elif frames:
            self._on_data(frames)


@asynccontextmanager
async def _tcp(clock: Clock) -> AsyncIterator[Any]:
    listening = await listen_bytes("tcp-listen://127.0.0.1:0", clock)
    yield await connect_bytes(listening.address, clock), listening.transport
    await listening.transport.aclose()


@asynccontextmanager
async def _rfc2217(clock: Clock) -> AsyncIterator[Any]:
    listening = await listen_bytes("rfc2217-listen://127.0.0.1:0?baudrate=4000000", clock)
    yield await connect_bytes(listening.address, clock), listening.transport
    await listening.transport.aclose()


@asynccontextmanager
async def _reconnecting(clock: Clock) -> AsyncIterator[Any]:
    listening = await listen_bytes("tcp-listen://127.0.0.1:0", clock)
    yield await connect_bytes(f"{listening.address}?reconnect_s=0.01", clock), listening.transport
    await listening.transport.aclose()


@asynccontextmanager
async def _virtual_can(clock: Clock) -> AsyncIterator[Any]:
    listening = await listen_can("can+virtual://suite", clock)
    yield await connect_can("can+virtual://suite", clock), listening.transport


@asynccontextmanager
async def _slcan(clock: Clock) -> AsyncIterator[Any]:
    listening = await listen_bytes("pty:", clock)
    adapter = ScriptedSlcan(listening.transport)
    url = listening.address.replace("serial", "can+slcan") + "?bitrate=1000000"
    yield await connect_can(url, clock), adapter


@asynccontextmanager
async def _slcan_over_tcp(clock: Clock) -> AsyncIterator[Any]:
    listening = await listen_bytes("tcp-listen://127.0.0.1:0", clock)
    adapter = ScriptedSlcan(listening.transport)
    url = listening.address.replace("tcp:", "can+slcan+tcp:") + "?bitrate=1000000"
    yield await connect_can(url, clock), adapter
    await adapter.aclose()


CASES = (
    # a serial line does not tell its listener that the client has gone, nor that it takes nothing more
    StreamCase("pty and serial", pty_wire, peer_end=TransportBroken, peer_end_right=None, volume=50_000),
    StreamCase("tcp", _tcp, peer_end=TransportEnded, peer_end_right=None),
    # a paced listener takes a second to hand over its last bytes, and its line has 4 Mbit/s
    StreamCase("rfc2217", _rfc2217, peer_end=TransportEnded, peer_end_right=None, volume=60_000),
    StreamCase("tcp that reconnects", _reconnecting, peer_end=TransportBroken, peer_end_right=None),
    StreamCase("python-can virtual", _virtual_can, True, peer_end=None, peer_end_right=None, volume=8_000),
    StreamCase("slcan", _slcan, True, peer_end=TransportBroken, peer_end_right=None, volume=1_000),
    StreamCase(
        "slcan over tcp", _slcan_over_tcp, True, peer_end=TransportEnded, peer_end_right=None, volume=1_000
    ),
)


@pytest.fixture(params=CASES, ids=lambda case: case.name)
def stream_case(request: pytest.FixtureRequest) -> StreamCase:
    case: StreamCase = request.param
    return case


async def test_tcp_listener_serves_one_client_at_a_time() -> None:
    with closing(Clock.running()) as clock:
        listening = await listen_bytes("tcp-listen://127.0.0.1:0", clock)
        ear = Ear(BYTES, listening.transport)
        listening.transport.send(b"lost")
        first = await connect_bytes(listening.address, clock)
        second = await connect_bytes(listening.address, clock)
        second.send(b"two")
        first.send(b"one ")
        await ear.until(lambda: ear.data == b"one ")
        await first.aclose()
        await ear.until(lambda: ear.data == b"one two")
        received = Ear(BYTES, second)
        listening.transport.send(b"hello")
        await received.until(lambda: received.data == b"hello")
        assert ear.ends == []
        await listening.transport.aclose()
        await received.until(lambda: bool(received.ends))
        assert [type(error) for error in received.ends] == [TransportEnded]
        assert [type(error) for error in ear.ends] == [TransportClosed]
        with pytest.raises(TransportUnavailable, match="no program listens there"):
            await connect_bytes(listening.address, clock)


@pytest.mark.parametrize("scheme", ["tcp", "rfc2217"])
async def test_silent_client_makes_room(monkeypatch: pytest.MonkeyPatch, scheme: str) -> None:
    monkeypatch.setattr("hil_bridge.transports.tcp.SILENT_S", 0.05)
    with closing(Clock.running()) as clock:
        listening = await listen_bytes(f"{scheme}-listen://127.0.0.1:0", clock)
        ear = Ear(BYTES, listening.transport)
        host, port = listening.address.partition("?")[0].rpartition("/")[2].split(":")
        silent = [await asyncio.open_connection(host, int(port)) for _ in range(2)]
        wire = await connect_bytes(listening.address, clock)
        wire.send(b"here")
        await ear.until(lambda: ear.data == b"here")
        for reader, writer in silent:
            with suppress(ConnectionError):
                await reader.read()
            writer.close()
        assert ear.ends == []
        await wire.aclose()
        await listening.transport.aclose()


async def test_active_client_may_become_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hil_bridge.transports.tcp.SILENT_S", 0.05)
    with closing(Clock.running()) as clock:
        listening = await listen_bytes("tcp-listen://127.0.0.1:0", clock)
        ear = Ear(BYTES, listening.transport)
        first, second = [await connect_bytes(listening.address, clock) for _ in range(2)]
        first.send(b"one ")
        second.send(b"two")
        await ear.until(lambda: ear.data == b"one ")
        await clock.sleep_until(clock.now() + 0.3)
        first.send(b"more ")
        await ear.until(lambda: ear.data == b"one more ")
        await first.aclose()
        await ear.until(lambda: ear.data == b"one more two")
        await second.aclose()
        await listening.transport.aclose()


async def test_reset_connection_is_broken() -> None:
    with closing(Clock.running()) as clock, socket.create_server(("127.0.0.1", 0)) as server:
        wire = await connect_bytes(f"tcp://127.0.0.1:{server.getsockname()[1]}", clock)
        ear = Ear(BYTES, wire)
        connection, _ = server.accept()
        # closing without lingering sends a reset
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        connection.close()
        await ear.until(lambda: bool(ear.ends))
        assert isinstance(ear.ends[0], TransportBroken)
        assert "dropped the connection" in str(ear.ends[0])


async def test_busy_port_and_invalid_host_are_refused() -> None:
    with closing(Clock.running()) as clock, socket.create_server(("127.0.0.1", 0)) as server:
        with pytest.raises(TransportUnavailable, match="already listens on this port"):
            await listen_bytes(f"tcp-listen://127.0.0.1:{server.getsockname()[1]}", clock)
        with pytest.raises(TransportUnavailable, match="cannot be opened"):
            await connect_bytes("tcp://no-such-host.invalid:4000", clock)


async def test_paced_listener_sends_at_line_speed() -> None:
    with closing(Clock.running()) as clock:
        listening = await listen_bytes("pty:?baudrate=9600&parity=E", clock)
        assert listening.address.endswith("?baudrate=9600&parity=E&stopbits=1")
        client = await connect_bytes(listening.address, clock)
        here, there = Ear(BYTES, client), Ear(BYTES, listening.transport)
        start = clock.now()
        listening.transport.send(bytes(57))
        await here.until(lambda: len(here.data) == 57)
        took = clock.now() - start
        start = clock.now()
        client.send(bytes(57))
        await there.until(lambda: len(there.data) == 57)
        took_back = clock.now() - start
        line_time = 57 * 11 / 9600
        assert line_time <= took < line_time + 0.1
        assert line_time <= took_back < line_time + 0.1
        await client.aclose()
        await listening.transport.aclose()


async def test_pace_of_9600_baud_is_within_1_percent() -> None:
    """The best of several attempts, because a busy machine only adds time."""
    line_time = 57 * 11 / 9600
    with closing(Clock.running()) as clock:
        listening = await listen_bytes("pty:?baudrate=9600&parity=E", clock)
        client = await connect_bytes(listening.address, clock)
        ends = (client, listening.transport)
        for (sender, receiver), ear in zip(
            (ends, ends[::-1]), (Ear(BYTES, end) for end in ends[::-1]), strict=True
        ):
            best = 2 * line_time
            for _ in range(20):
                ear.data, start = b"", clock.now()
                sender.send(bytes(57))
                await wait_for_bytes(ear, 57)
                took = clock.now() - start
                assert took >= line_time
                best = min(best, took)
                if best < 1.01 * line_time:
                    break
            assert best < 1.01 * line_time, receiver.name
        await client.aclose()
        await listening.transport.aclose()


# --- connections that drop


async def test_connect_waits_for_server_that_starts_later() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with closing(Clock.running()) as clock:
        opening = asyncio.create_task(connect_bytes(f"tcp://127.0.0.1:{port}?connect_s=10", clock))
        await asyncio.sleep(0.15)
        listening = await listen_bytes(f"tcp-listen://127.0.0.1:{port}", clock)
        wire = await opening
        await wire.aclose()
        await listening.transport.aclose()
        with pytest.raises(TransportUnavailable, match="no program listens there"):
            await connect_bytes(f"tcp://127.0.0.1:{port}?connect_s=0.25", clock)


async def test_dropped_connection_is_restored_if_configured() -> None:
    with closing(Clock.running()) as clock, socket.create_server(("127.0.0.1", 0)) as server:
        server.setblocking(False)
        notices: list[tuple[str, str]] = []
        url = f"tcp://127.0.0.1:{server.getsockname()[1]}?reconnect_s=5"
        wire = await connect_bytes(url, clock, lambda kind, text: notices.append((kind, text)))
        ear = Ear(BYTES, wire)
        first, _ = await clock.loop.sock_accept(server)
        first.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        first.close()
        second, _ = await clock.loop.sock_accept(server)
        second.sendall(b"again")
        await ear.until(lambda: ear.data == b"again")
        wire.send(b"here")
        assert await clock.loop.sock_recv(second, 100) == b"here"
        assert [kind for kind, _ in notices] == ["wire_lost", "wire_back"]
        assert "trying to reconnect for 5 s" in notices[0][1]
        assert ear.ends == []
        await wire.aclose()
        second.close()
