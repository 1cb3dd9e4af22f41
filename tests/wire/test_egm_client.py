"""Client of a guided robot, in simulated time: its answers, and its reports about the robot."""

import math
from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.datagram import Datagram
from protocol.devices.egm import (
    Guidance,
    Motors,
    Place,
    PoseMm,
    Rapid,
    RobotMessage,
    RobotWare,
    SensorMessage,
    decode_answer,
    decode_robot,
    encode_robot,
)
from protocol.geometry import Pose
from protocol.robot import StreamLost, StreamNotice
from tests.wire.egm_conversation import CYCLE, DOWN, HERE, STILL, T0, Conversation, place, robot_report


def offset_pose(x_mm: float = 0.0, z_mm: float = 0.0) -> Pose:
    x, y, z = HERE.position_mm
    return Pose(((x + x_mm) / 1e3, y / 1e3, (z + z_mm) / 1e3), DOWN)


def millimetres(answers: Sequence[SensorMessage]) -> tuple[float, ...]:
    (answer,) = answers
    assert answer.pose is not None
    return tuple(round(part, 9) for part in answer.pose.position_mm)


# --- one answer to a datagram


def test_client_is_silent_first_and_answers_each_datagram_once() -> None:
    talk = Conversation()
    assert talk.client.data_to_send(T0) == []
    assert talk.client.next_deadline() is None
    talk.client.handle_deadline(T0)
    for number in range(5):
        (answer,) = talk.receive(robot_report(number), now=T0 + number * CYCLE)
        assert (answer.seqno, answer.tm_ms) == (number, 1000 + 4 * number)
        assert (answer.pose, answer.speed) == (HERE, STILL)
        assert talk.client.data_to_send(T0 + number * CYCLE) == []
    assert [report.sequence for report in talk.reports] == [1, 2, 3, 4, 5]
    assert talk.reports[0].pose == offset_pose()


def test_only_the_newest_of_simultaneous_datagrams_is_answered() -> None:
    """Each surplus answer would stay in the robot's queue forever."""
    talk = Conversation()
    (answer,) = talk.receive(robot_report(0), robot_report(1), robot_report(2))
    assert answer.tm_ms == 1008
    assert len(talk.reports) == 3


def test_repeated_datagram_is_reported_but_not_answered() -> None:
    talk = Conversation()
    assert talk.receive(robot_report(0))
    assert talk.receive(robot_report(0), now=T0 + 0.001) == []
    assert [report.sequence for report in talk.reports] == [1, 1]


def test_late_datagram_keeps_its_number_and_is_answered() -> None:
    talk = Conversation()
    for number in (0, 1, 3):
        talk.receive(robot_report(number))
    (answer,) = talk.receive(robot_report(2))
    assert answer.tm_ms == 1012
    assert [report.sequence for report in talk.reports] == [1, 2, 4, 3]


def test_answer_after_a_late_one_is_skipped() -> None:
    """The robot received no answer in one cycle, and would find two in the next."""
    talk = Conversation()
    answers = []
    for number, late in enumerate((0.1, 0.2, 0.95, 0.1, 0.1, 0.95, 0.95, 0.95, 0.1)):
        at = T0 + number * CYCLE
        answers.append(len(talk.receive(Datagram(robot_report(number), at), now=at + late * CYCLE)))
    assert answers == [1, 1, 1, 0, 1, 1, 0, 1, 0]


def test_delayed_datagrams_leave_no_surplus_answer() -> None:
    talk = Conversation()
    talk.receive(robot_report(0))
    received_at = T0 + 1.9 * CYCLE  # number 1 comes just before number 2
    assert len(talk.receive(robot_report(1), now=received_at)) == 1
    assert len(talk.receive(robot_report(2), now=received_at + 0.05 * CYCLE)) == 0
    assert len(talk.receive(robot_report(3), now=T0 + 3 * CYCLE)) == 1


def test_report_time_is_the_time_of_arrival() -> None:
    talk = Conversation()
    talk.receive(Datagram(robot_report(0), T0 - 0.001), now=T0)
    assert (talk.reports[0].pose_at, talk.reports[0].received_at) == (T0 - 0.001, T0 - 0.001)


# --- the reference and its speed


def test_answer_carries_the_target_and_its_speed() -> None:
    talk = Conversation()
    talk.receive(robot_report(0))
    talk.begins(offset_pose())
    assert millimetres(talk.receive(robot_report(1))) == (600.0, 0.0, 500.0)
    talk.goal = offset_pose(x_mm=0.04, z_mm=-0.08)
    (answer,) = talk.receive(robot_report(2))
    assert millimetres([answer]) == (600.04, 0.0, 499.92)
    assert answer.speed == pytest.approx((10.0, 0.0, -20.0, 0.0, 0.0, 0.0))
    (answer,) = talk.receive(robot_report(3))  # the same target again
    assert answer.speed == STILL
    talk.goal = offset_pose(x_mm=0.12, z_mm=-0.08)
    (answer,) = talk.receive(robot_report(5))  # one datagram was lost: the way is one of two cycles
    assert answer.speed == pytest.approx((10.0, 0.0, 0.0, 0.0, 0.0, 0.0))


