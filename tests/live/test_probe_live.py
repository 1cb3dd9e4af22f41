"""Tests of `probe robot` over sockets of this computer with something other than a robot at the other end."""

import asyncio
import os
import pty
import socket
import time
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager, closing, suppress
from dataclasses import replace
from typing import Any

import pytest
import serial
from click.testing import CliRunner

from emulators.devices.egm import EgmController, EgmProfile
from emulators.devices.rsi import RsiController, RsiProfile
from emulators.seams import StartPose
from hil_bridge.cli import cli
from hil_bridge.clock import Clock, run_real
from hil_bridge.devices.kinds import KindSettings, default_settings, robot_of
from hil_bridge.devices.robots.rtde.room import ROBOT as RTDE
from hil_bridge.errors import BridgeError
from hil_bridge.site.robot_probe import probe, probe_rows
from protocol.devices.rtde import packets
from protocol.devices.rtde.packets import Kind
from protocol.devices.rtde.profile import ClientProfile

pytestmark = pytest.mark.live

HOST = "127.0.0.1"
MOST_S = 6.5
"""An answer comes within 5 s; a busy computer takes longer."""
BANNER = b"SSH-2.0-OpenSSH_9.2\r\n"
START = StartPose((0.9, -0.1, 0.6), (0.0, 1.0, 0.0, 0.0), 0.2)

Talk = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Coroutine[Any, Any, None]]


@asynccontextmanager
async def server(talk: Talk) -> AsyncIterator[int]:
    """Yield the port of a TCP server that behaves like this with each client."""

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            await talk(reader, writer)
        except ConnectionError:
            pass
        finally:
            writer.close()

    listening = await asyncio.start_server(serve, HOST, 0)
    try:
        yield listening.sockets[0].getsockname()[1]
    finally:
        listening.close()


