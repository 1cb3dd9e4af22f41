"""Sessions of the maker's client, xarm-python-sdk, replayed to the emulated control box.

A line is a time in s, and `open`, `close` with a connection, or a connection with the data that it sends, hexadecimal.
"""

from pathlib import Path
from typing import Any

import pytest
from hil_xarm.force import ForceSensor
from hil_xarm.frames import Bit, FrameReader, Function, Reply
from hil_xarm.profile import XarmProfile
from hil_xarm.reports import LAYOUTS, Port, ReportReader
from hil_xarm.robot import XarmRobot
from xarm_desk import START, T0

from emulators.orders import Act, ReceivedOrder
from emulators.sensing import SteppedWrench

FOLDER = Path(__file__).parent / "transcripts"
LOAD = (1.0, -2.0, 4.9, 0.1, 0.0, 0.0)


class Replay:
    """Replayed session."""

    def __init__(self, name: str) -> None:
        profile = XarmProfile()
        self.robot = XarmRobot(profile, START, T0, 7)
        self.robot.equip(ForceSensor(profile, SteppedWrench(LOAD), T0, 7))
        self.orders: list[ReceivedOrder] = []
        self.robot.orders.listener = self.orders.append
        self.ends: dict[str, Any] = {}
        self.answers = b""
        self.replies: list[Reply] = []
        self.reports: list[dict[str, Any]] = []
        self._frames, self._reader = FrameReader(), ReportReader()
        for line in (FOLDER / name).read_text(encoding="utf-8").splitlines():
            if not line.startswith("#"):
                time, what, text = line.split()
                self._advance(T0 + float(time))
                self._take(what, text, T0 + float(time))

    def _take(self, what: str, text: str, now: float) -> None:
        if what == "open":
            self.ends[text] = self.robot.connect(Port(text.partition("-")[0]), now)
        elif what == "close":
            self.robot.leave(Port(text.partition("-")[0]), self.ends.pop(text), now)
        else:
            self.ends[what].receive(bytes.fromhex(text), now)

    def _advance(self, until: float) -> None:
        while True:
            due = {name: at for name, end in self.ends.items() if (at := end.next_deadline()) is not None}
            name = min(due, key=lambda one: due[one], default="")
            if not name or due[name] > until:
                return
            end = self.ends[name]
            end.handle_deadline(due[name])
            data = end.data_to_send(due[name])
            if name.startswith("command"):
                self.answers += data
            else:
                self.reports += [LAYOUTS[len(report)].decode(report) for report in self._reader.feed(data)]

    def read_replies(self) -> list[Reply]:
        """Return all replies to commands."""
        return [frame.as_reply() for frame in self._frames.feed(self.answers)]


@pytest.fixture(scope="module")
def servo() -> Replay:
    return Replay("xarm-python-sdk-servo.txt")


def test_sdk_moves_the_arm_in_servo_mode(servo: Replay) -> None:
    replies = servo.read_replies()
    moves = [reply for reply in replies if reply.function == Function.SERVO_POSE]
    assert len(moves) == 60
    assert {reply.state for reply in moves} == {0}
    assert servo.reports[-1]["pose"][1] == pytest.approx(-88.6, abs=0.1)
    assert Act.UNREADABLE not in {order.act for order in servo.orders}
    assert not servo.robot.unmodelled.counts
    assert servo.robot.box.error == 0


def test_sdk_switches_the_sensor_on_and_sets_its_zero(servo: Replay) -> None:
    (force,) = [reply for reply in servo.read_replies() if reply.function == Function.FORCE]
    assert not force.state & Bit.ERROR
    newest = servo.reports[-1]
    assert newest["raw"] == pytest.approx(LOAD, abs=1.0)
    assert newest["external"] == pytest.approx((0.0,) * 6, abs=1.0)
    assert servo.robot.box.sensor is not None
    assert servo.robot.box.sensor.zero[:3] == pytest.approx(LOAD[:3], abs=0.5)


def test_sdk_reads_and_writes_modbus_registers() -> None:
    replay = Replay("xarm-python-sdk-modbus.txt")
    answers = [frame for frame in FrameReader().feed(replay.answers) if frame.protocol == 0]
    errors, pose, joints, *rest = (frame.body[1:] for frame in answers)
    assert errors.hex() == "040400000000"
    words = [int.from_bytes(pose[2 + 2 * k : 4 + 2 * k], "big", signed=True) for k in range(9)]
    assert words == [4000, -1000, 2000, 1800, 0, 0, 1800, 0, 0]
    assert joints[:2] == bytes((4, 14))
    assert [body.hex() for body in rest] == [
        "0600200001",
        "0600210000",
        "030400010002",
        "010100",
        "8201",
    ]
    assert replay.robot.box.mode == 1
