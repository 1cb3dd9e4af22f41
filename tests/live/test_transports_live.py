"""Wires in real time: the one suite on pseudo-terminals, TCP and python-can, and their own ways to fail."""

import asyncio
import os
import re
import socket
import struct
import sys
import tty
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, closing, suppress
from pathlib import Path
from typing import Any

import pytest
import serial
import serial.rfc2217

from hil_bridge.clock import Clock, run_real
from hil_bridge.errors import (
    ConfigError,
    TransportBroken,
    TransportClosed,
    TransportEnded,
    TransportError,
    TransportUnavailable,
)
from hil_bridge.testing.transports import Ear, StreamCase, TestStreamWire
from hil_bridge.transports import (
    Frames,
    LineErrors,
    PacedLine,
    Transport,
    connect_bytes,
    connect_can,
    listen_bytes,
    listen_can,
)
from hil_bridge.transports.can.slcan import SlcanWire
from hil_bridge.transports.serial.pseudo_terminal import PseudoTerminal
from hil_bridge.transports.serial.rfc2217 import Rfc2217Client
from hil_bridge.transports.serial.serial_port import SerialWire
from protocol.can.frame import CanFrame

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


WHOLE = b"\x00\x03\x0d\x0a\x11\x13\x1a\xff"
"""Bytes that a terminal changes when it is not set right."""


async def _came(ear: Ear, count: int) -> None:
    await ear.until(lambda: len(ear.data) == count)


def _noted(notices: list[str]) -> Callable[[str, str], None]:
    return lambda kind, text: notices.append(text)


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
    StreamCase("pty and serial", _pty, peer_end=TransportBroken, peer_end_right=None, volume=50_000),
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


BYTES = StreamCase("bytes", _pty)


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
        with pytest.raises(TransportUnavailable, match="no program listens there"):
            await connect_bytes(listening.address, clock)


@pytest.mark.parametrize("scheme", ["tcp", "rfc2217"])
async def test_a_client_that_never_spoke_makes_room(monkeypatch: pytest.MonkeyPatch, scheme: str) -> None:
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


async def test_a_client_that_has_spoken_may_be_silent(monkeypatch: pytest.MonkeyPatch) -> None:
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


async def test_the_pace_of_9600_baud_is_kept_within_one_percent() -> None:
    """The best of some tries: what a busy machine adds is not the line's."""
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
                await _came(ear, 57)
                took = clock.now() - start
                assert took >= line_time
                best = min(best, took)
                if best < 1.01 * line_time:
                    break
            assert best < 1.01 * line_time, receiver.name
        await client.aclose()
        await listening.transport.aclose()


async def test_a_pseudo_terminals_client_at_another_rate_is_garbled() -> None:
    with closing(Clock.running()) as clock:
        listening = await listen_bytes("pty:?baudrate=9600&parity=E", clock)
        ear, device = Ear(BYTES, listening.transport), listening.address.partition("?")[0]
        for baudrate, understood in ((19_200, False), (9600, True), (4800, False)):
            client = await connect_bytes(f"{device}?baudrate={baudrate}&parity=E", clock)
            heard = Ear(BYTES, client)
            ear.data = b""
            client.send(b"\x05")
            listening.transport.send(b"ACK")
            await asyncio.sleep(0.05)
            assert (ear.data == b"\x05") is understood
            assert (heard.data == b"ACK") is understood
            await client.aclose()
        await listening.transport.aclose()


async def test_a_program_that_sets_nothing_finds_the_terminal_set_right() -> None:
    with closing(Clock.running()) as clock:
        listening = await listen_bytes("pty:?baudrate=19200&parity=E", clock)
        ear = Ear(BYTES, listening.transport)
        device = listening.address.removeprefix("serial://").partition("?")[0]
        plain = os.open(device, os.O_RDWR | os.O_NOCTTY)
        os.write(plain, b"\x05")
        await ear.until(lambda: ear.data == b"\x05")
        os.close(plain)
        await listening.transport.aclose()


async def test_a_driver_that_counts_line_errors_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    counted = [0] * 20
    with closing(Clock.running()) as clock:
        listening = await listen_bytes("pty:", clock)
        client = await connect_bytes(listening.address, clock)
        assert isinstance(client, SerialWire)
        assert client.line_errors == LineErrors()  # a pseudo-terminal does not count
        await client.aclose()
        monkeypatch.setattr(
            "hil_bridge.transports.serial.serial_port._counters", lambda fd: struct.pack("20i", *counted)
        )
        counted[6:10] = 1, 2, 3, 4  # frame, overrun, parity, brk
        client = await connect_bytes(listening.address, clock)
        assert isinstance(client, SerialWire)
        assert client.line_errors == LineErrors()
        counted[6:10] = 11, 2, 4, 6
        assert client.line_errors == LineErrors(parity=1, framing=10, breaks=2)
        await client.aclose()
        counted[6] = 100
        assert client.line_errors == LineErrors(parity=1, framing=10, breaks=2)
        await listening.transport.aclose()


