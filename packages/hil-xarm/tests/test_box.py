"""Control box: states, modes, errors, servo targets, planned motions and the force sensor."""

import math

import pytest
from hil_xarm.arms import XARM_6, from_box, to_box
from hil_xarm.frames import Bit, Function, Mode, State, pack_floats, unpack_floats
from hil_xarm.profile import XarmProfile
from hil_xarm.reports import Port
from xarm_desk import Desk, pose_data

from emulators.arm.chain import Chain, straight_tool
from emulators.orders import Act
from protocol.geometry import Pose, angle_between

OFF = {"noise_n": 0.0, "noise_nm": 0.0, "wander_n": 0.0, "vibration_n": 0.0, "motion_n": 0.0}


# --- arm


def test_arm_at_zero_is_where_the_maker_states() -> None:
    x, y, z, roll, pitch, yaw = to_box(Chain(XARM_6, straight_tool(0.0)).pose((0.0,) * 6))
    assert (x, y, z) == pytest.approx((207.0, 0.0, 112.0))
    assert (abs(roll), pitch, yaw) == pytest.approx((math.pi, 0.0, 0.0))


def test_pose_round_trip_through_roll_pitch_yaw() -> None:
    pose = Pose((0.3, -0.1, 0.2), (0.1 / 1.0, 0.975, 0.15, 0.129))
    norm = math.hypot(*pose.quaternion)
    w, x, y, z = (part / norm for part in pose.quaternion)
    again = from_box(to_box(Pose(pose.position, (w, x, y, z))))
    assert again.position == pytest.approx(pose.position)
    assert angle_between(again.quaternion, pose.quaternion) < 1e-9


# --- order of a session


def test_box_moves_after_enable_mode_and_state_only() -> None:
    desk = Desk()
    assert desk.ask(Function.STATE).data == bytes((State.STOPPED,))
    desk.ask(Function.SET_MODE, bytes((Mode.SERVO,)))
    assert desk.ask(Function.STATE).data == bytes((State.MODE_CHANGED,))
    desk.ask(Function.SET_STATE, b"\0")
    assert desk.ask(Function.STATE).data == bytes((State.MODE_CHANGED,)), "the motors are off"
    assert desk.ask(Function.ENABLE, bytes((8, 1))).state == Bit.NOT_READY
    reply = desk.ask(Function.SET_STATE, b"\0")
    assert (reply.state, desk.box.state) == (0, State.ASLEEP)
    desk.servo(400.0, -99.0, 200.0)
    desk.wait(0.3)
    assert desk.state_and_mode == (State.ASLEEP, Mode.SERVO)
    assert desk.report["pose"][1] == pytest.approx(-99.0, abs=1e-3)


def test_servo_target_in_position_mode_is_answered_and_moves_nothing() -> None:
    desk = Desk()
    desk.prepare(Mode.POSITION)
    assert desk.servo(400.0, -99.0, 200.0).state == 0
    desk.wait(0.2)
    assert desk.report["pose"][1] == pytest.approx(-100.0, abs=1e-3)
    assert desk.box.counts["servo commands without effect"] == 1


def test_version_and_serials_end_with_a_zero() -> None:
    desk = Desk()
    text, _, rest = desk.ask(Function.VERSION).data.partition(b"\0")
    assert text == b"6,6,XI0000EMULATED,AC0000EMULATED,v2.5.0"
    assert rest.strip(b"\0") == b""
    assert desk.ask(Function.SERIALS).data.split(b"\0")[:2] == [b"XI0000EMULATED", b"AC0000EMULATED"]


def test_unknown_command_is_a_warning_until_it_is_cleared() -> None:
    desk = Desk()
    assert desk.ask(99).state & (Bit.INVALID | Bit.WARNING) == Bit.INVALID | Bit.WARNING
    assert desk.ask(Function.ERROR).data == bytes((0, 13))
    desk.ask(Function.CLEAR_WARNING)
    assert desk.ask(Function.ERROR).data == bytes((0, 0))
    assert desk.robot.unmodelled.counts == {"function 99": 1}


# --- servo mode


def test_only_the_newest_target_of_a_control_cycle_counts() -> None:
    desk = Desk()
    desk.prepare()
    for k in range(1, 9):
        desk.send(Function.SERVO_POSE, pose_data(400.0, -100.0 + 0.1 * k, 200.0))
        desk.wait(0.001)
    desk.wait(0.3)
    assert desk.report["pose"][1] == pytest.approx(-99.2, abs=1e-3)
    assert desk.box.counts["servo commands lost"] == 5, "three cycles of 4 ms took three of eight targets"


def test_silence_keeps_the_last_target() -> None:
    desk = Desk()
    desk.prepare()
    desk.servo(400.0, -95.0, 200.0)
    desk.wait(5.0)
    assert desk.report["pose"][1] == pytest.approx(-95.0, abs=1e-3)
    assert desk.state_and_mode == (State.ASLEEP, Mode.SERVO)


