"""Wires in real time: the one suite on pseudo-terminals, TCP and python-can, and their own ways to fail."""

import asyncio
import importlib.util
import os
import re
import socket
import struct
import sys
import tty
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, closing, suppress
from pathlib import Path
from typing import Any

import pytest

from hil_bridge.clock import Clock, run_real
from hil_bridge.errors import (
    ConfigError,
    TransportBroken,
    TransportClosed,
    TransportEnded,
    TransportError,
    TransportUnavailable,
)
from hil_bridge.transports import (
    Frames,
    Transport,
    connect_bytes,
    connect_can,
    listen_bytes,
    listen_can,
)
from protocol.can import CanFrame

_SPEC = importlib.util.spec_from_file_location(
    "transport_suite", Path(__file__).parents[1] / "bridge" / "test_transports_conformance.py"
)
assert _SPEC is not None
assert _SPEC.loader is not None
suite = importlib.util.module_from_spec(_SPEC)
sys.modules["transport_suite"] = suite
_SPEC.loader.exec_module(suite)
Case, Ear = suite.Case, suite.Ear

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
        # the client opens the channel before anybody starts this end
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
        if frames and self._on_data is None:
            self._early += frames
        elif frames:
            self._on_data(frames)


@asynccontextmanager
async def _pty(clock: Clock) -> AsyncIterator[Any]:
    listening = await listen_bytes("pty:", clock)
    yield await connect_bytes(f"{listening.address}?baudrate=9600&parity=E", clock), listening.transport


@asynccontextmanager
async def _tcp(clock: Clock) -> AsyncIterator[Any]:
    listening = await listen_bytes("tcp-listen://127.0.0.1:0", clock)
    yield await connect_bytes(listening.address, clock), listening.transport
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


CASES = (
    # a serial line does not tell its listener that the client has gone, nor that it takes nothing more
    Case("pty and serial", _pty, peer_end=TransportBroken, peer_end_right=None, volume=50_000),
    Case("tcp", _tcp, peer_end=TransportEnded, peer_end_right=None),
    Case("python-can virtual", _virtual_can, True, peer_end=None, peer_end_right=None, volume=8_000),
    Case("slcan", _slcan, True, peer_end=TransportBroken, peer_end_right=None, volume=15_000),
)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
@pytest.mark.parametrize("check", suite.CHECKS, ids=lambda check: check.__name__)
async def test_suite(check: Callable[..., Awaitable[None]], case: Any) -> None:
    await suite.run_check(check, case)


BYTES = Case("bytes", _pty)


async def test_clients_of_a_tcp_listener_come_and_go_one_at_a_time() -> None:
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
        heard = Ear(BYTES, second)
        listening.transport.send(b"hello")
        await heard.until(lambda: heard.data == b"hello")
        assert ear.ends == []
        await listening.transport.aclose()
        await heard.until(lambda: bool(heard.ends))
        assert [type(error) for error in heard.ends] == [TransportEnded]
        assert [type(error) for error in ear.ends] == [TransportClosed]
        with pytest.raises(TransportUnavailable, match="nobody listens there"):
            await connect_bytes(listening.address, clock)


async def test_a_reset_connection_is_broken() -> None:
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


async def test_a_port_in_use_and_a_host_that_is_none_are_said_in_one_line() -> None:
    with closing(Clock.running()) as clock, socket.create_server(("127.0.0.1", 0)) as server:
        with pytest.raises(TransportUnavailable, match="listens on this port already"):
            await listen_bytes(f"tcp-listen://127.0.0.1:{server.getsockname()[1]}", clock)
        with pytest.raises(TransportUnavailable, match="cannot be opened"):
            await connect_bytes("tcp://no-such-host.invalid:4000", clock)


async def test_a_paced_listener_gives_a_client_its_bytes_at_line_speed() -> None:
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


async def test_a_link_names_the_pseudo_terminal_and_clients_come_and_go(tmp_path: Path) -> None:
    link = tmp_path / "robot"
    link.symlink_to("/dev/left/over")
    with closing(Clock.running()) as clock:
        listening = await listen_bytes(f"pty:?link={link}", clock)
        assert listening.address == f"serial://{link}"
        ear = Ear(BYTES, listening.transport)
        for k in range(3):
            client = await connect_bytes(f"serial://{link}?parity=E", clock)
            heard = Ear(BYTES, client)
            with pytest.raises(TransportUnavailable, match="another program holds the port"):
                await connect_bytes(f"serial://{link}", clock)
            client.send(b"%d" % k)
            await ear.until(lambda k=k: len(ear.data) == k + 1)
            listening.transport.send(
                b"\x00\x03\x0d\x0a\x11\x13\x1a\xff"
            )  # nothing that a terminal would change
            await heard.until(lambda heard=heard: heard.data == b"\x00\x03\x0d\x0a\x11\x13\x1a\xff")
            await client.aclose()
        assert ear.data == b"012"
        assert ear.ends == []
        await listening.transport.aclose()
        assert not link.is_symlink()
        with pytest.raises(TransportUnavailable, match="no such port; check the cable"):
            await connect_bytes(f"serial://{link}", clock)