# --- RFC 2217


async def test_a_client_at_other_settings_than_the_rfc2217_port() -> None:
    with closing(Clock.running()) as clock:
        listening = await listen_bytes("rfc2217-listen://127.0.0.1:0?baudrate=9600&parity=E", clock)
        assert listening.address.endswith("?baudrate=9600&parity=E&stopbits=1")
        ear, host = Ear(BYTES, listening.transport), listening.address.partition("?")[0]
        for line, understood in (
            ("baudrate=9600&parity=N", False),
            ("baudrate=19200&parity=E", False),
            ("baudrate=9600&parity=E", True),
        ):
            notices: list[str] = []
            client = await connect_bytes(f"{host}?{line}", clock, _noted(notices))
            assert isinstance(client, Rfc2217Client)
            assert isinstance(listening.transport, PacedLine)
            heard = Ear(BYTES, client)
            ear.data = b""
            client.send(b"\x05")
            listening.transport.send(b"answer")
            await asyncio.sleep(0.05)
            assert (ear.data == b"\x05") is understood
            assert bool(notices) is not understood
            if understood:
                assert heard.data == b"answer"
                before = listening.transport.line_errors
                client.send_break(0.02)
                await asyncio.sleep(0.05)
                assert listening.transport.line_errors.breaks == before.breaks + 1
            else:
                assert "the port reports" in notices[0]
                assert client.line_errors.parity + client.line_errors.framing > 0
            await client.aclose()
            await asyncio.sleep(0.02)
        await listening.transport.aclose()


async def test_a_server_that_is_none_or_not_willing_is_said_in_one_line() -> None:
    with closing(Clock.running()) as clock, socket.create_server(("127.0.0.1", 0)) as server:
        server.setblocking(False)
        url = f"rfc2217://127.0.0.1:{server.getsockname()[1]}?baudrate=9600&parity=E"
        opening = asyncio.create_task(connect_bytes(url, clock))
        connection, _ = await clock.loop.sock_accept(server)
        connection.sendall(b"\xff\xfe\x2c")
        with pytest.raises(
            TransportUnavailable, match="cannot be opened: the server has no com port control"
        ):
            await opening
        connection.close()
        opening = asyncio.create_task(connect_bytes(url, clock))
        connection, _ = await clock.loop.sock_accept(server)
        connection.close()
        with pytest.raises(TransportUnavailable, match="cannot be opened"):
            await opening


@pytest.mark.filterwarnings("ignore:set(Daemon|Name):DeprecationWarning")  # pyserial's own
async def test_pyserial_as_a_client_of_our_server() -> None:
    def talk(address: str) -> tuple[bytes, bytes]:
        with serial.serial_for_url(address, baudrate=19_200, parity="E", timeout=2) as port:
            port.write(b"\x05\xff")
            good = port.read(3)
            port.parity = "N"
            port.write(b"\x05")
            return good, port.read(1)

    with closing(Clock.running()) as clock:
        listening = await listen_bytes("rfc2217-listen://127.0.0.1:0?baudrate=19200&parity=E", clock)
        listening.transport.start(
            lambda data: listening.transport.send(b"\xff\x06\x00") if data else None, lambda error: None
        )
        address = listening.address.partition("?")[0]
        assert await asyncio.to_thread(talk, address + "?timeout=5") == (b"\xff\x06\x00", b"")
        await listening.transport.aclose()


async def test_pyserial_as_a_server_of_our_client() -> None:
    class Connection:
        def __init__(self, connection: socket.socket) -> None:
            self.write = connection.sendall

    settings: list[tuple[int, str]] = []

    def serve(server: socket.socket) -> None:
        connection, _ = server.accept()
        with connection, serial.serial_for_url("loop://", timeout=0.05) as port:
            manager = serial.rfc2217.PortManager(port, Connection(connection))
            while data := connection.recv(1024):
                port.write(b"".join(manager.filter(data)))
                settings.append((port.baudrate, port.parity))
                if port.in_waiting:
                    connection.sendall(b"".join(manager.escape(port.read(port.in_waiting))))

    with closing(Clock.running()) as clock, socket.create_server(("127.0.0.1", 0)) as server:
        serving = asyncio.create_task(asyncio.to_thread(serve, server))
        url = f"rfc2217://127.0.0.1:{server.getsockname()[1]}?baudrate=19200&parity=E"
        client = await connect_bytes(url, clock)
        ear = Ear(BYTES, client)
        client.send(bytes(range(256)))
        await ear.until(lambda: len(ear.data) == 256)
        assert ear.data == bytes(range(256))
        await client.aclose()
        await serving
    assert settings[-1] == (19_200, "E")


