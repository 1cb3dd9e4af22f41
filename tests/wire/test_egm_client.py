"""The client of a guided robot, in fed time: what it answers, and what it tells of the robot."""

import math
from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from emulators.devices.egm.profile import EgmArmProfile
from protocol.datagram import Datagram
from protocol.devices.egm import (
    EgmClient,
    Guidance,
    JointCheck,
    JointUnit,
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
from protocol.kinematics import Arm
from protocol.robot import ReportReceived, RobotReport, StreamEvent, StreamLost, StreamNotice

T0 = 1000.25
CYCLE = 0.004
DOWN = (0.0, 1.0, 0.0, 0.0)
HERE = PoseMm((600.0, 0.0, 500.0), DOWN)
STILL = (0.0,) * 6


def place(pose: PoseMm | None) -> Place:
    return Place((0.0,) * 6, pose, (), 1_700_000_000_000_000)


def told(number: int, **changes: Any) -> bytes:
    """A datagram of a robot that is guided, four milliseconds behind the one before."""
    message = RobotMessage(
        number, 1000 + 4 * number, place(HERE), place(HERE), Motors.ON, Guidance.RUNNING, Rapid.RUNNING, False
    )
    return encode_robot(message._replace(**changes), RobotWare.RW7)


class Conversation:
    """A client whose reports are answered as its user does: with a target in a movement, else with a hold."""

    def __init__(self, **settings: Any) -> None:
        self.client = EgmClient(CYCLE, **settings)
        self.goal: Pose | None = None
        self.events: list[StreamEvent] = []
        self.now = T0 - CYCLE

    def hears(self, *data: bytes, now: float | None = None) -> list[SensorMessage]:
        """The answers; by default a cycle after what it heard before."""
        self.now = now = self.now + CYCLE if now is None else now
        self.client.receive(data, now)
        while (event := self.client.next_event()) is not None:
            self.events.append(event)
            if isinstance(event, ReportReceived):
                if self.goal is None:
                    self.client.hold(now)
                else:
                    self.client.target(self.goal, now)
        answers = [decode_answer(answer) for answer in self.client.data_to_send(now)]
        return [answer for answer in answers if isinstance(answer, SensorMessage)]

    def begins(self, pose: Pose) -> None:
        self.client.begin(pose)
        self.goal = pose

    @property
    def reports(self) -> list[RobotReport]:
        return [event.report for event in self.events if isinstance(event, ReportReceived)]

    def texts(self, kind: type[StreamLost] | type[StreamNotice]) -> list[str]:
        return [event.text for event in self.events if isinstance(event, kind)]


def moved(x_mm: float = 0.0, z_mm: float = 0.0) -> Pose:
    x, y, z = HERE.position_mm
    return Pose(((x + x_mm) / 1e3, y / 1e3, (z + z_mm) / 1e3), DOWN)


def millimetres(answers: Sequence[SensorMessage]) -> tuple[float, ...]:
    (answer,) = answers
    assert answer.pose is not None
    return tuple(round(part, 9) for part in answer.pose.position_mm)


# --- one answer to a datagram


def test_it_is_silent_until_the_robot_speaks_and_answers_each_datagram_once() -> None:
    talk = Conversation()
    assert talk.client.data_to_send(T0) == []
    assert talk.client.next_deadline() is None
    talk.client.handle_deadline(T0)
    for number in range(5):
        (answer,) = talk.hears(told(number), now=T0 + number * CYCLE)
        assert (answer.seqno, answer.tm_ms) == (number, 1000 + 4 * number)
        assert (answer.pose, answer.speed) == (HERE, STILL)
        assert talk.client.data_to_send(T0 + number * CYCLE) == []
    assert [report.sequence for report in talk.reports] == [1, 2, 3, 4, 5]
    assert talk.reports[0].pose == moved()


def test_of_datagrams_that_come_together_only_the_newest_is_answered() -> None:
    """Each answer more would wait in the robot's queue for ever."""
    talk = Conversation()
    (answer,) = talk.hears(told(0), told(1), told(2))
    assert answer.tm_ms == 1008
    assert len(talk.reports) == 3


def test_a_datagram_that_comes_again_is_told_but_not_answered() -> None:
    talk = Conversation()
    assert talk.hears(told(0))
    assert talk.hears(told(0), now=T0 + 0.001) == []
    assert [report.sequence for report in talk.reports] == [1, 1]


def test_a_late_datagram_keeps_its_number_and_is_answered() -> None:
    talk = Conversation()
    for number in (0, 1, 3):
        talk.hears(told(number))
    (answer,) = talk.hears(told(2))
    assert answer.tm_ms == 1012
    assert [report.sequence for report in talk.reports] == [1, 2, 4, 3]


def test_behind_an_answer_that_came_too_late_to_be_taken_the_next_one_is_left_out() -> None:
    """The robot found none in one cycle, and would find two in the next."""
    talk = Conversation()
    given = []
    for number, late in enumerate((0.1, 0.2, 0.95, 0.1, 0.1, 0.95, 0.95, 0.95, 0.1)):
        at = T0 + number * CYCLE
        given.append(len(talk.hears(Datagram(told(number), at), now=at + late * CYCLE)))
    assert given == [1, 1, 1, 0, 1, 1, 0, 1, 0]


def test_datagrams_that_a_network_held_up_leave_no_answer_too_many() -> None:
    talk = Conversation()
    talk.hears(told(0))
    held = T0 + 1.9 * CYCLE  # number 1 comes just before number 2
    assert len(talk.hears(told(1), now=held)) == 1
    assert len(talk.hears(told(2), now=held + 0.05 * CYCLE)) == 0
    assert len(talk.hears(told(3), now=T0 + 3 * CYCLE)) == 1


def test_the_time_of_a_report_is_that_of_its_arrival() -> None:
    talk = Conversation()
    talk.hears(Datagram(told(0), T0 - 0.001), now=T0)
    assert (talk.reports[0].pose_at, talk.reports[0].received_at) == (T0 - 0.001, T0 - 0.001)


# --- the reference and its speed


def test_the_answer_carries_the_target_and_its_speed() -> None:
    talk = Conversation()
    talk.hears(told(0))
    talk.begins(moved())
    assert millimetres(talk.hears(told(1))) == (600.0, 0.0, 500.0)
    talk.goal = moved(x_mm=0.04, z_mm=-0.08)
    (answer,) = talk.hears(told(2))
    assert millimetres([answer]) == (600.04, 0.0, 499.92)
    assert answer.speed == pytest.approx((10.0, 0.0, -20.0, 0.0, 0.0, 0.0))
    (answer,) = talk.hears(told(3))  # the same target again
    assert answer.speed == STILL
    talk.goal = moved(x_mm=0.12, z_mm=-0.08)
    (answer,) = talk.hears(told(5))  # one datagram was lost: the way is one of two cycles
    assert answer.speed == pytest.approx((10.0, 0.0, 0.0, 0.0, 0.0, 0.0))


def test_a_movement_that_ends_on_its_way_has_its_speed_taken_back_at_once() -> None:
    """The bridge may be gone before another datagram comes."""
    talk = Conversation()
    talk.hears(told(0))
    talk.begins(moved())
    talk.goal = moved(z_mm=-0.08)
    assert talk.hears(told(1))[0].speed[2] == pytest.approx(-20.0)
    talk.client.end()
    talk.goal = None
    (data,) = talk.client.data_to_send(talk.now)
    answer = decode_answer(data)
    assert isinstance(answer, SensorMessage)
    assert (millimetres([answer]), answer.speed) == ((600.0, 0.0, 499.92), STILL)
    assert talk.client.data_to_send(talk.now) == []
    assert [len(talk.hears(told(number))) for number in (2, 3, 4)] == [
        0,
        1,
        1,
    ]  # it was the answer to the first
    talk.client.end()
    assert talk.client.data_to_send(talk.now) == []


def test_a_movement_that_ends_at_rest_sends_nothing_more() -> None:
    talk = Conversation()
    talk.hears(told(0))
    talk.begins(moved())
    talk.hears(told(1))
    talk.client.end()
    assert talk.client.data_to_send(talk.now) == []


def test_a_turn_has_a_speed_in_degrees() -> None:
    talk = Conversation()
    talk.hears(told(0))
    talk.begins(moved())
    half = math.radians(0.04) / 2.0
    talk.goal = Pose(moved().position, (0.0, math.cos(half), math.sin(half), 0.0))  # about base z
    (answer,) = talk.hears(told(1))
    assert answer.speed == pytest.approx((0.0, 0.0, 0.0, 0.0, 0.0, 10.0))


def test_without_feed_forward_no_speed_is_sent() -> None:
    talk = Conversation(feed_forward=False)
    assert talk.hears(told(0))[0].speed == ()


def test_behind_a_movement_the_last_reference_is_held_without_speed() -> None:
    talk = Conversation()
    talk.hears(told(0))
    talk.begins(moved())
    talk.goal = moved(z_mm=-0.08)
    talk.hears(told(1))
    talk.client.end()
    talk.goal = None
    measured = place(PoseMm((600.0, 0.0, 499.0), DOWN))  # it lags: to follow what is measured would drift
    talk.client.data_to_send(talk.now)
    talk.hears(told(2, feedback=measured))
    (answer,) = talk.hears(told(3, feedback=measured))
    assert (millimetres([answer]), answer.speed) == ((600.0, 0.0, 499.92), STILL)


# --- states of the robot


@pytest.mark.parametrize(
    ("state", "words"),
    [
        ({"motors": Motors.OFF}, "the motors are off"),
        ({"motors": Motors.UNDEFINED}, "the motors are off"),
        ({"rapid": Rapid.STOPPED}, "the RAPID program is stopped"),
        ({"guidance": Guidance.ERROR}, "EGM has ended with an error"),
        ({"guidance": Guidance.UNDEFINED}, "it is not guided"),
        ({"feedback": Place((0.0,) * 6)}, "it tells no pose"),
        ({"feedback": None}, "it tells no pose"),
    ],
)
def test_a_robot_that_cannot_move_is_told_with_words(state: dict[str, Any], words: str) -> None:
    talk = Conversation()
    talk.hears(told(0))
    talk.hears(told(1, **state))
    assert [report.fault[: len(words)] for report in talk.reports] == ["", words]


def test_a_controller_that_was_restarted_may_not_know_of_its_program() -> None:
    talk = Conversation()
    talk.hears(told(0, rapid=Rapid.UNDEFINED))
    assert talk.reports[0].fault == ""


def test_until_the_guidance_begins_the_robots_own_set_point_is_answered_and_nothing_told() -> None:
    talk = Conversation()
    planned = place(PoseMm((601.0, 0.0, 500.0), DOWN))
    for number in range(3):
        answers = talk.hears(
            told(number, guidance=Guidance.STOPPED, planned=planned), now=T0 + number * CYCLE
        )
        assert millimetres(answers) == (601.0, 0.0, 500.0)
    assert talk.reports == []
    assert millimetres(talk.hears(told(3, planned=planned))) == (601.0, 0.0, 500.0)
    assert talk.reports[0].fault == ""


def test_a_session_that_ends_as_the_client_joins_is_waited_out() -> None:
    talk = Conversation()
    assert len(talk.hears(told(250, guidance=Guidance.ERROR))) == 1
    assert talk.reports == []
    talk.hears(told(0, guidance=Guidance.STOPPED, tm_ms=4000), now=T0 + 2.0)
    talk.hears(told(1, tm_ms=4004), now=T0 + 2.0 + CYCLE)
    assert [report.fault for report in talk.reports] == [""]


def test_a_first_datagram_that_comes_twice_is_no_fault_either() -> None:
    talk = Conversation()
    first = told(0, guidance=Guidance.STOPPED)
    assert len(talk.hears(first)) == 1
    assert talk.hears(first) == []
    talk.hears(told(1))
    assert [report.fault for report in talk.reports] == [""]


def test_a_guidance_that_never_begins_is_told_after_a_while() -> None:
    talk = Conversation()
    talk.hears(told(0, guidance=Guidance.STOPPED))
    talk.hears(told(1, guidance=Guidance.STOPPED), now=T0 + 5.1)
    assert "EGMRunPose has not begun" in talk.reports[0].fault


def test_a_guidance_that_ends_in_a_movement_leaves_the_robot_where_it_stands_also_when_it_goes_on() -> None:
    talk = Conversation()
    talk.hears(told(0))
    talk.begins(moved())
    talk.goal = moved(z_mm=-50.0)
    stands = place(PoseMm((600.0, 0.0, 497.0), DOWN))
    for number, guidance in enumerate(
        (Guidance.STOPPED, Guidance.STOPPED, Guidance.RUNNING, Guidance.RUNNING)
    ):
        (answer,) = talk.hears(told(1 + number, guidance=guidance, planned=stands))
        assert (millimetres([answer]), answer.speed) == ((600.0, 0.0, 497.0), STILL)
    talk.client.end()
    talk.begins(moved(z_mm=-3.0))  # another movement may move it again
    talk.goal = moved(z_mm=-3.08)
    assert millimetres(talk.hears(told(5))) == (600.0, 0.0, 496.92)


def test_a_movement_that_begins_while_the_robot_stands_moves_nothing() -> None:
    talk = Conversation()
    talk.hears(told(0))
    talk.hears(told(1, motors=Motors.OFF))
    talk.begins(moved(z_mm=-9.0))
    assert millimetres(talk.hears(told(2))) == (600.0, 0.0, 500.0)


def test_a_set_point_that_is_none_is_not_sent_back() -> None:
    talk = Conversation()
    bad = place(PoseMm((math.nan, 0.0, 0.0), DOWN))
    assert talk.hears(told(0, planned=bad)) == []
    assert millimetres(talk.hears(told(1))) == (600.0, 0.0, 500.0)
    assert millimetres(talk.hears(told(2, planned=bad, motors=Motors.OFF))) == (600.0, 0.0, 500.0)


def test_a_measured_pose_that_is_none_is_told_as_it_is() -> None:
    talk = Conversation()
    talk.hears(told(0, feedback=place(PoseMm((math.nan, 0.0, 0.0), DOWN))))
    assert math.isnan(talk.reports[0].pose.position[0])  # its user looks at it


def test_a_robot_with_another_cycle_is_told_so() -> None:
    talk = Conversation()
    for number in range(30):
        talk.hears(told(number, tm_ms=1000 + 8 * number))
    assert [bool(report.fault) for report in talk.reports] == [False] * 25 + [True] * 5
    assert talk.reports[-1].fault == "it sends every 8.0 ms and not every 4 ms"
    assert "set robot.egm.sample_ms" in talk.reports[-1].remedy


# --- sessions


@pytest.mark.parametrize("moving", [True, False])
def test_another_session_ends_a_movement_and_the_numbers_count_on(moving: bool) -> None:
    talk = Conversation()
    for number in range(100, 103):
        talk.hears(told(number))
    if moving:
        talk.begins(moved())
        talk.goal = moved(z_mm=-1.0)
    elsewhere = place(PoseMm((602.0, 0.0, 500.0), DOWN))
    assert not any(talk.hears(told(k, tm_ms=4984 + 4 * k, planned=elsewhere)) for k in range(4))
    (answer,) = talk.hears(told(4, tm_ms=5000, planned=elsewhere))
    assert (millimetres([answer]), answer.speed) == ((602.0, 0.0, 500.0), STILL)
    told_of = talk.texts(StreamLost if moving else StreamNotice)
    assert ["another EGM session" in text for text in told_of if "not heeded" not in text] == [True]
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
def test_a_smaller_number_is_a_late_datagram_or_another_session(
    number: int, tm: int, after_s: float, another: bool
) -> None:
    talk = Conversation()
    talk.hears(told(5, tm_ms=1020))
    talk.hears(told(number, tm_ms=tm), now=T0 + after_s)
    assert bool(talk.texts(StreamNotice)) is another


@pytest.mark.parametrize("number", [2**32 - 200, 20, 70, 5000])
def test_client_one_stray_number_is_not_answered(number: int) -> None:
    talk = Conversation()
    for k in range(8):
        talk.hears(told(k))
    talk.begins(moved(z_mm=-1.0))
    assert talk.hears(told(number, tm_ms=6000)) == []
    assert len(talk.hears(told(8))) == 1
    assert talk.texts(StreamLost) == []
    assert talk.texts(StreamNotice) == [f"datagram {number} behind 7 is not heeded"]


def test_client_numbers_anew_while_guided_are_a_fault_once() -> None:
    talk = Conversation()
    for k in range(8):
        talk.hears(told(k))
    talk.begins(moved())
    for k in range(4):
        assert talk.hears(told(2**32 - 200 + k, tm_ms=1032 + 4 * k)) == []
    talk.hears(told(2**32 - 200 + 4, tm_ms=1048))
    assert talk.reports[-1].fault == "its datagrams are numbered again"
    talk.hears(told(2**32 - 200 + 5, tm_ms=1052))
    talk.begins(moved())
    talk.goal = moved(z_mm=1.0)
    answers = talk.hears(told(2**32 - 200 + 6, tm_ms=1056))
    assert (talk.reports[-1].fault, talk.texts(StreamLost)) == ("", [])
    assert millimetres(answers) == (600.0, 0.0, 501.0)


def test_numbers_wrap_around() -> None:
    talk = Conversation()
    for number in (2**32 - 2, 2**32 - 1, 0, 1):
        talk.hears(told(number, tm_ms=(2**32 - 8 + 4 * number) % 2**32))
    assert [report.sequence for report in talk.reports] == [1, 2, 3, 4]
    assert talk.texts(StreamNotice) == []


# --- what is no datagram of a robot


def test_what_is_no_datagram_is_told_once_a_second_and_not_answered() -> None:
    talk = Conversation()
    for k in range(12):
        assert talk.hears(b"\xff\xff", now=T0 + 0.1 * k) == []
    assert talk.hears(encode_robot(RobotMessage(0, 0), RobotWare.RW7)[:-1], now=T0 + 2.5) == []
    assert [text.partition(":")[0] for text in talk.texts(StreamNotice)] == ["a datagram is not heeded"] * 3


@given(st.lists(st.binary(max_size=60) | st.integers(0, 8).map(told), max_size=12))
def test_no_datagrams_make_it_raise_or_answer_more_than_once(data: list[bytes]) -> None:
    talk = Conversation()
    for datagram in data:
        assert len(talk.hears(datagram)) <= 1


@pytest.mark.parametrize(
    ("axes", "force"), [("tool", (0.0, 0.0, 12.5)), ("base", (0.0, 0.0, -12.5)), ("none", None)]
)
@pytest.mark.parametrize("shape", ["6", "7"])
def test_the_robots_own_force_is_told_in_the_base_frame(
    axes: str, force: tuple[float, ...] | None, shape: str
) -> None:
    """The specification's force of 12.5 N along a tool that points down, in both shapes of the message."""
    version, active = (RobotWare.RW7, False) if shape == "7" else (RobotWare.RW6_10, None)
    message = decode_robot(told(1))._replace(force=(0.0, 0.0, -12.5, 0.0, 0.25, 0.0), force_control=active)
    talk = Conversation(force_axes=axes)
    talk.hears(encode_robot(message, version))
    assert talk.reports[0].force == force


@pytest.mark.parametrize("force", [(), (0.0,) * 6, (math.nan,) * 6, (1.0, 2.0)])
def test_a_force_that_is_none_is_not_told(force: tuple[float, ...]) -> None:
    talk = Conversation()
    talk.hears(told(1, force=force, force_control=False))
    assert talk.reports[0].force is None


# --- unit of the joints


def joint_place(unit: float, tool_mm: float = 150.0) -> Place:
    """Feedback of the emulated arm at some joints, told in degrees times `unit`, and the pose that they hold."""
    arm = Arm(EgmArmProfile(), tool_mm * 1e-3)
    joints = (0.2, 0.1, 0.3, -0.2, 1.1, 0.4)
    position, quaternion = arm.pose(joints)
    x, y, z = (part * 1e3 for part in position)
    degrees = tuple(math.degrees(joint) * unit for joint in joints)
    return Place(degrees, PoseMm((x, y, z), quaternion), (), 1_700_000_000_000_000)


@pytest.mark.parametrize("tool_mm", [0.0, 150.0])
@pytest.mark.parametrize(("sent", "read"), [("radians", "degrees"), ("degrees", "radians")])
def test_client_refuses_joints_that_fit_the_other_unit(
    sent: JointUnit, read: JointUnit, tool_mm: float
) -> None:
    place = joint_place(math.radians(1.0) if sent == "radians" else 1.0, tool_mm)
    robot = Conversation(joints=JointCheck(Arm(EgmArmProfile(), 0.0), read))
    robot.hears(told(1, feedback=place, planned=place))
    (report,) = robot.reports
    assert report.fault == f"its joints, read in {read}, contradict its own pose; they fit it in {sent}"
    assert report.remedy == f'set robot.egm.joints_in to "{sent}"'
    right = Conversation(joints=JointCheck(Arm(EgmArmProfile(), 0.0), sent))
    right.hears(told(1, feedback=place, planned=place))
    assert right.reports[0].fault == ""


def test_joints_of_an_unknown_arm_or_tool_are_no_reason_to_refuse() -> None:
    place = joint_place(math.radians(1.0))
    other = EgmArmProfile(upper_arm_mm=1075.0, forearm_mm=1392.0)
    robot = Conversation(joints=JointCheck(Arm(other, 0.0), "degrees"))
    robot.hears(told(1, feedback=place, planned=place))
    few = place._replace(joints_deg=(0.0,) * 4)
    robot.hears(told(2, feedback=few, planned=few))
    nan = place._replace(joints_deg=(math.nan,) * 6)
    robot.hears(told(3, feedback=nan, planned=nan))
    assert [report.fault for report in robot.reports] == ["", "", ""]
