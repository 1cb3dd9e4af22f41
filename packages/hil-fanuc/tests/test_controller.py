"""Emulated controller, packet by packet. Observed behaviour: airo-ugent/airo-fanuc, docs/controller-notes.md."""

import itertools
import math
from typing import Literal

import pytest
from fanuc_desk import Desk, alarms, started
from hil_fanuc.limits import JointLimiter
from hil_fanuc.packets import (
    CARTESIAN,
    JOINTS,
    Capability,
    Command,
    CommandPosition,
    ForceSensor,
    GpioRequest,
    GpioResult,
    Kind,
    Signal,
    Status,
    Threshold,
    ThresholdRequest,
    nine,
)
from hil_fanuc.profile import FanucProfile
from hil_fanuc.rmi import ProgramStatus

from protocol.arm_size import PerAxis

OLD = FanucProfile(refusals="alarm")


# --- session


def test_reports_begin_with_start_and_end_with_stop() -> None:
    desk = Desk()
    desk.wait(0.1)
    assert desk.packets == []
    desk.signal(Kind.START)
    desk.wait(0.4)
    reports = desk.reports
    assert [report.sequence for report in reports] == list(range(1, 51))
    assert {round(b.time_s - a.time_s, 6) for a, b in itertools.pairwise(reports)} == {0.008}
    assert not any(report.status & Status.READY for report in reports), "its TP program was not called"
    desk.signal(Kind.STOP)
    desk.wait(0.1)
    assert len(desk.reports) == 50


def test_it_is_ready_once_program_and_stream_run() -> None:
    desk = Desk()
    assert desk.call() == 0
    desk.signal(Kind.START)
    began = desk.now
    desk.wait(0.19)
    assert not desk.report.status & Status.READY
    desk.wait(0.02)
    assert desk.report.status & Status.READY
    assert desk.report.status >> 4 == 8
    assert desk.now - began < 0.22


def test_further_call_is_not_ready_for_a_second() -> None:
    desk = started()
    assert desk.call() == 0
    begin = desk.now
    assert not desk.report.status & Status.READY
    desk.wait(0.95)
    assert not desk.report.status & Status.READY
    desk.wait(1.05 - (desk.now - begin))
    assert desk.report.status & Status.READY


def test_abort_stops_the_program_but_not_the_reports() -> None:
    desk = started()
    assert desk.ask({"Command": "FRC_Abort"})["ErrorID"] == 0
    count = len(desk.reports)
    desk.wait(0.4)
    assert len(desk.reports) == count + 50
    assert not desk.report.status & Status.READY
    assert desk.ask({"Command": "FRC_GetStatus"})["ProgramStatus"] == 2


def test_capability_and_thresholds_are_answered_to_anyone() -> None:
    desk = Desk()
    desk.send(Capability(Kind.GET_CAPABILITY, 3), "other")
    desk.send(ThresholdRequest(3, 4, 2), "other")
    assert desk.others[0] == Capability(Kind.GET_CAPABILITY, 3, 1, 8, 0, 3, 0)
    table = desk.others[1]
    assert table == Threshold(3, 4, 2, 2000, 8, (1860.0,) * 20, (1860.0,) * 20)
    assert desk.packets == []


def test_gpio_configuration_is_answered() -> None:
    desk = Desk()
    desk.send(GpioRequest(3, ()))
    assert desk.packets == [GpioResult(0, 1)]


# --- refusals of a session


def test_start_without_stop_raises_an_alarm() -> None:
    desk = started()
    desk.signal(Kind.START)
    assert alarms(desk) == ["MOTN-607"]


def test_second_peer_raises_an_alarm_and_is_not_served() -> None:
    desk = started()
    desk.signal(Kind.START, "other")
    desk.wait(0.1)
    assert desk.robot.program.alarms.active == ["HOST-380 System error 0x30,0x0"]
    assert desk.others == []
    assert desk.report.robot_status == 1


def test_stop_of_a_stranger_ends_the_session() -> None:
    desk = started()
    desk.signal(Kind.STOP, "other")
    count = len(desk.reports)
    desk.wait(0.1)
    assert len(desk.reports) == count
    hindrance = desk.robot.hindrance(desk.now)
    assert hindrance is not None
    assert not hindrance.by_order