@pytest.mark.parametrize("error", [60, 24])
def test_tool_beyond_its_speed_stops_with_an_error(error: int) -> None:
    desk = Desk(XarmProfile(speed_error=error, **OFF))
    desk.prepare()
    for k in range(1, 20):
        reply = desk.servo(400.0 - 12.0 * k, -100.0, 200.0)
        desk.wait(0.009)
        if reply.state & Bit.ERROR:
            break
    assert reply.state == Bit.ERROR | Bit.NOT_READY
    assert desk.ask(Function.ERROR).data[0] == error
    assert desk.box.state == State.STOPPED
    assert desk.box.hindrance(desk.now) is not None
    desk.wait(0.5)
    before = desk.report["pose"]
    assert desk.servo(400.0, -100.0, 200.0).state == Bit.ERROR | Bit.NOT_READY
    desk.wait(0.5)
    assert desk.report["pose"] == before
    desk.ask(Function.CLEAR_ERROR)
    desk.prepare()
    assert desk.ask(Function.STATE).state == 0


def test_slow_targets_of_10_mm_keep_the_speed() -> None:
    desk = Desk()
    desk.prepare()
    for k in range(1, 11):
        desk.servo(400.0, -100.0 + 10.0 * k, 200.0)
        desk.wait(0.1)
    assert desk.box.error == 0


@pytest.mark.parametrize(("target", "error"), [((900.0, 0.0, 200.0), 21), ((0.0, 0.0, 300.0), 21)])
def test_pose_out_of_reach_is_a_kinematic_error(target: tuple[float, float, float], error: int) -> None:
    desk = Desk()
    desk.prepare()
    desk.servo(*target)
    assert desk.box.error == error


def test_joint_beyond_its_range_is_an_error() -> None:
    desk = Desk()
    desk.prepare()
    joints = (0.0, 0.0, math.radians(20.0), 0.0, 0.0, 0.0, 0.0)
    desk.ask(Function.SERVO_JOINTS, pack_floats(*joints, 0.0, 0.0, 0.0))
    assert desk.box.error == 23


def test_pause_holds_and_move_goes_on() -> None:
    desk = Desk()
    desk.prepare()
    desk.ask(Function.SET_STATE, bytes((State.PAUSED,)))
    desk.servo(400.0, -99.0, 200.0)
    desk.wait(0.2)
    assert desk.state_and_mode[0] == State.PAUSED
    assert desk.report["pose"][1] == pytest.approx(-100.0, abs=1e-3)
    desk.ask(Function.SET_STATE, b"\0")
    desk.servo(400.0, -99.0, 200.0)
    desk.wait(0.3)
    assert desk.report["pose"][1] == pytest.approx(-99.0, abs=1e-3)


def test_emergency_stop_remains_until_it_is_released_and_cleared() -> None:
    desk = Desk()
    desk.prepare()
    desk.box.press_stop(desk.now)
    assert desk.ask(Function.ERROR).data[0] == 1
    desk.ask(Function.CLEAR_ERROR)
    assert desk.ask(Function.ERROR).data[0] == 1
    desk.box.release_stop()
    desk.ask(Function.CLEAR_ERROR)
    assert desk.ask(Function.ERROR).data[0] == 0
    assert not desk.box.is_enabled
    assert [order.words for order in desk.orders if order.act is Act.RELEASE] == ["clear error"] * 2


def test_collision_stops_the_arm() -> None:
    desk = Desk()
    desk.prepare()
    desk.robot.feel(lambda at: (0.0, 0.0, 160.0))
    desk.wait(0.05)
    assert desk.ask(Function.ERROR).data[0] == 31


# --- planned motions


def test_line_is_straight_and_ends_at_its_goal() -> None:
    desk = Desk()
    desk.prepare(Mode.POSITION)
    desk.ask(Function.MOVE_LINE, pose_data(300.0, 0.0, 250.0)[:24] + pack_floats(100.0, 2000.0, 0.0))
    places = []
    while desk.box.state == State.MOVING:
        desk.wait(0.01)
        places.append(desk.report["pose"][:3])
    desk.wait(0.3)
    assert desk.report["pose"][:3] == pytest.approx((300.0, 0.0, 250.0), abs=1e-2)
    assert 1.4 < len(places) * 0.01 < 1.9, "150 mm at 100 mm/s"
    for x, y, z in places:
        assert y == pytest.approx(400.0 - x - 100.0, abs=0.05)
        assert z == pytest.approx(200.0 + (400.0 - x) / 2.0, abs=0.05)


def test_home_is_the_posture_with_all_joints_at_zero() -> None:
    desk = Desk()
    desk.prepare(Mode.POSITION)
    desk.ask(Function.MOVE_HOME, pack_floats(math.radians(50.0), math.radians(500.0), 0.0))
    desk.wait(2.5)
    assert desk.report["joints"] == pytest.approx((0.0,) * 7, abs=1e-6)
    assert unpack_floats(desk.ask(Function.POSE).data, 3) == pytest.approx((207.0, 0.0, -88.0), abs=1e-3)