def test_speed_is_withdrawn_when_a_moving_movement_ends() -> None:
    """The bridge may have ended before another datagram arrives."""
    talk = Conversation()
    talk.receive(robot_report(0))
    talk.begins(offset_pose())
    talk.goal = offset_pose(z_mm=-0.08)
    assert talk.receive(robot_report(1))[0].speed[2] == pytest.approx(-20.0)
    talk.client.end()
    talk.goal = None
    (data,) = talk.client.data_to_send(talk.now)
    answer = decode_answer(data)
    assert isinstance(answer, SensorMessage)
    assert (millimetres([answer]), answer.speed) == ((600.0, 0.0, 499.92), STILL)
    assert talk.client.data_to_send(talk.now) == []
    assert [len(talk.receive(robot_report(number))) for number in (2, 3, 4)] == [
        0,
        1,
        1,
    ]  # it was the answer to the first
    talk.client.end()
    assert talk.client.data_to_send(talk.now) == []


def test_movement_that_ends_stationary_sends_nothing_more() -> None:
    talk = Conversation()
    talk.receive(robot_report(0))
    talk.begins(offset_pose())
    talk.receive(robot_report(1))
    talk.client.end()
    assert talk.client.data_to_send(talk.now) == []


def test_turn_has_a_speed_in_degrees() -> None:
    talk = Conversation()
    talk.receive(robot_report(0))
    talk.begins(offset_pose())
    half = math.radians(0.04) / 2.0
    talk.goal = Pose(offset_pose().position, (0.0, math.cos(half), math.sin(half), 0.0))  # about base z
    (answer,) = talk.receive(robot_report(1))
    assert answer.speed == pytest.approx((0.0, 0.0, 0.0, 0.0, 0.0, 10.0))


def test_without_feed_forward_no_speed_is_sent() -> None:
    talk = Conversation(feed_forward=False)
    assert talk.receive(robot_report(0))[0].speed == ()


def test_last_reference_is_held_without_speed_after_a_movement() -> None:
    talk = Conversation()
    talk.receive(robot_report(0))
    talk.begins(offset_pose())
    talk.goal = offset_pose(z_mm=-0.08)
    talk.receive(robot_report(1))
    talk.client.end()
    talk.goal = None
    measured = place(PoseMm((600.0, 0.0, 499.0), DOWN))  # it lags: to follow what is measured would drift
    talk.client.data_to_send(talk.now)
    talk.receive(robot_report(2, feedback=measured))
    (answer,) = talk.receive(robot_report(3, feedback=measured))
    assert (millimetres([answer]), answer.speed) == ((600.0, 0.0, 499.92), STILL)


# --- states of the robot


@pytest.mark.parametrize(
    ("state", "message"),
    [
        ({"motors": Motors.OFF}, "the motors are off"),
        ({"motors": Motors.UNDEFINED}, "the motors are off"),
        ({"rapid": Rapid.STOPPED}, "the RAPID program is stopped"),
        ({"guidance": Guidance.ERROR}, "EGM has ended with an error"),
        ({"guidance": Guidance.UNDEFINED}, "it is not guided"),
        ({"feedback": Place((0.0,) * 6)}, "it reports no pose"),
        ({"feedback": None}, "it reports no pose"),
    ],
)
def test_robot_that_cannot_move_is_reported_with_the_reason(state: dict[str, Any], message: str) -> None:
    talk = Conversation()
    talk.receive(robot_report(0))
    talk.receive(robot_report(1, **state))
    assert [report.fault[: len(message)] for report in talk.reports] == ["", message]


def test_restarted_controller_may_have_undefined_program_state() -> None:
    talk = Conversation()
    talk.receive(robot_report(0, rapid=Rapid.UNDEFINED))
    assert talk.reports[0].fault == ""


def test_own_set_point_is_answered_until_guidance_begins() -> None:
    talk = Conversation()
    planned = place(PoseMm((601.0, 0.0, 500.0), DOWN))
    for number in range(3):
        answers = talk.receive(
            robot_report(number, guidance=Guidance.STOPPED, planned=planned), now=T0 + number * CYCLE
        )
        assert millimetres(answers) == (601.0, 0.0, 500.0)
    assert talk.reports == []
    assert millimetres(talk.receive(robot_report(3, planned=planned))) == (601.0, 0.0, 500.0)
    assert talk.reports[0].fault == ""