# --- connections that drop


async def test_connecting_waits_for_a_server_that_starts_later() -> None:
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


async def test_a_connection_that_drops_is_made_again_where_that_is_wanted() -> None:
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
            await _came(ear, k + 1)
            listening.transport.send(WHOLE)
            await _came(heard, len(WHOLE))
            assert heard.data == WHOLE
            await client.aclose()
        assert ear.data == b"012"
        assert ear.ends == []
        await listening.transport.aclose()
        assert not link.is_symlink()
        with pytest.raises(TransportUnavailable, match="no such port; check the cable"):
            await connect_bytes(f"serial://{link}", clock)


async def test_an_unread_pseudo_terminal_never_blocks_its_emulator() -> None:
    with closing(Clock.running()) as clock:
        listening = await listen_bytes("pty:", clock)
        assert isinstance(listening.transport, PseudoTerminal)
        client = os.open(listening.address.removeprefix("serial://"), os.O_RDWR | os.O_NOCTTY)
        for _ in range(100):
            listening.transport.send(bytes(2000))
        os.close(client)
        assert 0 < listening.transport.lost < 200_000
        await listening.transport.aclose()


@pytest.mark.skipif(sys.platform != "linux", reason="inotify")
async def test_a_pseudo_terminal_forgets_as_a_uart_does() -> None:
    """Neither what comes while it is closed nor what the last client left is for the next one."""
    with closing(Clock.running()) as clock:
        listening = await listen_bytes("pty:", clock)
        terminal = listening.transport
        assert isinstance(terminal, PseudoTerminal)
        ear = Ear(BYTES, terminal)
        terminal.send(b"while closed")
        assert terminal.lost == len(b"while closed")
        device = listening.address.removeprefix("serial://")
        client = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        terminal.send(bytes(50_000))  # more than the system holds; the client reads nothing
        os.write(client, b"1")
        await _came(ear, 1)
        os.close(client)
        await asyncio.sleep(0.05)
        again = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        terminal.send(b"new")
        await asyncio.sleep(0.05)
        assert os.read(again, 100) == b"new"
        os.close(again)
        await terminal.aclose()


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


def _heard_by_adapter(master: int) -> bytes:
    """Bytes sent by the opening of a channel; a busy computer hands them over in parts."""
    heard = b""
    while not heard.endswith(b"C\rS8\rO\r"):
        heard += os.read(master, 4096)
    return heard


async def test_a_port_held_by_another_program_is_no_slcan_adapter() -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    url = f"can+slcan://{os.ttyname(slave)}?bitrate=1000000"
    with closing(Clock.running()) as clock:
        wire = await connect_can(url, clock)
        said = _heard_by_adapter(master)
        with pytest.raises(TransportUnavailable, match="another program holds the port"):
            await connect_can(url, clock)
        os.set_blocking(master, False)
        with pytest.raises(BlockingIOError):  # the first conversation was not disturbed
            os.read(master, 4096)
        assert said == b"\r\r\rC\rS8\rO\r"
        await wire.aclose()
        await (await connect_can(url, clock)).aclose()
    os.close(master)
    os.close(slave)


async def test_slcan_opens_its_channel_and_survives_noise() -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    with closing(Clock.running()) as clock:
        wire = await connect_can(f"can+slcan://{os.ttyname(slave)}?bitrate=1000000", clock)
        assert isinstance(wire, SlcanWire)
        _heard_by_adapter(master)
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
            before = wire.statistics.malformed
            os.write(master, garbage)
            await asyncio.sleep(0.02)
            # one ack, then two frames in the same read: all must come out at once
            os.write(master, b"\r\rt%03X2BEEF\r\rt1230\r" % k)
            await asyncio.sleep(0.02)
            assert (wire.statistics.malformed > before) == (garbage != b"\r\r\a")
        assert [frame for frame in frames if frame.identifier != 0x123] == [
            CanFrame(k, b"\xbe\xef") for k in range(len(noise))
        ]
        assert sum(frame == CanFrame(0x123) for frame in frames) == len(noise)
        times = [frame.received_at for frame in frames]
        assert all(at is not None and 0 <= clock.now() - at < 5 for at in times)
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