def test_commands_of_a_stranger_are_ignored() -> None:
    desk = started()
    joints = list(desk.report.joints[:6])
    joints[0] += 0.0001
    desk.send(Command(3, desk.report.sequence, nine(joints)), "other")
    desk.wait(0.5)
    assert desk.robot.targets.accepted == 0


@pytest.mark.parametrize("version", [3, 4])
def test_force_sensor_needs_version_4(version: int) -> None:
    desk = started(FanucProfile(version=version))  # type: ignore[arg-type]
    desk.send(ForceSensor(version, 1, 1))
    assert desk.robot.program.alarms.active == (["HOST-380 System error 0x19,0x0"] if version == 3 else [])


# --- set points


def test_arm_follows_set_points_84_ms_later() -> None:
    desk = started()
    start = desk.report.joints[5]
    desk.move(5, 10.0, 1.0)
    ordered = desk.robot.motion.set_point[5]
    behind = ordered - desk.report.joints[5]
    assert behind / 10.0 == pytest.approx(0.084, abs=0.004)
    goal = desk.robot.motion.set_point
    for _ in range(150):
        desk.command(goal)
        desk.tick()
    assert desk.report.joints[5] == pytest.approx(ordered, abs=1e-5)
    assert ordered > start + 5.0


def test_arm_can_follow_180_ms_later() -> None:
    desk = started()
    injection = desk.inject("robot", "lags", 60.0, ms=96.0)
    desk.wait(0.2)
    desk.move(5, 10.0, 1.0)
    assert (desk.robot.motion.set_point[5] - desk.report.joints[5]) / 10.0 == pytest.approx(0.18, abs=0.004)
    handler = desk.robot.handlers["robot"]["lags"]
    assert handler.end is not None
    handler.end(injection, desk.now)
    for _ in range(100):
        desk.command(desk.robot.motion.set_point)
        desk.tick()
    assert desk.robot.motion.loops.delay_s == pytest.approx(0.056)


def test_command_that_answers_no_report_is_ignored() -> None:
    desk = started()
    joints = list(desk.report.joints[:6])
    joints[5] += 0.0005
    desk.command(joints)
    desk.command(joints)  # repeated
    desk.command(joints, sequence=desk.report.sequence - 1)  # late
    desk.command(joints, sequence=desk.report.sequence + 1)
    assert desk.robot.targets.accepted == 1
    assert desk.robot.server.counts["commands that answer no report"] == 3


def test_start_move_buffers_set_points() -> None:
    desk = Desk()
    desk.send(Capability(Kind.SET_CAPABILITY, 3, start_move=4))
    desk.begin()
    joints = list(desk.robot.motion.set_point)
    for count in range(1, 8):
        joints[5] += 0.0005
        desk.command(joints)
        desk.tick()
        expected = joints[5] - 0.0005 * min(count, 4)
        assert desk.robot.motion.set_point[5] == pytest.approx(expected, abs=1e-9)


def test_numbers_that_are_none_raise_an_alarm() -> None:
    desk = started()
    desk.command((math.nan, *desk.robot.motion.set_point[1:]))
    desk.tick()
    assert alarms(desk) == ["MOTN-625"]


def test_leap_raises_an_alarm() -> None:
    desk = started()
    joints = list(desk.robot.motion.set_point)
    joints[0] += 31.0
    desk.command(joints)
    desk.tick()
    assert alarms(desk) == ["MOTN-625"]
    hindrance = desk.robot.hindrance(desk.now)
    assert hindrance is not None
    assert hindrance.by_order


STEPS = [(2.0, "MOTN-609"), (0.02, "MOTN-610"), (0.001, "MOTN-611")]


@pytest.mark.parametrize(("step", "alarm"), STEPS)
def test_old_software_refuses_steps_beyond_its_limits(step: float, alarm: str) -> None:
    desk = started(OLD)
    joints = list(desk.robot.motion.set_point)
    joints[0] += step
    desk.command(joints)
    desk.tick()
    assert alarms(desk) == [alarm]
    assert not desk.report.status & Status.READY


