"""Clients of the robot and of the force sensor, sans-io with the emulated box."""

import itertools
import math
from typing import Any

import pytest
from hil_xarm.client import XarmClient
from hil_xarm.force_client import ForceClient
from hil_xarm.frames import FrameReader, Function, Mode, State, unpack_floats
from hil_xarm.settings import ForceSettings, XarmSettings
from xarm_desk import T0, Pair

from protocol.geometry import Pose
from protocol.robot import ReportReceived, StreamLost
from protocol.wrench import SensorFailed, SensorNotice, SensorReady, WrenchFrame, Zeroed

DOWN = (0.0, 1.0, 0.0, 0.0)
START = Pose((0.4, -0.1, 0.2), DOWN)


def robot_pair(settings: XarmSettings | None = None, read_only: bool = False, **given: Any) -> Pair:
    return Pair(XarmClient(settings or XarmSettings(), T0, read_only), **given)


def reports(pair: Pair) -> list[Any]:
    return [event.report for event in pair.events_of(ReportReceived)]


def functions(pair: Pair) -> list[int]:
    return [request.function for _, request in pair.sent]


def begun(pair: Pair) -> XarmClient:
    """Make the session ready, and begin a movement at the start pose."""
    pair.run(0.1)
    assert isinstance(pair.client, XarmClient)
    pair.client.begin(START)
    return pair.client


def follow(pair: Pair, goal: Pose) -> Any:
    """Return a function that answers each report with a goal."""

    def answer(event: Any) -> None:
        if isinstance(event, ReportReceived) and isinstance(pair.client, XarmClient):
            pair.client.target(goal, pair.now)

    return answer


def servo_poses(pair: Pair) -> list[tuple[float, tuple[float, ...]]]:
    return [
        (at, unpack_floats(request.data, 6))
        for at, request in pair.sent
        if request.function == Function.SERVO_POSE
    ]


# --- session


def test_session_sets_mode_and_state_in_order() -> None:
    pair = robot_pair()
    pair.run(0.1)
    order = [Function.VERSION, Function.ERROR, Function.ENABLE, Function.SET_MODE, Function.SET_STATE]
    assert functions(pair) == order
    first = reports(pair)[0]
    assert (first.sequence > 0, first.fault) == (True, "")
    assert first.pose.position == pytest.approx(START.position, abs=1e-6)
    assert pair.box.mode == Mode.SERVO


def test_error_before_the_run_is_cleared() -> None:
    pair = robot_pair()
    pair.box.fail(60)
    pair.run(0.1)
    assert functions(pair)[1:5] == [
        Function.ERROR,
        Function.CLEAR_ERROR,
        Function.CLEAR_WARNING,
        Function.ERROR,
    ]
    assert reports(pair)[0].fault == ""


def test_error_that_remains_is_reported_with_its_number() -> None:
    pair = robot_pair()
    pair.box.press_stop(T0)
    pair.run(0.1)
    (lost,) = pair.events_of(StreamLost)
    assert lost.text == "it reports error 1, the emergency stop button is pressed"
    assert Function.ENABLE not in functions(pair)


def test_error_is_not_cleared_if_the_settings_forbid_it() -> None:
    pair = robot_pair(XarmSettings(clears_error=False))
    pair.box.fail(31)
    pair.run(0.1)
    assert Function.CLEAR_ERROR not in functions(pair)
    assert "error 31, collision" in pair.events_of(StreamLost)[0].text


def test_reading_client_sets_nothing() -> None:
    pair = robot_pair(read_only=True)
    pair.run(0.1)
    assert set(functions(pair)) == {Function.VERSION, Function.ERROR}
    assert reports(pair)[0].fault == "", "the box is stopped, and a run would make it ready"
    assert isinstance(pair.client, XarmClient)
    assert pair.client.farewell() == ()


def test_silent_command_channel_ends_the_session() -> None:
    pair = robot_pair()
    pair.holds_back = True
    pair.run(2.1)
    assert pair.events_of(StreamLost)[0].text == "it does not answer the command version within 2 s"


