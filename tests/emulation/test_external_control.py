"""Tests of external control of the emulated Universal Robot in virtual time: a program that connects to its client.

The client in this file behaves like Universal Robots' C++ client library. The program is ours, because the maker's own
belongs to its authors; `tests/wire/transcripts` contains what the library itself sends.
"""

import math
import struct

import pytest

from emulators.devices.rtde import RTDE_FAULTS, RtdeProfile, RtdeRobot, Server
from emulators.devices.rtde.program_socket import ProgramSocket
from emulators.devices.rtde.urscript import Message
from emulators.faults import Ledger
from emulators.seams import StartPose
from protocol.devices.rtde.rotation import six_of
from protocol.devices.rtde.states import Runtime, SafetyMode
from protocol.devices.rtde.wires import Port
from protocol.geometry import Vector
from tests.emulation.exact_arm import exact_profile
from tools.external_control import (
    COMMANDS,
    REVERSE,
    TRAJECTORY,
    Command,
    Forward,
    Freedrive,
    Mode,
    Motion,
    Order,
    Point,
    Result,
    Spline,
    control_program,
    encode_command,
    read_results,
)

START = StartPose((0.9, -0.1, 0.6), (0.0, 1.0, 0.0, 0.0), 0.2)
NEW = exact_profile(version="5.21.0.0")
"""First version with all functions of the program."""
T0, DT = 1000.25, 0.002
SURFACE_Z = 0.598
"""Height of the surface, m: 2 mm below the tool at the start."""
Six = tuple[float, ...]


class Driver:
    """Client with its three servers, the controller with a surface below its tool, and the time."""

    def __init__(self, profile: RtdeProfile = NEW, absent: frozenset[int] = frozenset()) -> None:
        """Nothing listens on a port that is absent."""
        self.now = T0
        self.robot = RtdeRobot(profile, START, T0, 7)
        self.controller = self.robot.controller
        self.robot.feel(self.contact)
        self.stiffness = 20e3
        self.ledger = Ledger(RTDE_FAULTS)
        for target, handlers in self.robot.handlers.items():
            self.ledger.attach(target, handlers)
        self.opened: list[int] = []
        self.ends: dict[int, Server] = {}
        self.received = {TRAJECTORY: b"", COMMANDS: b"", REVERSE: b""}
        self._absent = absent
        self.controller.console.open_socket = self._open
        port = self.robot.connect(Port.PRIMARY, self.now)
        assert port is not None
        self.port = port

    def contact(self, at: float) -> Vector:
        return 0.0, 0.0, max(0.0, (SURFACE_Z - self.place[2]) * self.stiffness)

    def _open(self, host: str, port: int) -> ProgramSocket | None:
        self.opened.append(port)
        if port in self._absent:
            return None
        server, inner = self.robot.connect_program(self.now)
        inner.opened()
        self.ends[port] = server
        return inner

    def upload(self) -> "Driver":
        self.port.receive(control_program().encode(), self.now)
        return self.run(0.1)

    def run(self, seconds: float) -> "Driver":
        for _ in range(round(seconds / DT)):
            self.now += DT
            self.ledger.handle_deadline(self.now)
            for port, server in self.ends.items():
                server.handle_deadline(self.now)
                self.received[port] += server.data_to_send(self.now)
            self.controller.advance(self.now)
        return self

    def order(self, mode: Mode, values: Six = (0.0,) * 6, timeout_ms: int = 20) -> None:
        """Send one message to the reverse port, values in SI units."""
        millionths = tuple(round(value * 1e6) for value in values)
        self.ends[REVERSE].receive(Order(timeout_ms, millionths, mode).encode(), self.now)

    def act(self, mode: Mode, first: int, second: int = 0, timeout_ms: int = 0) -> "Driver":
        """Send one message whose values are not quantities."""
        values = (first, second, 0, 0, 0, 0)
        self.ends[REVERSE].receive(Order(timeout_ms, values, mode).encode(), self.now)
        return self.run(DT)

    def stream(self, seconds: float, mode: Mode, values: Six, timeout_ms: int = 20) -> "Driver":
        """Send a message in each cycle."""
        for _ in range(round(seconds / DT)):
            self.order(mode, values, timeout_ms)
            self.run(DT)
        return self

    def forward(self, *points: Point, seconds: float) -> list[Result]:
        """Let points be followed for a time; return the answers."""
        self.act(Mode.FORWARD, Forward.START, len(points))
        self.add(*points)
        return self.run(seconds).results

    def add(self, *points: Point) -> None:
        self.ends[TRAJECTORY].receive(b"".join(point.encode() for point in points), self.now)

    def command(self, command: Command, *values: float) -> "Driver":
        self.ends[COMMANDS].receive(encode_command(command, *values), self.now)
        return self.run(2 * DT)

    @property
    def results(self) -> list[Result]:
        return read_results(self.received[TRAJECTORY])

    @property
    def joints(self) -> Six:
        return self.controller.arm.joints

    @property
    def place(self) -> Vector:
        return self.controller.path.pose.position

    @property
    def pose(self) -> Six:
        return six_of(self.controller.path.pose)

    @property
    def plays(self) -> bool:
        return self.controller.player.runtime == Runtime.PLAYING

    def messages(self, kind: Message) -> list[str]:
        return [str(each) for each in self.controller.console.program_messages if each.message == kind]