def test_session_ending_while_the_client_joins_is_waited_out() -> None:
    talk = Conversation()
    assert len(talk.receive(robot_report(250, guidance=Guidance.ERROR))) == 1
    assert talk.reports == []
    talk.receive(robot_report(0, guidance=Guidance.STOPPED, tm_ms=4000), now=T0 + 2.0)
    talk.receive(robot_report(1, tm_ms=4004), now=T0 + 2.0 + CYCLE)
    assert [report.fault for report in talk.reports] == [""]


def test_repeated_first_datagram_is_not_a_fault() -> None:
    talk = Conversation()
    first = robot_report(0, guidance=Guidance.STOPPED)
    assert len(talk.receive(first)) == 1
    assert talk.receive(first) == []
    talk.receive(robot_report(1))
    assert [report.fault for report in talk.reports] == [""]


def test_guidance_that_never_begins_is_reported_after_a_while() -> None:
    talk = Conversation()
    talk.receive(robot_report(0, guidance=Guidance.STOPPED))
    talk.receive(robot_report(1, guidance=Guidance.STOPPED), now=T0 + 5.1)
    assert "EGMRunPose has not started" in talk.reports[0].fault


def test_robot_stays_after_guidance_ends_in_a_movement() -> None:
    talk = Conversation()
    talk.receive(robot_report(0))
    talk.begins(offset_pose())
    talk.goal = offset_pose(z_mm=-50.0)
    stationary = place(PoseMm((600.0, 0.0, 497.0), DOWN))
    for number, guidance in enumerate(
        (Guidance.STOPPED, Guidance.STOPPED, Guidance.RUNNING, Guidance.RUNNING)
    ):
        (answer,) = talk.receive(robot_report(1 + number, guidance=guidance, planned=stationary))
        assert (millimetres([answer]), answer.speed) == ((600.0, 0.0, 497.0), STILL)
    talk.client.end()
    talk.begins(offset_pose(z_mm=-3.0))  # another movement may move it again
    talk.goal = offset_pose(z_mm=-3.08)
    assert millimetres(talk.receive(robot_report(5))) == (600.0, 0.0, 496.92)


def test_movement_of_a_stationary_robot_moves_nothing() -> None:
    talk = Conversation()
    talk.receive(robot_report(0))
    talk.receive(robot_report(1, motors=Motors.OFF))
    talk.begins(offset_pose(z_mm=-9.0))
    assert millimetres(talk.receive(robot_report(2))) == (600.0, 0.0, 500.0)


def test_invalid_set_point_is_not_sent_back() -> None:
    talk = Conversation()
    bad = place(PoseMm((math.nan, 0.0, 0.0), DOWN))
    assert talk.receive(robot_report(0, planned=bad)) == []
    assert millimetres(talk.receive(robot_report(1))) == (600.0, 0.0, 500.0)
    assert millimetres(talk.receive(robot_report(2, planned=bad, motors=Motors.OFF))) == (600.0, 0.0, 500.0)


def test_invalid_measured_pose_is_reported_unchanged() -> None:
    talk = Conversation()
    talk.receive(robot_report(0, feedback=place(PoseMm((math.nan, 0.0, 0.0), DOWN))))
    assert math.isnan(talk.reports[0].pose.position[0])  # its user looks at it


def test_robot_with_another_cycle_is_reported() -> None:
    talk = Conversation()
    for number in range(30):
        talk.receive(robot_report(number, tm_ms=1000 + 8 * number))
    assert [bool(report.fault) for report in talk.reports] == [False] * 25 + [True] * 5
    assert talk.reports[-1].fault == "it sends every 8.0 ms instead of every 4 ms"
    assert "set robot.egm.sample_ms" in talk.reports[-1].remedy


# --- sessions


@pytest.mark.parametrize("moving", [True, False])
def test_another_session_ends_a_movement_and_numbers_continue(moving: bool) -> None:
    talk = Conversation()
    for number in range(100, 103):
        talk.receive(robot_report(number))
    if moving:
        talk.begins(offset_pose())
        talk.goal = offset_pose(z_mm=-1.0)
    elsewhere = place(PoseMm((602.0, 0.0, 500.0), DOWN))
    assert not any(talk.receive(robot_report(k, tm_ms=4984 + 4 * k, planned=elsewhere)) for k in range(4))
    (answer,) = talk.receive(robot_report(4, tm_ms=5000, planned=elsewhere))
    assert (millimetres([answer]), answer.speed) == ((602.0, 0.0, 500.0), STILL)
    texts = talk.texts(StreamLost if moving else StreamNotice)
    assert ["another EGM session" in text for text in texts if "is ignored" not in text] == [True]
    assert [report.sequence for report in talk.reports] == [1, 2, 3, 4]


