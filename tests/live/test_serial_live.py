"""Tests of serial lines in real time: pseudo-terminals, ports, and RFC 2217 with pyserial."""

import asyncio
import os
import socket
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
import serial
import serial.rfc2217

from hil_bridge.clock import Clock
from hil_bridge.errors import TransportUnavailable
from hil_bridge.testing.transports import Ear
from hil_bridge.transports import PacedLine, connect_bytes, connect_can, listen_bytes
from hil_bridge.transports.serial.pseudo_terminal import PseudoTerminal
from hil_bridge.transports.serial.rfc2217 import Rfc2217Client
from tests.live.wires import BYTES, wait_for_bytes

pytestmark = [
    pytest.mark.live,
    pytest.mark.skipif(os.name != "posix", reason="needs pseudo-terminals"),
]

WHOLE = b"\x00\x03\x0d\x0a\x11\x13\x1a\xff"
"""Bytes that a wrongly configured terminal changes."""


def _collect_in(notices: list[str]) -> Callable[[str, str], None]:
    return lambda kind, text: notices.append(text)


async def test_pseudo_terminal_at_wrong_rate_is_garbled() -> None:
    with closing(Clock.running()) as clock:
        listening = await listen_bytes("pty:?baudrate=9600&parity=E", clock)
        ear, device = Ear(BYTES, listening.transport), listening.address.partition("?")[0]
        for baudrate, understood in ((19_200, False), (9600, True), (4800, False)):
            client = await connect_bytes(f"{device}?baudrate={baudrate}&parity=E", clock)
            received = Ear(BYTES, client)
            ear.data = b""
            client.send(b"\x05")
            listening.transport.send(b"ACK")
            await asyncio.sleep(0.05)
            assert (ear.data == b"\x05") is understood
            assert (received.data == b"ACK") is understood
            await client.aclose()
        await listening.transport.aclose()


async def test_pseudo_terminal_has_correct_default_settings() -> None:
    with closing(Clock.running()) as clock:
        listening = await listen_bytes("pty:?baudrate=19200&parity=E", clock)
        ear = Ear(BYTES, listening.transport)
        device = listening.address.removeprefix("serial://").partition("?")[0]
        plain = os.open(device, os.O_RDWR | os.O_NOCTTY)
        os.write(plain, b"\x05")
        await ear.until(lambda: ear.data == b"\x05")
        os.close(plain)
        await listening.transport.aclose()


# --- RFC 2217


async def test_rfc2217_client_with_other_settings() -> None:
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
            client = await connect_bytes(f"{host}?{line}", clock, _collect_in(notices))
            assert isinstance(client, Rfc2217Client)
            assert isinstance(listening.transport, PacedLine)
            received = Ear(BYTES, client)
            ear.data = b""
            client.send(b"\x05")
            listening.transport.send(b"answer")
            await asyncio.sleep(0.05)
            assert (ear.data == b"\x05") is understood
            assert bool(notices) is not understood
            if understood:
                assert received.data == b"answer"
                before = listening.transport.line_errors
                client.send_break(0.02)
                await asyncio.sleep(0.05)
                assert listening.transport.line_errors.breaks == before.breaks + 1
            else:
                assert "the port reports" in notices[0]
            await client.aclose()
            await asyncio.sleep(0.02)
        await listening.transport.aclose()


async def test_invalid_or_refusing_rfc2217_server_is_reported() -> None:
    with closing(Clock.running()) as clock, socket.create_server(("127.0.0.1", 0)) as server:
        server.setblocking(False)
        url = f"rfc2217://127.0.0.1:{server.getsockname()[1]}?baudrate=9600&parity=E"
        opening = asyncio.create_task(connect_bytes(url, clock))
        connection, _ = await clock.loop.sock_accept(server)
        connection.sendall(b"\xff\xfe\x2c")
        with pytest.raises(
            TransportUnavailable, match="cannot be opened: the server does not support com port control"
        ):
            await opening
        connection.close()
        opening = asyncio.create_task(connect_bytes(url, clock))
        connection, _ = await clock.loop.sock_accept(server)
        connection.close()
        with pytest.raises(TransportUnavailable, match="cannot be opened"):
            await opening


@pytest.mark.filterwarnings("ignore:set(Daemon|Name):DeprecationWarning")  # pyserial's own
async def test_pyserial_is_client_of_our_server() -> None:
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


async def test_pyserial_is_server_of_our_client() -> None:
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


# --- clients that come and go


async def test_link_to_pseudo_terminal_serves_clients_in_turn(tmp_path: Path) -> None:
    link = tmp_path / "robot"
    link.symlink_to("/dev/left/over")
    with closing(Clock.running()) as clock:
        listening = await listen_bytes(f"pty:?link={link}", clock)
        assert listening.address == f"serial://{link}"
        ear = Ear(BYTES, listening.transport)
        for k in range(3):
            client = await connect_bytes(f"serial://{link}?parity=E", clock)
            received = Ear(BYTES, client)
            with pytest.raises(TransportUnavailable, match="another program holds the port"):
                await connect_bytes(f"serial://{link}", clock)
            client.send(b"%d" % k)
            await wait_for_bytes(ear, k + 1)
            listening.transport.send(WHOLE)
            await wait_for_bytes(received, len(WHOLE))
            assert received.data == WHOLE
            await client.aclose()
        assert ear.data == b"012"
        assert ear.ends == []
        await listening.transport.aclose()
        assert not link.is_symlink()
        with pytest.raises(TransportUnavailable, match="no such port; check the cable"):
            await connect_bytes(f"serial://{link}", clock)


async def test_unread_pseudo_terminal_does_not_block_emulator() -> None:
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
async def test_closed_pseudo_terminal_drops_data() -> None:
    """Data that arrive while it is closed, or that the last client left, are not for the next one."""
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
        await wait_for_bytes(ear, 1)
        os.close(client)
        await asyncio.sleep(0.05)
        again = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        terminal.send(b"new")
        await asyncio.sleep(0.05)
        assert os.read(again, 100) == b"new"
        os.close(again)
        await terminal.aclose()


async def test_invalid_serial_port_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with closing(Clock.running()) as clock:
        with pytest.raises(TransportUnavailable, match="cannot be opened"):
            await connect_bytes(f"serial://{tmp_path / 'file'}", clock)
        with pytest.raises(TransportUnavailable, match="no such port"):
            await connect_can(f"can+slcan://{tmp_path / 'none'}?bitrate=1000000", clock)