@pytest.fixture
def driver() -> Driver:
    """Return a client to which the program has connected."""
    return Driver().upload()


def offset_joints(joints: Six, by: float, joint: int = 0) -> Six:
    return tuple(value + (by if number == joint else 0.0) for number, value in enumerate(joints))


def test_program_connects_in_observed_order(driver: Driver) -> None:
    assert driver.opened == [TRAJECTORY, COMMANDS, REVERSE]
    before = driver.joints
    driver.run(3.0)
    assert driver.plays
    assert driver.joints == before


def test_unreachable_client_is_tried_five_times() -> None:
    driver = Driver(absent=frozenset({COMMANDS})).upload().run(1.2)
    assert driver.opened == [TRAJECTORY] + 5 * [COMMANDS]
    assert driver.messages(Message.POPUP) == ["the client does not answer"]
    assert not driver.plays
    assert driver.ends[TRAJECTORY].closing


@pytest.mark.parametrize("mode", [Mode.SERVOJ, Mode.POSE])
def test_arm_reaches_servo_target(driver: Driver, mode: Mode) -> None:
    if mode is Mode.SERVOJ:
        target = offset_joints(driver.joints, 0.01)
        driver.stream(0.6, mode, target)
        assert driver.joints == pytest.approx(target, abs=2e-6)
    else:
        target = offset_joints(driver.pose, 0.005, 2)
        driver.stream(0.6, mode, target)
        assert driver.place == pytest.approx(target[:3], abs=1e-5)


@pytest.mark.parametrize("mode", [Mode.SPEEDJ, Mode.SPEEDL])
def test_arm_moves_at_ordered_speed_then_stops(driver: Driver, mode: Mode) -> None:
    speed = (0.0, 0.1, 0.0, 0.0, 0.0, 0.0)
    driver.stream(0.2, mode, speed)
    joint, y = driver.joints[1], driver.place[1]
    driver.stream(0.2, mode, speed)
    distance = driver.joints[1] - joint if mode is Mode.SPEEDJ else driver.place[1] - y
    assert distance == pytest.approx(0.02, abs=1e-4)
    driver.stream(0.1, Mode.IDLE, (0.0,) * 6)
    assert driver.controller.manipulator.still
    assert driver.plays


@pytest.mark.parametrize("mode", [Mode.SERVOJ, Mode.SPEEDL])
def test_silent_client_stops_arm_and_program(driver: Driver, mode: Mode) -> None:
    driver.stream(0.1, mode, driver.joints if mode is Mode.SERVOJ else (0.0, 0.05, 0.0, 0.0, 0.0, 0.0))
    driver.run(0.018)
    assert driver.plays
    driver.run(0.3)
    assert not driver.plays
    assert driver.messages(Message.TEXT) == ["the client is silent"]
    assert driver.controller.manipulator.still
    assert driver.controller.state.safety == SafetyMode.NORMAL


@pytest.mark.parametrize(("fault", "lives"), [("late", True), ("deaf", False)])
def test_late_orders_act_and_lost_orders_end_program(driver: Driver, fault: str, lives: bool) -> None:
    driver.stream(0.05, Mode.SERVOJ, driver.joints)
    driver.ledger.inject("program-wire", fault, driver.now, {"ms": 10} if fault == "late" else {})
    driver.stream(0.2, Mode.SERVOJ, driver.joints)
    assert driver.plays is lives


