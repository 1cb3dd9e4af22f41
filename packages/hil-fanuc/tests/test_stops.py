"""Stops of the emulated controller: silence of its client, emergency stop, contact stop, hanging server. Observed
behaviour: airo-ugent/airo-fanuc, docs/controller-notes.md.
"""

import itertools

import pytest
from fanuc_desk import Desk, alarms, started
from hil_fanuc.packets import Capability, Kind, Signal, Status, Threshold, ThresholdRequest
from hil_fanuc.profile import FanucProfile
from hil_fanuc.rmi import ProgramStatus

from emulators.orders import Act

OLD = FanucProfile(refusals="alarm")


# --- silence


@pytest.mark.parametrize(("speed", "ready_s", "overrun"), [(49.9, 0.071, 4.63), (15.3, 0.121, 2.10)])
def test_silence_lets_the_arm_coast(speed: float, ready_s: float, overrun: float) -> None:
    desk = started()
    desk.move(5, speed, 1.5)
    silent_at, place = desk.now, desk.report.joints[5]
    while desk.report.status & Status.READY:
        desk.tick()
    assert desk.now - silent_at == pytest.approx(ready_s, abs=0.009)
    desk.wait(0.3)
    assert alarms(desk) == []
    assert desk.report.joints[5] - place == pytest.approx(overrun, rel=0.1)
    assert not desk.report.status & (Status.READY | Status.MOVING)
    count = len(desk.reports)
    desk.wait(0.08)
    assert len(desk.reports) == count + 10, "reports go on"


def test_starved_program_continues_after_a_call() -> None:
    desk = started()
    desk.move(5, 15.0, 0.5)
    desk.wait(0.5)
    assert not desk.report.status & Status.READY
    place = desk.report.joints[5]
    assert desk.call() == 0
    while not desk.report.status & Status.READY:
        desk.tick()
    desk.move(5, 15.0, 0.5)
    assert desk.report.status & Status.READY
    assert desk.report.joints[5] > place + 2.0


def test_silence_is_detected_in_the_program_after_a_last_command() -> None:
    desk = started()
    desk.command(desk.robot.motion.set_point, last=True)
    desk.wait(0.3)
    assert not desk.report.status & Status.READY
    assert desk.call() == 0
    desk.wait(1.1)
    assert desk.report.status & Status.READY
    desk.command(desk.robot.motion.set_point)
    desk.wait(0.3)
    assert not desk.report.status & Status.READY


def test_old_software_stops_when_set_points_are_missing() -> None:
    desk = started(OLD)
    desk.command(desk.robot.motion.set_point)
    desk.tick(11)
    assert alarms(desk) == []
    desk.tick(2)
    assert alarms(desk) == ["MOTN-603"]


# --- stops


def test_emergency_stop_arrives_in_stages() -> None:
    desk = started()
    desk.move(5, 20.0, 0.5)
    desk.inject("robot", "emergency-stop", 2.0)
    at = desk.now
    stages = {}
    while desk.now < at + 0.6:
        desk.command(desk.robot.motion.set_point)
        desk.tick()
        report = desk.report
        stages[round(desk.now - at, 3)] = (report.robot_status, bool(report.status & Status.READY))
    times = sorted(stages)
    changes = [(b, stages[b]) for a, b in itertools.pairwise(times) if stages[a] != stages[b]]
    assert stages[times[0]] == (1, True)
    assert [stage for _, stage in changes] == [(1, False), (5, False)]
    assert [time for time, _ in changes] == pytest.approx([0.3, 0.5], abs=0.01)
    assert alarms(desk) == ["SRVO-002", "SRVO-289"]
    place = desk.report.joints[5]
    desk.wait(0.1)
    assert desk.report.joints[5] == place


def test_recovery_needs_reset_and_call_but_no_start_packet() -> None:
    desk = started()
    injection = desk.inject("robot", "emergency-stop", 1.0)
    desk.wait(0.7)
    assert desk.ask({"Command": "FRC_Reset"})["ErrorID"] == 2556940
    assert desk.ask({"Command": "FRC_Initialize"})["ErrorID"] == 2556955
    handler = desk.robot.handlers["robot"]["emergency-stop"]
    assert handler.end is not None
    handler.end(injection, desk.now)
    assert alarms(desk) == ["SRVO-002", "SRVO-289"]
    released = desk.now
    assert desk.ask({"Command": "FRC_Reset"})["ErrorID"] == 0
    assert not desk.report.status & Status.READY
    assert desk.ask({"Command": "FRC_Continue"})["ErrorID"] == 0
    assert desk.call() == 0
    while not desk.report.status & Status.READY:
        desk.tick()
    assert desk.now - released < 1.5
    assert {order.act for order in desk.orders} >= {Act.RELEASE, Act.PROGRAM}


