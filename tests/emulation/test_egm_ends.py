"""Tests of the ends of EGM guidance: by silence, windows, limits, operators, or a fault."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from emulators.devices.egm import EgmArmProfile, State
from protocol.devices.egm import Answer, Guidance, Motors, Rapid, RobotMessage, SensorMessage, decode_robot
from tests.emulation.egm_line import AT_ONCE, CYCLE, T0, Line, measured, planned, states, to

# --- silence


def test_silence_keeps_last_speed_until_timeout() -> None:
    ahead = (0.0, 0.0, -10.0, 0.0, 0.0, 0.0)
    line = Line(pos_corr_gain=0.0).streams(1.0, to(speed=ahead))
    before = line.z()[0]
    line.cycles(245)
    assert line.z()[0] == pytest.approx(before - 9.8, abs=0.1)
    line.cycles(10)
    stopped = line.z()[0]
    assert states(line.last) == (Motors.ON, Guidance.ERROR, Rapid.RUNNING)
    assert line.robot.session.error == "event 41822: ERR_UDPUC_COMM, no message from the PC"
    count = len(line.received)
    line.cycles(100)
    assert len(line.received) == count  # one datagram told of the error, and none follows
    assert line.robot.motion.pose.position[2] * 1e3 - 600.0 == pytest.approx(stopped)


def test_silence_with_position_moves_at_most_speed_over_gain() -> None:
    line = Line(comm_timeout_s=30.0).streams(1.0, to(speed=(0.0, 0.0, -20.0, 0.0, 0.0, 0.0))).cycles(2000)
    assert line.z()[0] == pytest.approx(-4.0, abs=0.01)


def test_timeout_starts_new_session_at_current_pose() -> None:
    line = Line().streams(1.0, to(z=-5.0)).cycles(260)
    assert line.robot.session.state is State.TIMED_OUT
    pose = line.robot.motion.pose
    line.received.clear()
    line.cycles(500)
    assert [one.seqno for one in line.received[:3]] == [0, 1, 2]
    assert line.received[0].tm_ms > 3000  # the controller's clock continues
    assert line.robot.motion.pose == pose
    never = Line(retry_s=0.0).cycles(2000)
    assert never.robot.session.state is State.TIMED_OUT


def test_silence_may_be_tolerated() -> None:
    assert Line(silence="never").cycles(1000).robot.session.state is State.GUIDING


# --- the ends of a run


def test_converged_window_ends_run() -> None:
    line = Line(cond_time_s=1.0).streams(0.9, to(z=-0.5))
    assert line.last.converged
    line.streams(0.5, to(z=-0.5))
    assert line.robot.session.state is State.ENDED
    assert states(line.last) == (Motors.ON, Guidance.STOPPED, Rapid.RUNNING)


def test_left_window_restarts_convergence_time() -> None:
    line = Line(cond_time_s=1.0).streams(0.9, to()).streams(0.3, to(z=-5.0))
    assert not line.last.converged
    line.streams(0.6, to())
    assert line.robot.session.state is State.GUIDING


def test_no_convergence_without_reference() -> None:
    assert not Line(cond_time_s=0.1).streams(0.5, SensorMessage(0)).last.converged


@pytest.mark.parametrize(
    ("rw", "settings", "ends"), [("7", {}, True), ("6.10", {}, False), ("7", {"di_ends_run": False}, False)]
)
def test_digital_signal_may_end_run(rw: str, settings: dict[str, Any], ends: bool) -> None:
    line = Line(rw=rw, **settings).streams(0.1, to()).streams(0.1, to()._replace(digital=True))
    assert (line.robot.session.state is State.ENDED) is ends


@pytest.mark.parametrize(("mode", "height"), [("hold", -3.0), ("ramp_down", 0.0)])
def test_end_of_run_holds_or_returns_to_start(mode: str, height: float) -> None:
    line = Line(stop_mode=mode, send_when="setup").streams(3.0, to(z=-3.0))
    line.inject("robot", "guidance-ended")
    line.streams(0.25, to(z=-3.0))
    between = line.z()[0]
    line.streams(0.5, to(z=-9.0))
    assert line.z()[0] == pytest.approx(height, abs=0.01)
    assert -2.0 < between < -1.0 or mode == "hold"
    assert states(line.last) == (Motors.ON, Guidance.STOPPED, Rapid.RUNNING)


@pytest.mark.parametrize(
    ("settings", "datagrams"),
    [({}, 1), ({"last_datagram": False}, 0), ({"send_when": "setup"}, 50), ({"sample_ms": 8.0}, 1)],
)
def test_datagrams_after_end_depend_on_setup(settings: dict[str, Any], datagrams: int) -> None:
    line = Line(**settings).streams(0.4, to())
    line.inject("robot", "guidance-ended")
    line.received.clear()
    line.cycles(50)
    assert len(line.received) == datagrams


# --- limits


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"workspace_min_mm": (0.0, -1000.0, 595.0)}, to(z=-20.0)),
        ({"max_pos_dev_deg": 0.5}, to(z=-50.0)),
        ({}, to(x=600.0)),  # beyond the reach of the arm
        ({"arm": EgmArmProfile(axis_speeds_deg_s=(2.0,) * 6)}, to(y=50.0)),  # a joint cannot go so fast
    ],
)
def test_reference_out_of_bounds_ends_guidance(settings: dict[str, Any], message: Answer) -> None:
    line = Line(**settings).streams(3.0, message)
    assert line.robot.session.state is State.FAILED
    assert line.robot.session.error == "the input is out of bounds"
    assert states(line.last) == (Motors.ON, Guidance.ERROR, Rapid.STOPPED)
    position = line.robot.motion.pose.position
    line.streams(3.0, message)  # no error handler begins again
    assert (line.robot.session.state, line.robot.motion.pose.position) == (State.FAILED, position)


# --- operators at the controller


def stream_then(fault: str, for_s: float, **settings: Any) -> tuple[Line, list[float]]:
    """Return the heights of the set point after a fault, mm, for a tool that was moving down at 10 mm/s."""
    line, ahead = Line(**settings), (0.0, 0.0, -10.0, 0.0, 0.0, 0.0)
    for k in range(300):
        line.answers(to(z=-10.0 * CYCLE * k, speed=ahead))
    line.inject("robot", fault, for_s)
    line.received.clear()
    reference = to(z=-10.0 * CYCLE * 299)
    count = round(for_s / CYCLE)
    line.cycles(count, lambda received: [reference])
    line.cycles(count, lambda received: [reference])
    return line, line.z(2 * count)


def test_motors_off_stops_set_point_until_on_again() -> None:
    line, heights = stream_then("motors-off", 1.0)
    assert {states(one) for one in line.received[1:249]} == {(Motors.OFF, Guidance.STOPPED, Rapid.STOPPED)}
    assert len(set(heights[1:249])) == 1
    assert states(line.last) == (Motors.ON, Guidance.RUNNING, Rapid.RUNNING)
    assert heights[-1] == pytest.approx(
        -10.0 * CYCLE * 299, abs=0.01
    )  # a PC that does not mind: the way continues
    assert max(np.abs(np.diff(heights[249:260]))) < 0.001  # with the ramp


def test_motors_on_may_leave_program_stopped() -> None:
    line, heights = stream_then("motors-off", 0.5, restart_after_motors_off=False)
    assert states(line.last) == (Motors.ON, Guidance.STOPPED, Rapid.STOPPED)
    assert len(set(heights[1:])) == 1


def test_stopped_program_ramps_down_and_resumes() -> None:
    line, heights = stream_then("program-stopped", 1.0)
    assert {states(one) for one in line.received[1:249]} == {(Motors.ON, Guidance.STOPPED, Rapid.STOPPED)}
    assert heights[0] - heights[240] == pytest.approx(10.0 * 0.5 / 2.0, abs=0.1)  # a ramp of half a second
    assert len(set(heights[130:249])) == 1
    assert states(line.last) == (Motors.ON, Guidance.RUNNING, Rapid.RUNNING)


def test_two_stops_must_both_end() -> None:
    line = Line().streams(0.4, to())
    line.inject("robot", "program-stopped", 0.4)
    line.inject("robot", "motors-off", 0.2)
    line.inject("robot", "program-restarted")
    observed = []
    for _ in range(3):
        line.streams(0.16, to())
        observed.append((line.last.motors, line.last.rapid))
    assert observed == [(Motors.OFF, Rapid.STOPPED), (Motors.ON, Rapid.STOPPED), (Motors.ON, Rapid.RUNNING)]
    assert states(line.last) == (Motors.ON, Guidance.RUNNING, Rapid.RUNNING)


def test_stopped_program_may_send_nothing() -> None:
    line = Line(sends_stopped=False).streams(0.4, to())
    line.inject("robot", "program-stopped", 0.2)
    line.received.clear()
    assert line.cycles(20).received == []


def test_restart_begins_session_at_current_pose() -> None:
    line = Line().streams(1.0, to(z=-5.0))
    line.inject("robot", "program-restarted")
    before = line.robot.motion.pose
    line.received.clear()
    line.cycles(100)
    assert [one.seqno for one in line.received[:2]] == [0, 1]
    assert line.robot.motion.pose == before


# --- faults of the link and of the pose


@pytest.mark.parametrize(
    ("fault", "values", "has_effect"),
    [
        ("mute", {}, lambda messages: messages == []),
        ("off", {}, lambda messages: messages == []),
        ("lost", {"probability": 1.0, "way": "from"}, lambda messages: messages == []),
        ("lost", {"probability": 1.0, "count": 4, "way": "from"}, lambda messages: len(messages) == 6),
        ("twice", {"probability": 1.0, "way": "from"}, lambda messages: len(messages) == 20),
        (
            "reordered",
            {"way": "from"},
            lambda messages: [one.seqno for one in messages[:4]] == [11, 10, 13, 12],
        ),
        (
            "wrong-seqno",
            {"by": 50, "count": 2},
            lambda messages: [one.seqno for one in messages[:3]] == [60, 61, 12],
        ),
        ("late", {"ms": 20.0, "way": "from"}, lambda messages: len(messages) == 5),
    ],
)
def test_each_wire_fault_has_effect(
    fault: str, values: dict[str, Any], has_effect: Callable[..., bool]
) -> None:
    line = Line().streams(10 * CYCLE, to())
    injection = line.inject("wire", fault, **values)
    reported: list[RobotMessage] = []
    for k in range(1, 11):
        now = line.now + k * CYCLE
        line.robot.endpoint.handle_deadline(now)
        reported += [decode_robot(one) for one in line.robot.endpoint.data_to_send(now)]
    assert has_effect(reported)
    assert injection.struck > 0


def test_measured_force_may_be_omitted() -> None:
    line = Line().streams(10 * CYCLE, to())
    assert line.last.force == (0.0,) * 6
    line.inject("witness", "missing")
    assert line.streams(10 * CYCLE, to()).last.force == ()


@pytest.mark.parametrize("fault", ["malformed", "corrupted", "garbled"])
def test_damaged_datagram_is_sent(fault: str) -> None:
    complete, damaged = Line().cycles(3), Line().cycles(3)
    values: dict[str, Any] = {} if fault == "malformed" else {"probability": 1.0, "way": "from"}
    damaged.inject("wire", fault, **values)
    for line in (complete, damaged):
        line.robot.endpoint.handle_deadline(T0 + 3 * CYCLE)
    assert complete.robot.endpoint.data_to_send(T0 + 3 * CYCLE) != damaged.robot.endpoint.data_to_send(
        T0 + 3 * CYCLE
    )


@pytest.mark.parametrize(
    ("fault", "values"),
    [("deaf", {}), ("lost", {"probability": 1.0, "way": "to"}), ("off", {"for_s": 3.0})],
)
def test_lost_answers_cause_timeout(fault: str, values: dict[str, Any]) -> None:
    line = Line().streams(0.4, to())
    line.inject("wire", fault, **values)
    assert line.streams(1.2, to()).robot.session.state is State.TIMED_OUT


def test_late_answers_act_late() -> None:
    line = Line(**AT_ONCE).cycles(2)
    line.inject("wire", "late", ms=40.0, way="to")
    line.streams(0.1, to(z=-2.0))
    assert sum(height == 0.0 for height in line.z(25)) in (11, 12)


def test_pose_faults_change_only_reported_pose() -> None:
    line, true = Line(), Line()
    for one in (line, true):
        one.streams(0.4, to(z=-2.0))
    line.inject("pose", "nan", count=1)
    assert math.isnan(measured(line.streams(CYCLE, to()).last).position_mm[0])
    line.inject("pose", "missing", count=1)
    feedback = line.streams(CYCLE, to()).last.feedback
    assert feedback is not None
    assert feedback.pose is None
    true.streams(2 * CYCLE, to())
    line.inject("pose", "offset", 0.01, z_mm=3.0)
    displayed, truth = (measured(one.streams(CYCLE, to()).last).position_mm[2] for one in (line, true))
    assert displayed - truth == pytest.approx(3.0)
    line.inject("pose", "frozen", 0.1)
    line.streams(0.05, to())
    assert len({measured(one).position_mm for one in line.received[-10:]}) == 1
    assert len({planned(one).position_mm for one in line.received[-10:]}) == 10


def test_network_error_ends_guidance() -> None:
    line = Line().streams(0.1, to())
    line.inject("robot", "cannot-send")
    assert line.robot.session.error.startswith("event 41830")
    line.inject("robot", "program-restarted")
    line.inject("robot", "out-of-limits")
    assert (line.robot.session.state, line.robot.session.error) == (
        State.FAILED,
        "the input is out of bounds",
    )