def test_stop_order_ends_program_and_connections(driver: Driver) -> None:
    driver.stream(0.1, Mode.SPEEDJ, (0.1, 0.0, 0.0, 0.0, 0.0, 0.0))
    driver.order(Mode.STOPPED)
    driver.run(0.3)
    assert not driver.plays
    assert driver.controller.manipulator.still
    assert all(server.closing for server in driver.ends.values())


# --- trajectories


def test_points_of_every_motion_kind_are_followed(driver: Driver) -> None:
    joints, pose = driver.joints, driver.pose
    rest = (0.5, 0.5, 0.0, 0.0, 0.0, 0.0)
    up, aside = offset_joints(pose, 0.01, 2), offset_joints(pose, 0.01, 1)
    via = offset_joints(aside, 0.01, 2)
    turned = offset_joints(joints, 0.05, 5)
    points = [
        Point(Motion.MOVEJ, turned, rest=rest),
        Point(Motion.MOVEJ_POSE, pose, rest=rest),
        Point(Motion.MOVEL, up, rest=rest),
        Point(Motion.MOVEL_JOINT, joints, rest=rest),
        Point(Motion.MOVEP, up, rest=rest),
        Point(Motion.MOVEP_JOINT, joints, rest=rest),
        Point(Motion.OPTIMOVEJ, turned, rest=rest),
        Point(Motion.OPTIMOVEJ_POSE, pose, rest=rest),
        Point(Motion.OPTIMOVEL, up, rest=rest),
        Point(Motion.OPTIMOVEL_JOINT, joints, rest=rest),
        Point(Motion.MOVEC, aside, via, rest),
    ]
    for count in range(1, len(points) + 1):
        assert driver.forward(points[count - 1], seconds=1.0) == count * [Result.SUCCESS]
    assert driver.place == pytest.approx(aside[:3], abs=1e-6)
    assert driver.forward(*points[:4], seconds=4.0)[-1] == Result.SUCCESS
    assert driver.joints == pytest.approx(joints, abs=1e-5), "a row of points"


def test_point_takes_requested_time(driver: Driver) -> None:
    target = offset_joints(driver.joints, 0.1)
    assert driver.forward(Point(Motion.MOVEJ, target, time=1.0), seconds=0.98) == []
    assert driver.run(0.1).results == [Result.SUCCESS]


@pytest.mark.parametrize("kind", Spline)
def test_spline_passes_through_points(driver: Driver, kind: Spline) -> None:
    joints = driver.joints
    middle, end = offset_joints(joints, 0.05), offset_joints(joints, 0.1)
    speeds = offset_joints((0.0,) * 6, 0.15)
    points = [
        Point(Motion.SPLINE, middle, speeds, time=0.5, blend=kind),
        Point(Motion.SPLINE, end, time=0.5, blend=kind),
    ]
    assert driver.forward(*points, seconds=0.5) == []
    assert driver.joints[0] == pytest.approx(middle[0], abs=2e-3)
    assert driver.run(0.7).results == [Result.SUCCESS]
    assert driver.joints == pytest.approx(end, abs=1e-3)


def test_incomplete_or_unknown_trajectory_fails(driver: Driver) -> None:
    point = Point(Motion.MOVEJ, driver.joints, rest=(1.0, 1.0, 0.0, 0.0, 0.0, 0.0))
    driver.act(Mode.FORWARD, Forward.START, 2)
    driver.add(point)
    assert driver.run(0.4).results == []
    assert driver.run(0.3).results == [Result.FAILURE]
    assert driver.forward(point._replace(kind=99), seconds=0.2) == 2 * [Result.FAILURE]
    assert driver.plays