async def stay_silent(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with suppress(asyncio.CancelledError):  # the test has ended
        while await reader.read(4096):
            pass


async def greet(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    writer.write(BANNER)
    await stay_silent(reader, writer)


async def answer_old(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Support version 1 only."""
    received = packets.Reader()
    while data := await reader.read(4096):
        received.feed(data)
        while (packet := received.next_packet()) is not None:
            writer.write(packets.accepted(Kind(packet.kind), packet.kind != Kind.VERSION))


def ask(url: str, settings: KindSettings[Any, Any] | None = None) -> Coroutine[Any, Any, str]:
    """Return the complete text of a probe, in the running loop; not for an S3, whose command searches first."""

    async def run() -> str:
        kind, wire = robot_of(url)
        chosen = settings or default_settings(kind)
        begun = time.monotonic()
        try:
            findings = await probe(kind, wire, chosen, Clock.running())
            text = "\n".join(f"{name} {value}" for name, value in probe_rows(findings))
        except BridgeError as error:
            text = str(error)
        assert time.monotonic() - begun < MOST_S
        return text

    return run()


def text_of_probe(url: str) -> str:
    """Return the text of the command."""
    begun = time.monotonic()
    done = CliRunner().invoke(cli, ["probe", "robot", url])
    assert time.monotonic() - begun < MOST_S
    assert done.exit_code != 0
    return f"{done.output}\n{done.exception}"


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    with closing(socket.socket(socket.AF_INET, kind)) as free:
        free.bind((HOST, 0))
        return int(free.getsockname()[1])


@pytest.mark.parametrize("kind", ["s3", "rtde"])
def test_probe_of_closed_port(kind: str) -> None:
    if kind == "rtde":
        assert "no program listens there" in text_of_probe(
            f"rtde+tcp://{HOST}:{free_port()}?dashboard={free_port()}"
        )
    else:
        assert "no program listens there" in text_of_probe(f"s3+tcp://{HOST}:{free_port()}")


@pytest.mark.parametrize("kind", ["s3", "rtde"])
def test_probe_of_host_that_is_off(kind: str) -> None:
    """A listener whose queue is full drops connection requests, like a missing host."""
    with closing(socket.socket()) as full:
        full.bind((HOST, 0))
        full.listen(0)
        port = full.getsockname()[1]
        waiting = []
        for _ in range(4):
            client = socket.socket()
            client.setblocking(False)
            client.connect_ex((HOST, port))
            waiting.append(client)
        try:
            url = (
                f"rtde+tcp://{HOST}:{port}?dashboard={port}" if kind == "rtde" else f"s3+tcp://{HOST}:{port}"
            )
            text = text_of_probe(url)
        finally:
            for client in waiting:
                client.close()
    assert ("does not answer within 3.5 s" if kind == "rtde" else "no answer") in text


@pytest.mark.parametrize(
    ("talk", "message"),
    [(stay_silent, "its dashboard does not respond"), (greet, "no dashboard server on its port")],
)
def test_probe_of_other_server_as_universal_robot(talk: Talk, message: str) -> None:
    async def main() -> str:
        async with server(talk) as port:
            return await ask(f"rtde+tcp://{HOST}:{port}?dashboard={port}")

    assert message in run_real(main)


@pytest.mark.parametrize(
    ("talk", "message"),
    [
        (stay_silent, "it does not respond over RTDE"),
        (greet, "it does not speak RTDE"),
        (answer_old, "it does not speak version 2 of RTDE"),
    ],
)
def test_probe_of_other_server_at_rtde_port(talk: Talk, message: str) -> None:
    async def main() -> str:
        async with server(talk) as port:
            settings = replace(default_settings(RTDE), client=ClientProfile(dashboard_port=0))
            return await ask(f"rtde+tcp://{HOST}:{port}", settings)

    assert message in run_real(main)


@pytest.mark.parametrize(("talk", "message"), [(stay_silent, "no answer"), (greet, "only noise")])
def test_probe_of_other_server_as_s3(talk: Talk, message: str) -> None:
    async def main() -> str:
        async with server(talk) as port:
            return await asyncio.to_thread(text_of_probe, f"s3+tcp://{HOST}:{port}")

    assert message in run_real(main)


@pytest.mark.parametrize("kind", ["egm", "rsi"])
def test_probe_of_port_in_use(kind: str) -> None:
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as busy:
        busy.bind((HOST, 0))
        text = text_of_probe(f"{kind}+udp-bind://{HOST}:{busy.getsockname()[1]}")
    assert "another program already listens on this port" in text


def test_probe_of_serial_port_in_use() -> None:
    master, slave = pty.openpty()
    try:
        with closing(serial.Serial(os.ttyname(slave), exclusive=True)):
            assert "another program holds the port" in text_of_probe(f"s3+serial://{os.ttyname(slave)}")
    finally:
        os.close(master)
        os.close(slave)


@pytest.mark.parametrize("kind", ["egm", "rsi"])
def test_probe_of_address_of_other_computer(kind: str) -> None:
    assert "this address is not one of this computer's" in text_of_probe(f"{kind}+udp-bind://192.0.2.1:6510")


@pytest.mark.parametrize(("kind", "message"), [("egm", "a datagram is ignored"), ("rsi", "invalid telegram")])
def test_probe_of_robot_of_other_maker(kind: str, message: str) -> None:
    """KUKA's telegrams come to the port for ABB's datagrams, and vice versa."""

    async def main() -> str:
        clock, port = Clock.running(), free_port(socket.SOCK_DGRAM)
        device: Any = (
            RsiController(RsiProfile(), START, clock.now(), 1)
            if kind == "egm"
            else EgmController(EgmProfile(), START, clock.now(), 1)
        )

        async def send() -> None:
            with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as sender:
                while True:
                    for datagram in device.endpoint.data_to_send(clock.now()):
                        sender.sendto(datagram, (HOST, port))
                    device.endpoint.handle_deadline(clock.now())
                    await asyncio.sleep(0.004)

        sending = asyncio.create_task(send())
        try:
            return await ask(f"{kind}+udp-bind://{HOST}:{port}")
        finally:
            sending.cancel()

    text = run_real(main)
    assert message in text
    assert "sent nothing for 3.5 s" in text
