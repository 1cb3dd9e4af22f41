"""Tests of our client with a program that accepts only axis corrections: straight lines, singularities, limits, a wrong
arm.
"""

import math
from dataclasses import dataclass, field
from typing import Any, Literal

import pytest

from emulators.devices.rsi import RSI_FAULTS, RsiController, RsiProfile
from emulators.devices.rsi.session import State
from emulators.faults import Ledger
from emulators.seams import StartPose
from protocol.devices.rsi import RsiClient, RsiLink, decode, encode, pose_tags
from protocol.devices.rsi.arm import KukaArm
from protocol.geometry import Pose, angle_between, product, turn_about
from protocol.kinematics import Joints
from protocol.robot import ReportReceived, StreamLost, StreamNotice

T0 = 1000.0
TOOL_M = 0.2
AXES_ONLY = {"move_after_ms": 0.0, "restart_s": 0.0, "correction_tag": "None", "axis_tags": ("AK",)}
"""Signal flow without POSCORR."""


@dataclass
class Drive:
    """Client that moves the robot along a path, one set point per cycle."""

    axes: Joints = (0.0, -90.0, 90.0, 0.0, 90.0, 0.0)
    link: dict[str, Any] = field(default_factory=dict)
    cell: dict[str, Any] = field(default_factory=dict)
    channel: Literal["pose", "axes"] = "axes"

    def __post_init__(self) -> None:
        self.arm = KukaArm("kr16-2", TOOL_M)
        self.start = self.arm.pose(self.axes)
        signals = AXES_ONLY if self.channel == "axes" else {**AXES_ONLY, "correction_tag": "RKorr"}
        profile = RsiProfile(mode="absolute", **{**signals, **self.cell})
        self.robot = RsiController(profile, StartPose(*self.start, TOOL_M), T0)
        self.client = RsiClient(RsiLink(mode="absolute", correction=self.channel, **self.link))
        self.now = T0
        self.began = False
        self.notices: list[str] = []
        self.faults: list[str] = []
        self.sent: list[bytes] = []
        self.poses: list[Pose] = []

    def cycle(self, target: Pose, change: Any = lambda raw: raw) -> None:
        due = self.robot.endpoint.next_deadline()
        assert due is not None
        self.robot.endpoint.handle_deadline(due)
        self.now = due
        self.client.receive([change(raw) for raw in self.robot.endpoint.data_to_send(due)], due)
        while (event := self.client.next_event()) is not None:
            match event:
                case ReportReceived(report=report) if self.began:
                    self.faults += [report.fault] if report.fault else []
                    self.client.target(target, due)
                case ReportReceived():
                    self.client.hold(due)
                    self.client.begin(self.start)
                    self.began = True
                case StreamNotice(text=text):
                    self.notices.append(text)
                case StreamLost(text=text):
                    self.faults.append(text)
        self.sent = list(self.client.data_to_send(due))
        self.robot.endpoint.receive(self.sent, due + 0.001)
        self.poses.append(self.robot.ordered_pose)

    def go(self, offset_mm: tuple[float, float, float], turn_deg: float = 0.0, cycles: int = 500) -> Pose:
        """Move along a straight line, with a turn about the base's y axis, in this many cycles; then run a few more."""
        axis = (0.0, math.copysign(1.0, turn_deg), 0.0)
        target = self.start
        for number in range(1, cycles + 101):
            share = min(1.0, number / cycles)
            x, y, z = (
                at + share * offset * 1e-3 for at, offset in zip(self.start.position, offset_mm, strict=True)
            )
            turn = turn_about(axis, math.radians(abs(turn_deg) * share))
            target = Pose((x, y, z), product(turn, self.start.quaternion))
            self.cycle(target)
        return target

    def path_deviation_mm(self, offset_mm: tuple[float, float, float]) -> float:
        """Return the largest distance of an ordered pose from the straight line, mm."""
        length = math.hypot(*offset_mm)
        along = [part / length for part in offset_mm]
        farthest = 0.0
        for pose in self.poses:
            gone = [(to - at) * 1e3 for to, at in zip(pose.position, self.start.position, strict=True)]
            share = sum(a * b for a, b in zip(gone, along, strict=True))
            share = max(0.0, min(length, share))
            farthest = max(farthest, math.dist(gone, [share * a for a in along]))
        return farthest


def test_axis_corrections_move_tool_straight_and_turn_it() -> None:
    drive = Drive()
    target = drive.go((40.0, -60.0, -30.0), turn_deg=10.0)
    ordered = drive.robot.ordered_pose
    assert math.dist(ordered.position, target.position) < 1e-6
    assert angle_between(ordered.quaternion, target.quaternion) < 1e-6
    assert drive.path_deviation_mm((40.0, -60.0, -30.0)) < 0.01
    assert not drive.notices
    assert not drive.faults
    (raw,) = drive.sent
    assert list(decode(raw).values) == [f"AK.A{number}" for number in range(1, 7)]