def test_cancelled_trajectory_is_replaced_by_next(driver: Driver) -> None:
    start = driver.joints
    slow = Point(Motion.MOVEJ, offset_joints(start, 0.5), time=5.0)
    driver.forward(slow, slow, seconds=0.5)
    driver.act(Mode.FORWARD, Forward.CANCEL)
    assert driver.run(0.3).results == [Result.CANCELLED]
    assert driver.controller.manipulator.still
    assert 0.0 < driver.joints[0] - start[0] < 0.1
    back = Point(Motion.MOVEJ, start, rest=(1.0, 1.0, 0.0, 0.0, 0.0, 0.0))
    assert driver.forward(back, seconds=1.0) == [Result.CANCELLED, Result.SUCCESS]
    assert driver.joints == pytest.approx(start, abs=1e-6)


def test_mode_change_cancels_trajectory(driver: Driver) -> None:
    driver.forward(Point(Motion.MOVEJ, offset_joints(driver.joints, 0.5), time=5.0), seconds=0.5)
    driver.order(Mode.IDLE, timeout_ms=0)
    assert driver.run(0.3).results == [Result.CANCELLED]
    assert driver.controller.manipulator.still


def test_points_stream_until_count_is_given(driver: Driver) -> None:
    joints = driver.joints
    driver.act(Mode.FORWARD, Forward.STREAM_START)
    for number in range(1, 6):
        blend = Spline.CUBIC
        speeds = offset_joints((0.0,) * 6, 0.1 if number < 5 else 0.0)
        driver.add(Point(Motion.SPLINE, offset_joints(joints, 0.01 * number), speeds, time=0.1, blend=blend))
        driver.run(0.08)
        driver.act(Mode.FORWARD, Forward.NOTHING)
    driver.act(Mode.FORWARD, Forward.STREAM_END, 5)
    assert driver.run(0.5).results == [Result.SUCCESS]
    assert driver.joints == pytest.approx(offset_joints(joints, 0.05), abs=1e-3)


def test_protective_stop_pauses_trajectory_and_play_resumes(driver: Driver) -> None:
    target = offset_joints(driver.joints, 0.2)
    driver.forward(Point(Motion.MOVEJ, target, time=2.0), seconds=1.0)
    driver.controller.protective_stop("a test")
    stopped = driver.run(0.1).joints
    driver.run(5.0)
    assert (driver.joints, driver.results) == (stopped, [])
    assert driver.controller.state.unlock(driver.controller.now)
    assert driver.controller.play()
    assert driver.run(1.2).results == [Result.SUCCESS]
    assert driver.joints == pytest.approx(target, abs=1e-6)


def test_move_beyond_joint_range_ends_program(driver: Driver) -> None:
    before = driver.joints
    assert driver.forward(Point(Motion.MOVEJ, (-123.0, *before[1:]), time=1.0), seconds=0.2) == []
    assert not driver.plays
    assert driver.joints == before
    assert driver.ends[TRAJECTORY].closing


# --- commands, answered by the contact


def force_mode(driver: Driver, force_n: float) -> Driver:
    frame, limits = (0.0,) * 6, (0.1, 0.1, 0.1, 0.2, 0.2, 0.2)
    axes, wrench = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0), (0.0, 0.0, -force_n, 0.0, 0.0, 0.0)
    return driver.command(Command.START_FORCE_MODE, *frame, *axes, *wrench, 2.0, *limits, 0.005, 1.0)


def test_force_mode_presses_until_ended(driver: Driver) -> None:
    driver.order(Mode.IDLE, timeout_ms=0)
    force_mode(driver, 10.0).run(3.0)
    assert driver.contact(driver.now)[2] == pytest.approx(10.0, abs=0.1)
    driver.command(Command.END_FORCE_MODE).run(0.1)
    assert not driver.controller.compliance.on
    height = driver.place[2]
    assert driver.run(0.5).place[2] == pytest.approx(height, abs=1e-9)


def test_contact_during_motion_returns_tool_to_start(driver: Driver) -> None:
    driver.command(Command.START_TOOL_CONTACT)
    down = (0.0, 0.0, -0.01, 0.0, 0.0, 0.0)
    driver.stream(0.6, Mode.SPEEDL, down)
    assert read_results(driver.received[COMMANDS]) == [Result.SUCCESS]
    assert driver.contact(driver.now)[2] < 5.0
    height = driver.place[2]
    driver.stream(0.2, Mode.SPEEDL, down)
    assert driver.place[2] == pytest.approx(height, abs=1e-6), "it obeys no motion before the look ends"
    driver.command(Command.END_TOOL_CONTACT)
    assert read_results(driver.received[COMMANDS]) == [Result.SUCCESS], (
        "a look that has found is not cancelled"
    )
    driver.stream(0.5, Mode.SPEEDL, (0.0, 0.0, 0.01, 0.0, 0.0, 0.0))
    assert driver.place[2] > SURFACE_Z