def test_relative_motions_begin_where_the_one_before_ends() -> None:
    desk = Desk()
    desk.prepare(Mode.POSITION)
    for x, y, z in ((20.0, 0.0, 0.0), (0.0, 50.0, 10.0)):
        numbers = (x, y, z, 0.0, 0.0, 0.0, 0.0, 100.0, 2000.0, 0.0, -1.0)
        assert desk.ask(Function.MOVE_RELATIVE, pack_floats(*numbers) + bytes(2)).state == 0
    desk.wait(1.5)
    assert desk.report["pose"][:3] == pytest.approx((420.0, -50.0, 210.0), abs=1e-2)
    before = desk.report["joints"]
    turn = (0.1, 0.0, 0.0, 0.0, 0.0, -0.2, 0.0, 1.0, 10.0, 0.0, -1.0)
    desk.ask(Function.MOVE_RELATIVE, pack_floats(*turn) + b"\1\0")
    desk.wait(1.0)
    changes = [after - at for after, at in zip(desk.report["joints"], before, strict=True)]
    assert changes == pytest.approx(turn[:7], abs=1e-4)
    assert desk.ask(Function.MOVE_RELATIVE, pack_floats(*turn) + b"\0\1").state == Bit.WARNING


# --- reports


def test_ports_report_at_their_rates() -> None:
    desk = Desk()
    desk.wait(1.001)
    counts = {port: len(reports) for port, reports in desk.reports.items()}
    assert counts == {Port.REAL: 100, Port.RICH: 5, Port.COMMAND: 0, Port.NORMAL: 0, Port.RT: 0}


def test_rich_report_names_type_version_and_error() -> None:
    desk = Desk()
    desk.box.fail(60)
    desk.wait(0.3)
    rich = desk.reports[Port.RICH][-1]
    assert (rich["type"], rich["axes"], rich["error"], rich["switches"]) == ((6,), (6,), (60,), (0,))
    assert bytes(rich["version"]).rstrip(b"\0") == b"6,6,XI0000EMULATED,AC0000EMUL"
    assert rich["tcp_offset"] == pytest.approx((0.0, 0.0, 200.0, 0.0, 0.0, 0.0))


def test_box_without_a_sensor_reports_no_force() -> None:
    desk = Desk(sensor=False)
    desk.wait(0.02)
    assert desk.report["size"] == (87,)
    desk.ask(Function.FORCE_ENABLE, b"\1")
    assert desk.box.error == 18


# --- force sensor


def test_sensor_reports_raw_and_external_once_it_is_on() -> None:
    desk = Desk()
    desk.load = (1.0, -2.0, 20.0, 0.1, 0.0, 0.0)
    desk.wait(0.05)
    assert desk.report["raw"] == (0.0,) * 6
    desk.ask(Function.FORCE_ENABLE, b"\1")
    desk.wait(0.05)
    assert desk.report["raw"] == pytest.approx(desk.load)
    desk.ask(Function.FORCE_ZERO)
    desk.wait(0.15)
    assert desk.report["external"] == pytest.approx(desk.load), "a zero takes 0.2 s"
    desk.wait(0.1)
    assert desk.report["external"] == pytest.approx((0.0,) * 6, abs=1e-6)
    desk.load = (1.0, -2.0, 15.0, 0.1, 0.0, 0.0)
    desk.wait(0.02)
    assert desk.report["external"][2] == pytest.approx(-5.0, abs=1e-6)
    assert desk.report["raw"][2] == pytest.approx(15.0)
    assert unpack_floats(desk.ask(Function.FORCE, b"\1").data, 3)[2] == pytest.approx(15.0)
    assert unpack_floats(desk.ask(Function.FORCE).data, 3)[2] == pytest.approx(-5.0, abs=1e-6)


def test_external_values_exclude_the_load_of_the_box() -> None:
    desk = Desk()
    desk.load = (0.0, 0.0, 9.8, 0.0, 0.0, 0.0)
    desk.ask(Function.LOAD, pack_floats(1.0, 0.0, 0.0, 50.0))
    desk.ask(Function.FORCE_ENABLE, b"\1")
    desk.wait(0.05)
    assert desk.report["external"][2] == pytest.approx(0.0, abs=0.01)
    assert desk.report["raw"][2] == pytest.approx(9.8)


def test_overload_stops_the_arm_with_error_53() -> None:
    desk = Desk()
    desk.prepare()
    desk.ask(Function.FORCE_ENABLE, b"\1")
    desk.load = (0.0, 0.0, 400.0, 0.0, 0.0, 0.0)
    desk.wait(0.05)
    assert desk.ask(Function.ERROR).data[0] == 53
    assert desk.report["raw"][2] == pytest.approx(300.0)