async def test_an_unread_pseudo_terminal_never_blocks_nor_breaks_its_emulator() -> None:
    with closing(Clock.running()) as clock:
        listening = await listen_bytes("pty:", clock)
        for _ in range(100):
            listening.transport.send(bytes(2000))
        assert listening.transport.lost > 0
        await listening.transport.aclose()


async def test_what_is_no_serial_port_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with closing(Clock.running()) as clock:
        with pytest.raises(TransportUnavailable, match="cannot be opened"):
            await connect_bytes(f"serial://{tmp_path / 'file'}", clock)
        with pytest.raises(TransportUnavailable, match="no such port"):
            await connect_can(f"can+slcan://{tmp_path / 'none'}?bitrate=1000000", clock)


@pytest.mark.skipif(sys.platform != "linux", reason="SocketCAN")
async def test_a_can_interface_that_is_not_there() -> None:
    with closing(Clock.running()) as clock:
        with pytest.raises(TransportUnavailable, match=r"no such CAN interface|no SocketCAN"):
            await connect_can("can+socketcan://nocan7", clock)
        with pytest.raises(ConfigError):
            await connect_can("can+socketcan:", clock)


async def test_a_port_that_another_program_holds_is_no_slcan_adapter_of_ours() -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    url = f"can+slcan://{os.ttyname(slave)}?bitrate=1000000"
    with closing(Clock.running()) as clock:
        wire = await connect_can(url, clock)
        said = os.read(master, 4096)
        with pytest.raises(TransportUnavailable, match="another program holds the port"):
            await connect_can(url, clock)
        os.set_blocking(master, False)
        with pytest.raises(BlockingIOError):  # the first conversation was not disturbed
            os.read(master, 4096)
        assert said.startswith(b"C\r")
        await wire.aclose()
        await (await connect_can(url, clock)).aclose()
    os.close(master)
    os.close(slave)


async def test_slcan_opens_its_channel_and_survives_noise() -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    with closing(Clock.running()) as clock:
        wire = await connect_can(f"can+slcan://{os.ttyname(slave)}?bitrate=1000000", clock)
        assert os.read(master, 4096).endswith(b"S8\r\rO\rO\r")
        frames: list[CanFrame] = []
        ends: list[TransportError] = []
        wire.start(frames.extend, ends.append)
        noise = (
            b"\r\r\a",  # acknowledgements and an error without any frame between
            b"t12\r",  # too short
            b"txyz0\r",  # no number
            b"t1008AABB\r",  # fewer bytes than it says
            b"t1009000102030405060708\r",  # more than a frame holds
            b"t-110\r",
            b"\xff\xfe\x80t1000\r",  # no text
            b"hello\r",
            b"x" * 5000,  # a line that does not end
        )
        for k, garbage in enumerate(noise):
            before = wire.malformed
            os.write(master, garbage)
            await asyncio.sleep(0.02)
            # python-can passes over words that it does not know
            assert (wire.malformed > before) == (garbage not in (b"\r\r\a", b"hello\r"))
            # one ack, then two frames in the same read: all must come out at once
            os.write(master, b"\r\rt%03X2BEEF\r\rt1230\r" % k)
            await asyncio.sleep(0.02)
        assert [frame for frame in frames if frame.identifier != 0x123] == [
            CanFrame(k, b"\xbe\xef") for k in range(len(noise))
        ]
        assert sum(frame == CanFrame(0x123) for frame in frames) == len(noise)
        assert all(0 <= clock.now() - frame.received_at < 5 for frame in frames)
        os.write(master, b"T1ABCDEF01FF\rr1230\r")
        wire.send([CanFrame(0x1ABCDEF0, b"\x01", extended=True), CanFrame(0x7FF, remote=True)])
        await asyncio.sleep(0.02)
        assert frames[-2:] == [
            CanFrame(0x1ABCDEF0, b"\xff", extended=True),
            CanFrame(0x123, remote=True),
        ]
        assert os.read(master, 4096) == b"T1ABCDEF0101\rr7FF0\r"
        assert ends == []
        os.close(master)
        await asyncio.sleep(0.05)
        assert [type(error) for error in ends] == [TransportBroken]
        os.close(slave)


async def test_slcan_never_blocks_when_the_adapter_does_not_read() -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    with closing(Clock.running()) as clock:
        wire = await connect_can(f"can+slcan://{os.ttyname(slave)}?bitrate=1000000", clock)
        wire.start(lambda frames: None, lambda error: None)
        start = clock.now()
        with pytest.raises(TransportError, match="the send queue is full"):
            wire.send([CanFrame(0x100, bytes(8))] * 10_000)
        assert clock.now() - start < 2.0
        os.close(master)
        await wire.aclose()
        os.close(slave)


async def test_a_full_virtual_can_queue_refuses() -> None:
    with closing(Clock.running()) as clock:
        deaf = await connect_can("can+virtual://full", clock)
        sender = await connect_can("can+virtual://full", clock)
        with pytest.raises(TransportError, match="the send queue is full"):
            sender.send([CanFrame(0x100)] * 2000)
        await sender.aclose()
        await deaf.aclose()


def test_closing_the_loop_leaves_no_reader_thread_behind() -> None:
    async def main() -> None:
        with closing(Clock.running()) as clock:
            wire = await connect_can("can+virtual://gone", clock)
            wire.start(lambda frames: None, lambda error: None)
            await wire.aclose()

    run_real(main)