@pytest.mark.parametrize(
    "offset_mm", [(0.0, 30.0, 0.0), (0.0, 30.0, -10.0), (30.0, 0.5, 0.0), (-40.0, 2.0, -20.0)]
)
def test_tool_near_wrist_singularity_stays_on_path(
    offset_mm: tuple[float, float, float],
) -> None:
    """Axis 5 begins at half a degree: a sideways motion requires a quarter turn of axis 4 at once."""
    drive = Drive(axes=(0.0, -80.0, 100.0, 0.0, 0.5, 0.0))
    drive.go(offset_mm)
    assert drive.path_deviation_mm(offset_mm) < 0.02
    assert drive.robot.state is State.MOVECORR, "no axis was asked for more than it can"


def test_wrist_flip_slows_then_stops_with_report() -> None:
    """The turn requires a quarter turn of axis 4 while axis 5 is near zero."""
    drive = Drive(axes=(0.0, -80.0, 100.0, 90.0, 2.0, -90.0))
    drive.go((0.0, 0.0, 0.0), turn_deg=20.0, cycles=100)
    (notice,) = drive.notices
    assert notice.startswith(
        "axis 6 would turn by 14° in a cycle; allowed: at most 0.4°: a singularity is near"
    )
    assert drive.path_deviation_mm((0.0, 0.0, 1.0)) < 0.02
    assert drive.robot.state is State.MOVECORR
    assert not drive.faults


def test_axis_at_range_limit_stops_with_report() -> None:
    drive = Drive(axes=(0.0, -90.0, 90.0, 0.0, 129.0, 0.0))
    drive.go((0.0, 0.0, 0.0), turn_deg=10.0)
    assert drive.notices == ["no axes of a kr16-2 reach that pose"]
    assert drive.path_deviation_mm((0.0, 0.0, 1.0)) < 0.02
    assert drive.robot.state is State.MOVECORR


def test_sum_of_axis_is_bounded_with_report() -> None:
    drive = Drive(link={"limit_axis_deg": 2.0})
    drive.go((0.0, 100.0, 0.0))
    (notice,) = drive.notices
    assert notice.startswith("axis 1 would be 2.0")
    assert notice.endswith("away from the robot's program; allowed: at most 2°")
    assert abs(drive.robot.ordered_pose.position[1]) < 0.1
    assert drive.path_deviation_mm((0.0, 100.0, 0.0)) < 0.02


@pytest.mark.parametrize("element", ["RSol", "AIPos", "ASPos"])
def test_telegram_without_kinematics_data_is_named(element: str) -> None:
    send = tuple(f"DEF_{name}" for name in ("RIst", "RSol", "AIPos", "ASPos") if name != element)
    drive = Drive(cell={"send": send})
    x, y, z = drive.start.position
    for number in range(20):
        drive.cycle(Pose((x, y, z - number * 1e-4), drive.start.quaternion))
    assert set(drive.faults) == {f"its telegrams have no {element}, which a correction of the axes needs"}
    assert drive.robot.ordered_pose == drive.poses[0]


def test_wrong_base_or_arm_is_detected_in_motion() -> None:
    """The program's base is turned by 90° about z: the robot moves sideways, and is stopped by that."""

    def turned(raw: bytes) -> bytes:
        telegram = decode(raw)
        values = dict(telegram.values)
        for element in ("RIst", "RSol"):
            x, y, *_, a, _, _ = (float(values[tag]) for tag in pose_tags(element))
            values.update({f"{element}.X": f"{y}", f"{element}.Y": f"{-x}", f"{element}.A": f"{a - 90.0}"})
        return encode(telegram._replace(values=values))

    drive = Drive()
    (x, y, z), quaternion = drive.start
    drive.start = Pose((y, -x, z), product(turn_about((0.0, 0.0, -1.0), math.pi / 2.0), quaternion))
    for number in range(300):
        x, y, z = drive.start.position
        drive.cycle(Pose((x + number * 1e-4, y, z), drive.start.quaternion), turned)
    assert "mm away from its pose, by the dimensions of a kr16-2" in drive.faults[0]
    gone = math.dist(drive.robot.ordered_pose.position, drive.arm.pose(drive.axes).position)
    assert 0.5e-3 < gone < 5e-3


def test_non_finite_axes_move_nothing() -> None:
    drive = Drive()
    for number in range(50):
        x, y, z = drive.start.position
        drive.cycle(
            Pose((x, y, z - number * 1e-4), drive.start.quaternion),
            lambda raw: raw.replace(b'A1="', b'A1="x'),
        )
    assert set(drive.faults) == {"its axes are not numeric"}
    assert drive.robot.ordered_pose == drive.poses[0]


@pytest.mark.parametrize("channel", ["pose", "axes"])
def test_turned_tool_keeps_orientation_at_clock_jump(
    channel: Literal["pose", "axes"],
) -> None:
    """Its position is where the program began, but the correction is not zero; the next answer once was zero."""
    drive = Drive(channel=channel)
    target = drive.go((0.0, 0.0, 0.0), turn_deg=8.0)
    ledger = Ledger(RSI_FAULTS)
    ledger.attach("robot", drive.robot.handlers["robot"])
    ledger.inject("robot", "clock-jump", drive.now, {})
    drive.began, drive.start = False, target
    for _ in range(3):
        drive.cycle(target)
    assert drive.robot.state is State.MOVECORR, drive.robot.error
    assert angle_between(drive.robot.ordered_pose.quaternion, target.quaternion) < math.radians(0.01)
