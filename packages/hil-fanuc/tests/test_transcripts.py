"""Sessions of other programs, replayed to the emulated controller.

A line is a time in s, a connection, the number of bytes, and the data: hexadecimal without trailing zeros for a
datagram of Stream Motion, text for a line of the Remote Motion Interface.
"""

from pathlib import Path

import pytest
from fanuc_desk import START, T0
from hil_fanuc.controller import FanucController
from hil_fanuc.packets import JOINTS, Command, Report, decode_to_client, decode_to_robot
from hil_fanuc.profile import FanucProfile
from hil_fanuc.rmi import LineReader, Message
from hil_fanuc.rmi_server import Connection, Door

from emulators.orders import Act, ReceivedOrder
from protocol.datagram import Datagram

FOLDER = Path(__file__).parent / "transcripts"


class Replay:
    """Replayed session."""

    def __init__(self, name: str, profile: FanucProfile) -> None:
        self.robot = FanucController(profile, START, T0, 7)
        self.orders: list[ReceivedOrder] = []
        self.robot.orders.listener = self.orders.append
        self.ends: dict[str, Door | Connection] = {}
        self.reports: list[Report] = []
        self.messages: list[Message] = []
        self.commands: list[Command] = []
        self._readers: dict[str, LineReader] = {}
        for line in (FOLDER / name).read_text(encoding="utf-8").splitlines():
            if line and not line.startswith("#"):
                time, channel, size, *rest = line.split(" ", 3)
                self._advance(T0 + float(time))
                self._take(channel, int(size), rest[0] if rest else "", T0 + float(time))

    def _take(self, channel: str, size: int, text: str, now: float) -> None:
        if channel == "open":
            interface = self.robot.interface
            self.ends[text] = Door(interface) if text == "door" else Connection(interface, now)
            self._readers[text] = LineReader()
        elif channel == "close":
            self.ends.pop(text).close(now)
        elif channel == "stream":
            data = bytes.fromhex(text).ljust(size, b"\0")
            if isinstance(packet := decode_to_robot(data), Command):
                self.commands.append(packet)
            self.robot.endpoint.receive([Datagram(data, now, "client")], now)
        else:
            self.ends[channel].receive(text.encode() + b"\r\n", now)
        self._collect(now)

    def _advance(self, until: float) -> None:
        while True:
            due = [self.robot.endpoint, *self.ends.values()]
            times = [at for end in due if (at := end.next_deadline()) is not None and at <= until]
            if not times:
                return
            now = min(times)
            for end in due:
                at = end.next_deadline()
                if at is not None and at <= now:
                    end.handle_deadline(now)
            self._collect(now)

    def _collect(self, now: float) -> None:
        packets = map(decode_to_client, self.robot.endpoint.data_to_send(now))
        self.reports += [packet for packet in packets if isinstance(packet, Report)]
        for name, end in self.ends.items():
            self.messages += self._readers[name].feed(end.data_to_send(now))


@pytest.fixture(scope="module")
def airo() -> Replay:
    return Replay("airo-fanuc.txt", FanucProfile())


def test_airo_fanuc_is_served(airo: Replay) -> None:
    errors = [message["ErrorID"] for message in airo.messages if message.get("ErrorID")]
    assert errors == [2556938], "FRC_Continue of a program that is not paused, which it expects"
    assert not airo.robot.program.alarms.newest
    assert not airo.robot.unmodelled.counts
    assert Act.UNREADABLE not in {order.act for order in airo.orders}


def test_airo_fanuc_moves_the_arm(airo: Replay) -> None:
    assert {command.data_style for command in airo.commands} == {JOINTS}
    assert airo.commands[-1].is_last
    start, end = airo.reports[0].joints, airo.reports[-1].joints
    assert end[5] - start[5] == pytest.approx(4.0, abs=0.02)
    assert end[:5] == pytest.approx(start[:5], abs=1e-4)
    assert airo.robot.server.counts["commands that answer no report"] == 0


def test_fanuc_ucl_moves_the_arm_in_version_2() -> None:
    replay = Replay("fanuc-ucl.txt", FanucProfile(version=2, stream_j3="horizon"))
    assert {(command.version, command.data_style) for command in replay.commands} == {(2, 1)}
    assert not any(message.get("ErrorID") for message in replay.messages)
    assert not replay.robot.program.alarms.newest
    start, end = replay.reports[0].joints, replay.reports[-1].joints
    assert end[5] - start[5] == pytest.approx(4.0, abs=1e-5)
    assert end[:5] == pytest.approx(start[:5], abs=1e-4)