def test_contact_stop_trips_at_its_force() -> None:
    desk = started()
    forces = [(0.0, 0.0, 149.0)]
    desk.robot.feel(lambda time: forces[0])
    desk.wait(0.1)
    assert desk.report.contact_stop == 0
    forces[0] = (0.0, 0.0, 151.0)
    desk.tick()
    assert desk.report.contact_stop == 2
    assert alarms(desk) == ["SYST-321"]
    forces[0] = (0.0, 0.0, 0.0)
    assert desk.ask({"Command": "FRC_Reset"})["ErrorID"] == 0
    assert desk.report.contact_stop == 0


def test_contact_stop_trips_at_a_jerky_command() -> None:
    desk = started(FanucProfile(contact_jerk=3.0))
    joints = list(desk.robot.motion.set_point)
    joints[5] += 2.0 * 1860.0 * 0.008**3
    desk.command(joints)
    desk.tick()
    assert desk.report.contact_stop == 0
    joints[5] -= 8.0 * 1860.0 * 0.008**3
    desk.command(joints)
    desk.tick()
    assert desk.report.contact_stop == 2
    assert alarms(desk) == ["SYST-321"]


def test_load_lowers_the_limits() -> None:
    """With half of the largest load of 10 kg, halfway between both tables."""
    desk = started(FanucProfile(refusals="alarm", full_load_percent=50.0))
    desk.robot.carry(5.0, (0.0, 0.0, 0.1))
    limits = desk.robot.set_points.limits[5]
    assert limits.speed == pytest.approx(180.0, rel=1e-6)
    assert (limits.acceleration, limits.jerk) == pytest.approx((0.75 * 399.0, 0.75 * 1860.0), rel=1e-6)
    desk.send(ThresholdRequest(3, 6, 2))
    table = desk.packets[-1]
    assert isinstance(table, Threshold)
    assert (table.no_load[-1], table.full_load[-1]) == (1860.0, 930.0)


def test_aborted_tasks_hang_the_server_until_power_is_cycled() -> None:
    desk = started()
    desk.robot.abort_tasks(desk.now)
    count = len(desk.packets)
    desk.send(Capability(Kind.GET_CAPABILITY, 3))
    desk.signal(Kind.STOP)
    desk.signal(Kind.START)
    desk.wait(0.2)
    assert len(desk.packets) == count
    assert desk.ask({"Command": "FRC_Continue"})["ErrorID"] == 2556939
    assert desk.call() == 2556934
    desk.robot.cycle_power(desk.now)
    desk.begin()


def test_pendant_that_is_on_stops_the_program() -> None:
    desk = started()
    desk.inject("robot", "pendant-on", 1.0)
    desk.tick()
    assert (desk.report.robot_status, desk.report.status & Status.READY) == (2, 0)
    assert desk.ask({"Command": "FRC_GetStatus"})["TPMode"] == 1
    assert desk.ask({"Command": "FRC_Initialize"})["ErrorID"] == 2556943


def test_motion_without_rest_is_stopped_after_the_status_check() -> None:
    desk = started(FanucProfile(status_check_s=0.8))
    desk.move(5, 4.0, 0.3)
    for _ in range(100):
        desk.command(desk.robot.motion.set_point)
        desk.tick()
    assert alarms(desk) == []
    desk.move(5, 4.0, 1.2)
    assert alarms(desk) == ["SYST-322"]


def test_brake_control_stops_the_program() -> None:
    desk = Desk(FanucProfile(brake_control=True))
    desk.call()
    assert alarms(desk) == ["MOTN-615"]
    assert desk.robot.program.status == ProgramStatus.HELD


def test_start_of_a_newer_version_is_refused() -> None:
    desk = Desk(FanucProfile(version=1))
    desk.send(Signal(Kind.START, 3))
    desk.wait(0.1)
    assert desk.robot.program.alarms.active == ["MOTN-607 ST: Protocol version mismatch PC 3, Rob 1"]
    assert desk.reports == []


def test_wrong_number_can_raise_an_alarm() -> None:
    desk = started(FanucProfile(wrong_numbers="alarm"))
    desk.command(desk.robot.motion.set_point)
    assert alarms(desk) == []
    desk.command(desk.robot.motion.set_point)
    assert alarms(desk) == ["MOTN-601"]
