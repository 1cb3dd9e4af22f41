"""Tests of the benchmarks' C program that forwards packets, stamps them and times their answers."""

import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from protocol.devices.egm.messages import (
    Guidance,
    Motors,
    Rapid,
    RobotMessage,
    SensorMessage,
    encode_answer,
    encode_robot,
)
from protocol.devices.egm.schema import RobotWare
from protocol.devices.rtde import packets
from tools.bench import answers, asyncio_echo, exchanges, machine
from tools.bench.exchanges import ANSWER, PACKET

pytestmark = pytest.mark.live

HOST = "127.0.0.1"
PATIENCE_S = 10.0


@pytest.fixture(scope="module")
def relay() -> Path:
    program = machine.compile_program("relay")
    if program is None:
        pytest.skip(answers.NO_COMPILER)
    return program


def udp() -> socket.socket:
    here = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    here.bind((HOST, 0))
    here.settimeout(PATIENCE_S)
    return here


@contextmanager
def running_relay(
    relay: Path, wire: str, port: int, file: Path
) -> Iterator[tuple[subprocess.Popen[str], int]]:
    with answers.started(relay, "pass", wire, str(port), file) as (process, door):
        yield process, int(door)


def test_datagrams_pass_in_both_directions_with_stamps(relay: Path, tmp_path: Path) -> None:
    file = tmp_path / "seen"
    with (
        udp() as robot,
        udp() as client,
        running_relay(relay, "udp", client.getsockname()[1], file) as (running, door),
    ):
        for number in range(3):
            packet = encode_robot(
                RobotMessage(
                    number, 4 * number, motors=Motors.ON, guidance=Guidance.RUNNING, rapid=Rapid.RUNNING
                ),
                RobotWare.RW7,
            )
            robot.sendto(packet, (HOST, door))
            got, whence = client.recvfrom(2000)
            assert got == packet
            if number != 1:  # it is passed over
                answer = encode_answer(SensorMessage(number, 4 * number))
                client.sendto(answer, whence)
                assert robot.recvfrom(2000) == (answer, (HOST, door))
        running.send_signal(signal.SIGTERM)
        assert running.wait(PATIENCE_S) == 0
    observed = exchanges.read_exchanges(file.read_bytes(), exchanges.egm)
    assert len(observed.exchanges) == 3
    first, passed_over, last = observed.exchanges
    assert first.at + first.taken < passed_over.at < last.at
    assert passed_over.at + passed_over.taken == pytest.approx(last.at + last.taken, abs=1e-9)
    assert 0.0 < last.taken < passed_over.taken


def test_absent_client_blocks_nothing(relay: Path, tmp_path: Path) -> None:
    with udp() as gone:
        port = gone.getsockname()[1]
    file, packet = tmp_path / "seen", b"anything"
    with udp() as robot, running_relay(relay, "udp", port, file) as (running, door):
        for _ in range(3):
            robot.sendto(packet, (HOST, door))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
            client.bind((HOST, port))
            client.settimeout(0.05)
            for _ in range(100):
                robot.sendto(packet, (HOST, door))
                try:
                    assert client.recv(100) == packet
                    break
                except TimeoutError:
                    continue
            else:
                pytest.fail("nothing came through")
        running.send_signal(signal.SIGTERM)
        running.wait(PATIENCE_S)
    assert {chunk.direction for chunk in exchanges.chunks(file.read_bytes())} == {PACKET}


def test_bytes_pass_in_both_directions_until_close(relay: Path, tmp_path: Path) -> None:
    file = tmp_path / "seen"
    packet, answer = (packets.encode(packets.Kind.DATA, bytes(size)) for size in (237, 81))
    with (
        socket.create_server((HOST, 0)) as robot,
        running_relay(relay, "tcp", robot.getsockname()[1], file) as (running, door),
    ):
        with socket.create_connection((HOST, door), PATIENCE_S) as client:
            served = robot.accept()[0]
            with served:
                for _ in range(2):
                    served.sendall(packet)
                    assert client.recv(len(packet), socket.MSG_WAITALL) == packet
                    client.sendall(answer)
                    assert served.recv(len(answer), socket.MSG_WAITALL) == answer
        assert running.wait(PATIENCE_S) == 0
    observed = exchanges.read_exchanges(file.read_bytes(), exchanges.rtde)
    assert len(observed.exchanges) == 2
    assert observed.sizes == (240, 84)


@pytest.mark.parametrize("wire", ["tcp", "udp"])
@pytest.mark.parametrize("kind", ["c", "asyncio"])
def test_every_echo_packet_is_timed(wire: str, kind: str, relay: Path, tmp_path: Path) -> None:
    case = answers.WAYS[0]._replace(wire=wire, cycle_s=0.001)
    echo = (relay, "echo") if kind == "c" else (sys.executable, asyncio_echo.__file__)
    times = answers.echo_times(relay, case, echo, tmp_path / "seen", 0.05)
    assert len(times) == 50
    assert all(0.0 < time < PATIENCE_S for time in times)
    stamped = list(exchanges.chunks((tmp_path / "seen").read_bytes()))
    assert {len(chunk.data) for chunk in stamped if chunk.direction == ANSWER} == {case.answer}
    sent = [chunk.at for chunk in stamped if chunk.direction == PACKET]
    assert sent[-1] - sent[0] >= 0.049 / 2  # on absolute beats, not all at once; a late first one shortens it