# --- motion


def test_each_report_is_answered_once_with_a_pose() -> None:
    pair = robot_pair()
    begun(pair)
    pair.run(1.0, follow(pair, Pose((0.4, -0.09, 0.2), DOWN)))
    poses = servo_poses(pair)
    assert len(poses) == 100
    assert min(b - a for (a, _), (b, _) in itertools.pairwise(poses)) >= 0.004
    assert poses[-1][1][:3] == pytest.approx((400.0, -90.0, 200.0), abs=1e-3)
    assert pair.report["pose"][1] == pytest.approx(-90.0, abs=1e-3)


def test_step_between_two_poses_keeps_the_limits() -> None:
    settings = XarmSettings(speed_mm_s=50.0, acceleration_mm_s2=1000.0)
    pair = robot_pair(settings)
    begun(pair)
    pair.run(1.0, follow(pair, Pose((0.4, -0.06, 0.2), DOWN)))
    ys = [pose[1] for _, pose in servo_poses(pair)]
    steps = [b - a for a, b in zip([-100.0, *ys], ys, strict=False)]
    assert max(steps) == pytest.approx(0.5, abs=1e-3), "50 mm/s in 10 ms"
    changes = [abs(b - a) for a, b in zip([0.0, *steps], steps, strict=False)]
    assert max(changes) < 0.1 + 1e-3, "1000 mm/s² in 10 ms"
    assert ys[-1] == pytest.approx(-60.0, abs=1e-3)


def test_stall_sends_nothing_more_and_goes_on_without_a_leap() -> None:
    pair = robot_pair()
    begun(pair)
    goal = [-0.1]

    def answer(event: Any) -> None:
        if isinstance(event, ReportReceived) and isinstance(pair.client, XarmClient):
            goal[0] += 0.0002  # 20 mm/s
            pair.client.target(Pose((0.4, goal[0], 0.2), DOWN), pair.now)

    pair.run(0.2, answer)
    fault = pair.inject("robot", "stalls", probability=1.0, ms=190.0)
    pair.run(0.015, answer)
    fault.finish(pair.now)
    pair.run(0.6, answer)
    poses = servo_poses(pair)
    gaps = [b - a for (a, _), (b, _) in itertools.pairwise(poses)]
    assert max(gaps) == pytest.approx(0.2, abs=0.011), "nothing is sent without the reply before"
    ys = [pose[1] for _, pose in poses]
    steps = [b - a for a, b in itertools.pairwise(ys)]
    assert max(steps) <= 2.5 + 1e-3, "250 mm/s in 10 ms, although the target is 4 mm away"
    assert max(abs(b - a) for a, b in itertools.pairwise(steps)) <= 0.2 + 1e-3, "2000 mm/s²"
    assert ys[-1] == pytest.approx(1e3 * goal[0], abs=0.3)
    assert not pair.events_of(StreamLost)


def test_error_in_a_movement_is_reported_and_nothing_more_is_ordered() -> None:
    pair = robot_pair()
    begun(pair)
    pair.run(0.1, follow(pair, START))
    pair.box.fail(60)
    pair.run(0.1)
    assert reports(pair)[-1].fault == "it reports error 60, speed of the tool beyond the limit in servo mode"
    assert functions(pair)[-1] == Function.ERROR
    assert Function.CLEAR_ERROR not in functions(pair)


@pytest.mark.parametrize(
    ("fault", "text"),
    [("stopped", "it is stopped"), ("paused", "it is paused"), ("mode-changed", "its mode was changed")],
)
def test_intervention_of_another_program_is_reported(fault: str, text: str) -> None:
    pair = robot_pair()
    begun(pair)
    pair.inject("robot", fault)
    pair.run(0.1, follow(pair, START))
    assert reports(pair)[-1].fault == text