@pytest.mark.parametrize(
    ("number", "tm", "after_s", "another"),
    [
        (4, 1015, 0.0, False),  # late by one
        (4, 1024, 0.0, True),  # the robot's clock continued
        (4, 1000, 1.5, True),  # after a silence
        (2**32 - 200, 0, 0.0, True),  # a controller that was switched on again
    ],
)
def test_smaller_number_is_a_late_datagram_or_another_session(
    number: int, tm: int, after_s: float, another: bool
) -> None:
    talk = Conversation()
    talk.receive(robot_report(5, tm_ms=1020))
    talk.receive(robot_report(number, tm_ms=tm), now=T0 + after_s)
    assert bool(talk.texts(StreamNotice)) is another


@pytest.mark.parametrize("number", [2**32 - 200, 20, 70, 5000])
def test_client_one_stray_number_is_not_answered(number: int) -> None:
    talk = Conversation()
    for k in range(8):
        talk.receive(robot_report(k))
    talk.begins(offset_pose(z_mm=-1.0))
    assert talk.receive(robot_report(number, tm_ms=6000)) == []
    assert len(talk.receive(robot_report(8))) == 1
    assert talk.texts(StreamLost) == []
    assert talk.texts(StreamNotice) == [f"datagram {number} after 7 is ignored"]


def test_client_renumbering_while_guided_is_a_fault_once() -> None:
    talk = Conversation()
    for k in range(8):
        talk.receive(robot_report(k))
    talk.begins(offset_pose())
    for k in range(4):
        assert talk.receive(robot_report(2**32 - 200 + k, tm_ms=1032 + 4 * k)) == []
    talk.receive(robot_report(2**32 - 200 + 4, tm_ms=1048))
    assert talk.reports[-1].fault == "its datagrams restarted their numbering"
    talk.receive(robot_report(2**32 - 200 + 5, tm_ms=1052))
    talk.begins(offset_pose())
    talk.goal = offset_pose(z_mm=1.0)
    answers = talk.receive(robot_report(2**32 - 200 + 6, tm_ms=1056))
    assert (talk.reports[-1].fault, talk.texts(StreamLost)) == ("", [])
    assert millimetres(answers) == (600.0, 0.0, 501.0)


def test_numbers_wrap_around() -> None:
    talk = Conversation()
    for number in (2**32 - 2, 2**32 - 1, 0, 1):
        talk.receive(robot_report(number, tm_ms=(2**32 - 8 + 4 * number) % 2**32))
    assert [report.sequence for report in talk.reports] == [1, 2, 3, 4]
    assert talk.texts(StreamNotice) == []


# --- what is no datagram of a robot


def test_invalid_datagram_is_reported_once_a_second_unanswered() -> None:
    talk = Conversation()
    for k in range(12):
        assert talk.receive(b"\xff\xff", now=T0 + 0.1 * k) == []
    assert talk.receive(encode_robot(RobotMessage(0, 0), RobotWare.RW7)[:-1], now=T0 + 2.5) == []
    assert [text.partition(":")[0] for text in talk.texts(StreamNotice)] == ["a datagram is ignored"] * 3


@given(st.lists(st.binary(max_size=60) | st.integers(0, 8).map(robot_report), max_size=12))
def test_no_datagrams_make_it_raise_or_answer_more_than_once(data: list[bytes]) -> None:
    talk = Conversation()
    for datagram in data:
        assert len(talk.receive(datagram)) <= 1


@pytest.mark.parametrize(
    ("axes", "force"), [("tool", (0.0, 0.0, 12.5)), ("base", (0.0, 0.0, -12.5)), ("none", None)]
)
@pytest.mark.parametrize("shape", ["6", "7"])
def test_robot_force_is_reported_in_the_base_frame(
    axes: str, force: tuple[float, ...] | None, shape: str
) -> None:
    """The specification's force of 12.5 N along a tool that points down, in both schemas of the message."""
    version, active = (RobotWare.RW7, False) if shape == "7" else (RobotWare.RW6_10, None)
    message = decode_robot(robot_report(1))._replace(
        force=(0.0, 0.0, -12.5, 0.0, 0.25, 0.0), force_control=active
    )
    talk = Conversation(force_axes=axes)
    talk.receive(encode_robot(message, version))
    assert talk.reports[0].force == force


@pytest.mark.parametrize("force", [(), (0.0,) * 6, (math.nan,) * 6, (1.0, 2.0)])
def test_invalid_force_is_not_reported(force: tuple[float, ...]) -> None:
    talk = Conversation()
    talk.receive(robot_report(1, force=force, force_control=False))
    assert talk.reports[0].force is None