@pytest.mark.parametrize(("step", "alarm"), STEPS)
def test_new_software_smooths_them(step: float, alarm: str) -> None:
    desk = started()
    joints = list(desk.robot.motion.set_point)
    joints[0] += step
    for _ in range(100):
        desk.command(joints)
        desk.tick()
    assert alarms(desk) == []
    assert desk.robot.motion.set_point[0] == pytest.approx(joints[0], abs=1e-9)


def test_smoothed_step_keeps_the_limits() -> None:
    desk = started()
    joints = list(desk.robot.motion.set_point)
    joints[0] += 20.0
    positions = []
    for _ in range(150):
        desk.command(joints)
        desk.tick()
        positions.append(desk.robot.motion.set_point[0])
    speeds = [(b - a) / 0.008 for a, b in itertools.pairwise(positions)]
    gains = [(b - a) / 0.008 for a, b in itertools.pairwise(speeds)]
    assert max(speeds) <= 120.0
    assert max(map(abs, gains)) <= 265.0 + 1e-6


@pytest.mark.parametrize(("profile", "expected"), [(OLD, ["SYST-323"]), (FanucProfile(), [])])
def test_tool_speed_is_limited_in_collaborative_mode(profile: FanucProfile, expected: list[str]) -> None:
    """Joint 1 turns 1 m away from its axis, at up to 57 degrees/s."""
    desk = started(profile)
    joints, fastest = list(desk.robot.motion.set_point), 0.0
    place = desk.robot.motion.arm.pose(desk.robot.motion.set_point).position
    for count in range(200):
        share = min(count / 100.0, 1.0)
        joints[0] += 57.0 * share * share * (3.0 - 2.0 * share) * 0.008
        desk.command(joints)
        desk.tick()
        if alarms(desk):
            break
        before, place = place, desk.robot.motion.arm.pose(desk.robot.motion.set_point).position
        fastest = max(fastest, math.dist(before, place) / 0.008)
    assert alarms(desk) == expected
    assert fastest <= 0.75 * (1.0 + 1e-6)


def test_external_axes_are_reported_as_not_modelled() -> None:
    desk = started()
    desk.send(Command(3, desk.report.sequence, (*desk.robot.motion.set_point, 5.0, 0.0, 0.0)))
    assert list(desk.robot.unmodelled.counts) == ["external axes"]


# --- the incident


def test_joints_with_data_style_0_are_read_as_a_pose() -> None:
    desk = started()
    before = desk.robot.path.pose.position  # type: ignore[attr-defined]
    joints = desk.robot.motion.set_point
    for _ in range(12):
        desk.command(joints, CARTESIAN)
        desk.tick()
    assert alarms(desk) == []
    order = desk.orders[-1]
    assert order.breach.startswith("data style 0: the joints of the arm are read as the pose X Y Z W P R")
    assert order.pose is not None
    assert math.dist(order.pose.position, before) > 0.9
    for _ in range(200):
        desk.command(joints, CARTESIAN)
        desk.tick()
    assert math.dist(desk.robot.path.pose.position, before) > 0.9, "the arm has left"  # type: ignore[attr-defined]
    fastest = (
        max(abs(b - a) for a, b in zip(*(one.joints for one in desk.reports[-60:-58]), strict=True)) / 0.008
    )
    assert fastest > 50.0, "degrees/s"


def test_pose_out_of_reach_raises_an_alarm() -> None:
    desk = started()
    x, y, z, w, p, r = desk.report.pose[:6]
    for _ in range(200):
        desk.command((x + 800.0, y, z, w, p, r), CARTESIAN)
        desk.tick()
    assert alarms(desk) == ["MOTN-018"]


def test_pose_with_data_style_0_is_followed() -> None:
    desk = started()
    x, y, z, w, p, r = desk.report.pose[:6]
    for count in range(1, 100):
        desk.command((x, y, z - 0.002 * min(count, 50), w, p, r), CARTESIAN)
        desk.tick()
    assert alarms(desk) == []
    assert not any(order.breach for order in desk.orders)
    assert desk.report.pose[:6] == pytest.approx((x, y, z - 0.1, w, p, r), abs=1e-3)


def test_old_software_refuses_a_pose_that_is_far() -> None:
    desk = started(OLD)
    x, y, z, w, p, r = desk.report.pose[:6]
    desk.command((x, y, z - 20.0, w, p, r), CARTESIAN)
    desk.tick()
    assert alarms(desk) == ["MOTN-720"]