def test_contact_search_without_contact_is_cancelled(driver: Driver) -> None:
    driver.command(Command.START_TOOL_CONTACT)
    driver.stream(0.1, Mode.SPEEDL, (0.0, 0.01, 0.0, 0.0, 0.0, 0.0))
    driver.command(Command.END_TOOL_CONTACT)
    assert read_results(driver.received[COMMANDS]) == [Result.CANCELLED]


def test_contact_ends_trajectory(driver: Driver) -> None:
    driver.command(Command.START_TOOL_CONTACT)
    down = Point(Motion.MOVEL, offset_joints(driver.pose, -0.02, 2), time=2.0)
    driver.forward(down, seconds=1.5)
    assert read_results(driver.received[COMMANDS]) == [Result.SUCCESS]
    assert driver.place[2] > SURFACE_Z - 1e-3


def test_commands_set_their_values(driver: Driver) -> None:
    controller = driver.controller
    driver.command(Command.SET_PAYLOAD, 1.5, 0.0, 0.01, 0.05)
    assert controller.force.payload == pytest.approx((1.5, 0.0, 0.01, 0.05))
    driver.command(Command.SET_TARGET_PAYLOAD, 0.5, 0.0, 0.0, 0.02)
    assert controller.force.payload == pytest.approx((0.5, 0.0, 0.0, 0.02))
    driver.command(Command.SET_TCP_OFFSET, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0)
    assert controller.manipulator.tcp.position == pytest.approx((0.0, 0.0, 0.1))
    driver.ends[COMMANDS].receive(
        struct.pack(">28i", Command.FT_RTDE_INPUT_ENABLE, 1, *26 * (0,)), driver.now
    )
    driver.run(2 * DT)
    assert controller.force.external


def test_zero_removes_contact_force(driver: Driver) -> None:
    driver.stream(0.5, Mode.SPEEDL, (0.0, 0.0, -0.01, 0.0, 0.0, 0.0))
    driver.stream(0.3, Mode.IDLE, (0.0,) * 6)
    assert driver.controller.snapshots[-1].force[2] > 30.0
    driver.order(Mode.IDLE, timeout_ms=0)
    driver.command(Command.ZERO_FTSENSOR).run(0.05)
    assert driver.controller.snapshots[-1].force[2] == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize("command", [Command.SET_TOOL_VOLTAGE, Command.SET_GRAVITY])
def test_unmodelled_command_is_reported_without_effect(driver: Driver, command: Command) -> None:
    driver.order(Mode.IDLE, timeout_ms=0)
    driver.command(command, 12.0, 0.0, 0.0)
    assert driver.controller.unmodelled.counts == {f"URScript {command.name.lower()}()": 1}
    assert driver.plays


def test_freedrive_follows_hand_until_ended(driver: Driver) -> None:
    driver.robot.feel(lambda at: (0.0, 40.0, 0.0))
    driver.act(Mode.FREEDRIVE, Freedrive.START)
    y = driver.place[1]
    assert driver.run(0.3).place[1] > y + 0.003
    driver.act(Mode.FREEDRIVE, Freedrive.STOP)
    y = driver.run(0.2).place[1]
    assert driver.run(0.3).place[1] == pytest.approx(y, abs=1e-9)
    driver.act(Mode.FREEDRIVE, Freedrive.START).run(0.1)
    driver.order(Mode.IDLE, timeout_ms=0)
    y = driver.run(0.2).place[1]
    assert driver.run(0.3).place[1] == pytest.approx(y, abs=1e-9), "another mode ends it"


def test_invalid_pose_moves_nothing(driver: Driver) -> None:
    """A pose out of reach has no joints: the program ends, and the arm does not move."""
    before = driver.joints
    driver.order(Mode.POSE, (9.0, 9.0, 9.0, 0.0, 0.0, 0.0))
    driver.run(0.2)
    assert not driver.plays
    assert math.dist(driver.joints, before) < 1e-9
