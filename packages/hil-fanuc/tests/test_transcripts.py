"""Sessions of other programs, replayed to the emulated controller.

A line is a time in s, a connection, the number of bytes, and the data: hexadecimal without trailing zeros for a
datagram of Stream Motion, text for a line of the Remote Motion Interface. The operator starts the TP program.
"""

from pathlib import Path

import pytest
from fanuc_desk import START, T0
from hil_fanuc.arms import FanucArm
from hil_fanuc.controller import FanucController
from hil_fanuc.packets import JOINTS, Command, Report, decode_to_client, decode_to_robot
from hil_fanuc.panel import FANUC_CONTROLS
from hil_fanuc.profile import FanucProfile
from hil_fanuc.rmi import LineReader, Message, ProgramStatus
from hil_fanuc.rmi_server import Connection, Door

from emulators.arm.chain import straight_tool
from emulators.orders import Act, ReceivedOrder
from emulators.seams import StartPose
from protocol.datagram import Datagram

FOLDER = Path(__file__).parent / "transcripts"
HOME = 0.0, 0.0, 0.0, 0.0, -90.0, 0.0


class Replay:
    """Replayed session."""

    def __init__(self, name: str, profile: FanucProfile, start: StartPose = START) -> None:
        self.robot = FanucController(profile, start, T0, 7)
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
        elif channel == "operator":
            FANUC_CONTROLS.controls["program"].move("program", self.robot, text, now)
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


def test_client_of_the_maker_moves_the_arm() -> None:
    """A motion to `HOME` over RMI, then a sine of ±20° of all joints, limited by the largest speed of the tool."""
    replay = Replay("fanuc-driver-client.txt", FanucProfile())
    assert not any(message.get("ErrorID") for message in replay.messages)
    assert not replay.robot.program.alarms.newest
    assert {command.data_style for command in replay.commands} == {JOINTS}
    assert replay.reports[0].joints[:6] == pytest.approx(HOME, abs=0.01)
    largest = [max(abs(one.joints[axis] - HOME[axis]) for one in replay.reports) for axis in range(6)]
    assert largest[2:] == pytest.approx([40.0] * 4, abs=1.0)
    assert min(largest[:2]) > 30.0
    assert replay.robot.server.counts["commands that answer no report"] == 0


def test_rmi_example_of_the_maker_is_answered() -> None:
    home = FanucArm("crx-10ia/l", straight_tool(0.2)).pose(HOME)
    start = StartPose(home.position, home.quaternion, 0.2)
    replay = Replay("fanuc-driver-rmi.txt", FanucProfile(), start)
    assert not any(message.get("ErrorID") for message in replay.messages)
    numbers = [message["SequenceID"] for message in replay.messages if "Instruction" in message]
    assert numbers == [1, 2, 3, 4, 5]
    programs = [message["ProgramStatus"] for message in replay.messages if "ProgramStatus" in message]
    held, running = ProgramStatus.HELD, ProgramStatus.RUNNING
    assert programs == [ProgramStatus.CANCELLED, held, running, running, held]
    assert replay.robot.motion.joints == pytest.approx((0.0, 10.0, 10.0, 0.0, -90.0, 0.0), abs=0.01)


def test_fanuc_rmi_is_answered_in_order() -> None:
    replay = Replay("fanuc-rmi.txt", FanucProfile())
    assert not any(message.get("ErrorID") for message in replay.messages)
    names = [message["Instruction"] for message in replay.messages if "Instruction" in message]
    motions = "LinearRelative", "LinearMotion", "JointRelativeJRep", "JointMotionJRep"
    assert names == [f"FRC_{name}" for name in ("WaitTime", *motions, "SetUFrame", "SetUTool")]
    moved = [(order.at, order.pose) for order in replay.orders if order.act is Act.MOTION]
    assert len(moved) == len(motions)
    assert replay.robot.motion.joints == pytest.approx((0.0, 30.0, 40.0, 0.0, -100.0, 0.0), abs=0.01)


@pytest.mark.parametrize(("name", "axis", "by"), [("joint", 0, 5.0), ("cartesian", 2, 3.774)])
def test_stream_motion_interface_moves_the_arm(name: str, axis: int, by: float) -> None:
    """Packets of version 1 in a session of version 3, with a TP program that the operator has started."""
    replay = Replay(f"stream-motion-interface-{name}.txt", FanucProfile())
    assert replay.commands[-1].is_last
    assert replay.reports[-1].joints[axis] - replay.reports[0].joints[axis] == pytest.approx(by, abs=0.01)
    assert replay.robot.server.counts["commands that answer no report"] == 0


def test_old_software_refuses_the_jerk_of_a_client() -> None:
    replay = Replay("stream-motion-interface-cartesian.txt", FanucProfile(refusals="alarm"))
    assert list(replay.robot.program.alarms.newest) == ["MOTN-722 Cartesian jerk limit over (G:1, A:3)"]
    joint = Replay("stream-motion-interface-joint.txt", FanucProfile(refusals="alarm"))
    assert not joint.robot.program.alarms.newest