def test_end_of_the_session_stops_the_arm() -> None:
    pair = robot_pair()
    client = begun(pair)
    client.end()
    (piece,) = client.farewell()
    (frame,) = FrameReader().feed(piece.data)
    assert frame.body == bytes((Function.SET_STATE, State.STOPPED))


def test_pose_that_is_not_a_number_is_reported_as_such() -> None:
    pair = robot_pair()
    begun(pair)
    pair.inject("pose", "nan")
    pair.run(0.05)
    assert math.isnan(reports(pair)[-1].pose.position[0])


# --- force sensor


def force_pair(settings: ForceSettings | None = None) -> Pair:
    pair = Pair(ForceClient(settings or ForceSettings(settle_s=0.1), T0))
    pair.load = (1.0, -2.0, 15.0, 0.1, 0.0, 0.0)
    return pair


def frames(pair: Pair) -> list[WrenchFrame]:
    return pair.events_of(WrenchFrame)


def test_sensor_is_switched_on_and_its_raw_values_are_passed_on() -> None:
    pair = force_pair()
    pair.run(0.5)
    assert functions(pair) == [Function.VERSION, Function.FORCE_ENABLE, Function.ERROR]
    (ready,) = pair.events_of(SensorReady)
    assert (ready.facts.period, ready.facts.tares) == (0.01, "host")
    assert ready.facts.model == "force sensor of an xArm, firmware v2.5.0"
    assert frames(pair)[-1].values == pytest.approx(pair.load, rel=1e-6)
    assert (
        frames(pair)[-1].counter == len(pair.reports[next(iter(pair.reports))])
        or frames(pair)[-1].counter > 30
    )


def test_host_subtracts_the_zero_and_the_box_keeps_its_own() -> None:
    pair = force_pair()
    pair.run(0.3)
    pair.client.zero()
    pair.run(0.3)
    assert len(pair.events_of(Zeroed)) == 1
    assert frames(pair)[-1].values == pytest.approx((0.0,) * 6, abs=1e-6)
    assert Function.FORCE_ZERO not in functions(pair)


def test_values_at_the_end_of_their_range_are_marked_by_axis() -> None:
    pair = force_pair()
    pair.run(0.3)
    pair.load = (0.0, 160.0, -250.0, 0.0, 4.5, 0.0)
    pair.run(0.05)
    assert frames(pair)[-1].saturated == 0b010110


def test_overload_is_a_notice_and_a_lost_sensor_the_end() -> None:
    pair = force_pair(ForceSettings(settle_s=0.1, ask_s=0.1))
    pair.run(0.3)
    pair.load = (0.0, 0.0, 400.0, 0.0, 0.0, 0.0)
    pair.run(0.3)
    assert [notice.text for notice in pair.events_of(SensorNotice)] == [
        "the box reports error 53, force sensor overloaded"
    ]
    pair.inject("sensor", "lost")
    pair.run(0.1)
    assert pair.events_of(SensorFailed)[0].text == "the force sensor is off, or its box does not reach it"


def test_sensor_that_cannot_be_read_ends_the_session() -> None:
    pair = force_pair(ForceSettings(settle_s=0.1, ask_s=0.1))
    pair.run(0.3)
    pair.inject("sensor", "unreadable")
    pair.run(0.2)
    assert pair.events_of(SensorFailed)[0].text == "the box reports error 50, force sensor cannot be read"


def test_box_that_reports_no_forces_is_refused() -> None:
    pair = Pair(ForceClient(ForceSettings(settle_s=0.0), T0), sensor=False)
    pair.box.fail = lambda error: None
    pair.run(0.2)
    assert pair.events_of(SensorFailed)[0].text == "its real reports contain no force"


def test_box_without_a_sensor_is_refused_with_its_error() -> None:
    pair = Pair(ForceClient(ForceSettings(settle_s=0.1), T0), sensor=False)
    pair.run(0.2)
    assert "error 18, no communication with the force sensor" in pair.events_of(SensorFailed)[0].text