# --- versions


@pytest.mark.parametrize(("version", "size"), [(1, 132), (2, 132), (3, 388), (4, 416)])
def test_each_version_moves_the_arm(version: int, size: int) -> None:
    desk = started(FanucProfile(version=version))  # type: ignore[arg-type]
    start = desk.report.joints[5]
    desk.move(5, 5.0, 0.6)
    desk.wait(0.05)
    assert desk.report.version == version
    assert desk.report.joints[5] > start + 1.0
    assert alarms(desk) == []


def test_report_of_version_4_has_the_force_in_the_tool_frame() -> None:
    still: PerAxis = (0.0,) * 6
    desk = Desk(FanucProfile(version=4, force_offset_n=0.0, force_noise_n=0.0))
    desk.robot.feel(lambda time: (0.0, 0.0, 12.0))
    desk.begin()
    assert (desk.report.wrench, desk.report.sensor) == (still, 0)
    desk.send(ForceSensor(4, 0, 1))
    desk.wait(0.1)
    wrench = desk.report.wrench
    assert wrench is not None
    assert desk.report.sensor == 1
    assert wrench[:3] == pytest.approx((0.0, 0.0, -12.0), abs=0.01)  # the tool points down
    desk.send(ForceSensor(4, 1, 1))
    desk.tick(2)
    assert desk.report.wrench == pytest.approx(still, abs=0.01)
    desk.send(ForceSensor(4, 0, 2))
    desk.tick()
    assert desk.report.sensor == 0xFFFFFFFF


def test_signal_of_version_3_is_not_known_to_version_1() -> None:
    desk = Desk(FanucProfile(version=1))
    desk.send(Signal(Kind.START, 3))
    desk.wait(0.1)
    assert desk.packets == []


def test_old_start_packet_begins_a_session_of_version_2() -> None:
    """Such as fanuc_ucl sends it, with version 3."""
    desk = Desk()
    desk.send(Signal(Kind.VERSION, 3))
    assert desk.packets == [Signal(Kind.VERSION, 3)]
    desk.send(Signal(Kind.START_V1, 3))
    desk.wait(0.1)
    assert desk.report.version == 2
    desk.send(Signal(Kind.COMMAND_POSITION, 3))
    position = desk.packets[-1]
    assert isinstance(position, CommandPosition)
    assert position.joints[:6] == pytest.approx(desk.robot.motion.set_point, abs=1e-5)


def test_j3_of_packets_can_be_that_of_the_pendant() -> None:
    desk = started(FanucProfile(stream_j3="horizon"))
    a, b, c, d, e, f = desk.robot.motion.joints
    angles = (a, b, c - b, d, e, f)
    assert desk.report.joints[:6] == pytest.approx(angles, abs=1e-5)
    desk.command(angles)
    desk.tick()
    assert desk.robot.motion.set_point == pytest.approx((a, b, c, d, e, f), abs=1e-9)
    assert alarms(desk) == []


def test_style_of_joints_is_any_number_but_0() -> None:
    desk = started()
    joints = desk.robot.motion.set_point
    for style in (1, 7, JOINTS):
        desk.command(joints, style)
        desk.tick()
    assert alarms(desk) == []
    assert desk.robot.motion.set_point == joints


@pytest.mark.parametrize("refusals", ["smooth", "alarm"])
def test_last_set_point_ends_the_program(refusals: Literal["smooth", "alarm"]) -> None:
    """The example of the maker's client waits until it is neither ready nor moving."""
    desk = started(FanucProfile(refusals=refusals))
    limiter = JointLimiter(desk.robot.motion.set_point, 0.008)
    goal = (*limiter.joints[:5], limiter.joints[5] + 1.0)
    while limiter.joints != goal:
        desk.command(limiter.step(goal, desk.robot.set_points.limits), last=limiter.joints == goal)
        desk.tick()
    flags = []
    for _ in range(100):
        desk.tick()
        flags.append(desk.report.status & 9)
    assert flags[0] == 9
    assert flags[-1] == 0
    assert desk.robot.motion.joints == pytest.approx(goal, abs=1e-3)
    assert alarms(desk) == []
    assert desk.robot.program.status == ProgramStatus.CANCELLED
