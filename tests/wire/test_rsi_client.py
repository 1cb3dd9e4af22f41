"""RSI client: one answer per telegram, increments that count once, limits, sessions, and a robot that refuses."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.devices.rsi import (
    ROBOT,
    RsiClient,
    RsiLink,
    Telegram,
    decode,
    encode,
    fixed,
    numbers,
    pose_tags,
)
from protocol.devices.rsi.angles import values_of
from protocol.endpoint import Trouble
from protocol.geometry import Pose, from_angles, product
from protocol.robot import ReportReceived, RobotReport, StreamLost, StreamNotice

CYCLE_MS = 4
DOWN = (0.0, 1.0, 0.0, 0.0)
START = Pose((0.6, 0.0, 0.5), DOWN)
TAGS = pose_tags("RKorr")


def telegram(
    ipoc: int, pose: Pose = START, late: int | None = 0, planned: Pose | None = START, **more: str
) -> bytes:
    values = {tag: fixed(value, 4) for tag, value in zip(pose_tags("RIst"), values_of(pose), strict=True)}
    if planned is not None:
        values |= {tag: fixed(v, 4) for tag, v in zip(pose_tags("RSol"), values_of(planned), strict=True)}
    if late is not None:
        values["Delay.D"] = str(late)
    return encode(
        Telegram(ROBOT, "KUKA", {**values, **{k.replace("_", "."): v for k, v in more.items()}}, ipoc)
    )


def pose_at(z_mm: float, x_mm: float = 0.0) -> Pose:
    (x, y, z), quaternion = START
    return Pose((x + x_mm * 1e-3, y, z + z_mm * 1e-3), quaternion)


@dataclass
class Driver:
    """A client, and the calls of its user."""

    link: RsiLink = field(default_factory=RsiLink)
    now: float = 1000.0

    def __post_init__(self) -> None:
        self.client = RsiClient(self.link)
        self.reports: list[RobotReport] = []
        self.notices: list[str] = []
        self.lost: list[str] = []

    def give(self, *raw: bytes, to: Pose | None = None, after: float = 0.004) -> list[Telegram]:
        """Return the answers to some telegrams that arrive together."""
        self.now += after
        client = self.client
        client.receive(list(raw), self.now)
        while (event := client.next_event()) is not None:
            match event:
                case ReportReceived(report=report):
                    self.reports.append(report)
                    if to is None:
                        client.hold(self.now)
                    else:
                        client.target(to, self.now)
                case StreamLost(text=text, remedy=remedy):
                    self.lost.append(str(Trouble(text, remedy)))
                    to = None
                case StreamNotice(text=text):
                    self.notices.append(text)
        return [decode(answer) for answer in client.data_to_send(self.now)]

    def value(self, *raw: bytes, to: Pose | None = None) -> list[float]:
        """Return the correction in the only answer."""
        (answer,) = self.give(*raw, to=to)
        correction = numbers(answer.values, TAGS)
        assert correction is not None
        return correction


def relative(**settings: float) -> Driver:
    return Driver(RsiLink(**settings))  # type: ignore[arg-type]


def absolute(**settings: float) -> Driver:
    return Driver(RsiLink(mode="absolute", **settings))  # type: ignore[arg-type]


# --- answers


def test_specifications_exchange_to_the_byte() -> None:
    driver = relative()
    driver.client.receive([telegram(123456)], driver.now)
    assert isinstance(driver.client.next_event(), ReportReceived)
    driver.client.begin(START)
    driver.client.target(pose_at(-0.02), driver.now)
    assert driver.client.data_to_send(driver.now) == [
        b'<Sen Type="ImFree"><RKorr X="0.000000" Y="0.000000" Z="-0.020000" A="0.000000" B="0.000000" '
        b'C="0.000000"/><IPOC>123456</IPOC></Sen>'
    ]
    assert driver.client.data_to_send(driver.now) == []
    driver.client.end()
    driver.client.receive([telegram(123460)], driver.now + 0.004)
    assert isinstance(driver.client.next_event(), ReportReceived)
    driver.client.hold(driver.now)
    assert driver.client.data_to_send(driver.now) == [
        b'<Sen Type="ImFree"><RKorr X="0.000000" Y="0.000000" Z="0.000000" A="0.000000" B="0.000000" '
        b'C="0.000000"/><IPOC>123460</IPOC></Sen>'
    ]
    assert driver.client.next_deadline() is None
    driver.client.handle_deadline(driver.now)


def test_relative_answers_carry_changes_and_absolute_ones_totals() -> None:
    for driver, expected in ((relative(), [-0.1, -0.2, 0.0]), (absolute(), [-0.1, -0.3, -0.3])):
        driver.give(telegram(0))
        driver.client.begin(START)
        values = [driver.value(telegram(4), to=pose_at(-0.1))[2]]
        values.append(driver.value(telegram(8), to=pose_at(-0.3))[2])
        driver.client.end()
        values.append(driver.value(telegram(12))[2])
        assert values == pytest.approx(expected)


def test_second_movement_continues_from_the_first_correction() -> None:
    driver = absolute()
    driver.give(telegram(0))
    driver.client.begin(START)
    driver.give(telegram(4), to=pose_at(-0.3))
    driver.client.end()
    driver.client.begin(pose_at(-0.29))  # as the robot has come to it
    assert driver.value(telegram(8), to=pose_at(-0.29))[2] == pytest.approx(-0.3)
    assert driver.value(telegram(12), to=pose_at(-0.39))[2] == pytest.approx(-0.4)


def test_rotation_is_sent_as_angles_about_the_base() -> None:
    driver = absolute(fastest_deg_s=1e6)
    driver.give(telegram(0))
    driver.client.begin(START)
    turned = Pose(START.position, product(from_angles(3.0, -2.0, 1.0), DOWN))
    assert driver.value(telegram(4), to=turned)[3:] == pytest.approx([3.0, -2.0, 1.0], abs=1e-5)
    further = Pose(START.position, product(from_angles(4.0, -2.0, 1.0), DOWN))
    assert driver.value(telegram(8), to=further)[3:] == pytest.approx([4.0, -2.0, 1.0], abs=1e-5)


def test_relative_rotations_add_up_to_the_total() -> None:
    driver = relative()
    driver.give(telegram(0))
    driver.client.begin(START)
    total = [0.0] * 3
    for step in range(1, 101):
        turned = Pose(START.position, product(from_angles(0.03 * step, -0.02 * step, 0.01 * step), DOWN))
        for axis, value in enumerate(driver.value(telegram(4 * step), to=turned)[3:]):
            total[axis] += value
    assert total == pytest.approx([3.0, -2.0, 1.0], abs=1e-4)


def test_only_the_newest_of_queued_telegrams_is_answered() -> None:
    driver = relative()
    driver.give(telegram(0))
    driver.client.begin(START)
    answers = driver.give(telegram(4), telegram(8), telegram(12), to=pose_at(-0.1))
    assert [answer.ipoc for answer in answers] == [12]
    assert answers[0].values["RKorr.Z"] == "-0.100000"
    assert [report.sequence for report in driver.reports] == [1, 2, 3, 4]


def test_repeated_or_late_telegram_moves_nothing_twice() -> None:
    driver = relative()
    driver.give(telegram(0))
    driver.client.begin(START)
    assert len(driver.give(telegram(4), telegram(4), to=pose_at(-0.1))) == 1
    assert driver.give(telegram(4), to=pose_at(-0.2)) == []
    assert len(driver.give(telegram(12), to=pose_at(-0.2))) == 1
    assert driver.give(telegram(8), to=pose_at(-0.3)) == []
    assert [report.sequence for report in driver.reports] == [1, 2, 2, 2, 4, 3]


# --- answers that were lost


def test_unaccepted_answer_is_compensated_by_the_next() -> None:
    driver = relative()
    driver.give(telegram(0))
    driver.client.begin(START)
    assert driver.value(telegram(4), to=pose_at(-0.1))[2] == pytest.approx(-0.1)
    # its own way, and 10 mm/s of the one that was lost
    assert driver.value(telegram(8, late=1), to=pose_at(-0.2))[2] == pytest.approx(-0.14)
    assert driver.value(telegram(12, late=1), to=pose_at(-0.2))[2] == pytest.approx(-0.04)
    assert driver.value(telegram(16, late=1), to=pose_at(-0.2))[2] == pytest.approx(-0.02)
    assert driver.value(telegram(20, late=1), to=pose_at(-0.2))[2] == 0.0


def test_lost_telegrams_leave_the_previous_answer_open() -> None:
    driver = relative()
    driver.give(telegram(0))
    driver.client.begin(START)
    driver.give(telegram(4), to=pose_at(-0.1))
    # two telegrams did not come, and counted as late: the answer to 4 was taken
    assert driver.value(telegram(16, late=2), to=pose_at(-0.2))[2] == pytest.approx(-0.1)
    # one did not come, and the answer to 16 was late, too
    assert driver.value(telegram(24, late=4), to=pose_at(-0.3))[2] == pytest.approx(-0.14)


def test_robot_accepting_no_answers_becomes_faulty() -> None:
    driver = relative(late_max=3)
    driver.give(telegram(0))
    driver.client.begin(START)
    for late in range(4):
        correction = driver.value(telegram(4 + 4 * late, late=late), to=pose_at(-0.1))
    assert correction == [0.0] * 6
    assert "not accepted 3 answers in a row (late so far: 3)" in driver.reports[-1].fault
    # it takes answers again, and what was lost is given up with this movement
    assert driver.value(telegram(20, late=3), to=pose_at(-0.1)) == [0.0] * 6
    assert driver.reports[-1].fault == ""
    driver.client.end()
    driver.client.begin(START)
    assert driver.value(telegram(24, late=3), to=pose_at(-0.1))[2] == pytest.approx(-0.1)


def test_without_a_late_count_each_answer_counts_as_accepted() -> None:
    driver = relative()
    driver.give(telegram(0, late=None))
    driver.client.begin(START)
    driver.give(telegram(4, late=None), to=pose_at(-0.1))
    assert driver.value(telegram(8, late=None), to=pose_at(-0.1)) == [0.0] * 6


# --- limits


def test_correction_grows_no_faster_than_its_limit() -> None:
    driver = relative(fastest_mm_s=25.0, catch_up_mm_s=1e3)
    driver.give(telegram(0))
    driver.client.begin(START)
    steps = [driver.value(telegram(4 * k), to=pose_at(-0.25))[2] for k in range(1, 5)]
    assert steps == pytest.approx([-0.1, -0.1, -0.05, 0.0])


def test_correction_is_limited_and_the_limit_is_reported_once() -> None:
    driver = relative(limit_mm=0.5)
    driver.give(telegram(0))
    driver.client.begin(START)
    total = sum(driver.value(telegram(4 * k), to=pose_at(-0.3 * k))[2] for k in range(1, 6))
    assert total == pytest.approx(-0.5)
    assert [notice.split(";")[0] for notice in driver.notices] == [
        "the correction stays within 0.5 mm and 20° of the robot's program"
    ]
    assert driver.value(telegram(24), to=pose_at(-0.4))[2] == pytest.approx(0.1)


# --- sessions and states


def test_restarted_program_ends_the_movement() -> None:
    elsewhere: dict[str, Any] = {"late": 0, "planned": pose_at(-3.0), "pose": pose_at(-3.0)}
    cases: dict[str, list[bytes]] = {
        "clock": [telegram(500_000 + 4 * k, **elsewhere) for k in range(5)],
        "clock backwards": [telegram(10 + 4 * k, **elsewhere) for k in range(5)],
        "late answers": [telegram(100_008, late=0)],
        "set position": [telegram(100_008, late=2, planned=pose_at(-3.0), pose=pose_at(-3.0))],
    }
    for *strays, raw in cases.values():
        driver = absolute()
        driver.give(telegram(100_000, late=2))
        driver.client.begin(START)
        driver.give(telegram(100_004, late=2), to=pose_at(-0.2))
        assert not any(driver.give(stray, to=pose_at(-0.3)) for stray in strays)
        (answer,) = driver.give(raw, to=pose_at(-0.3))
        assert driver.lost == [
            "its program restarted, or moves by itself: the previous correction is no longer valid"
        ]
        assert set(numbers(answer.values, TAGS) or ()) == {0.0}
        assert driver.reports[-1].sequence == 3


@pytest.mark.parametrize("clock", [10, 99_000, 100_100, 500_000])
def test_client_one_stray_clock_is_not_answered(clock: int) -> None:
    driver = absolute()
    driver.give(telegram(100_000))
    driver.client.begin(START)
    driver.value(telegram(100_004), to=pose_at(-0.2))
    assert driver.give(telegram(clock), to=pose_at(-0.3)) == []
    (answer,) = driver.give(telegram(100_012, pose=pose_at(-0.2)), to=pose_at(-0.3))
    assert (answer.ipoc, driver.lost) == (100_012, [])
    assert not any(report.fault for report in driver.reports)


@pytest.mark.parametrize("clock", [10, 99_500, 500_000])
def test_client_clock_jump_is_a_fault_once(clock: int) -> None:
    driver = absolute()
    driver.give(telegram(100_000))
    driver.client.begin(START)
    driver.value(telegram(100_004), to=pose_at(-0.2))
    for k in range(4):
        assert driver.give(telegram(clock + 4 * k, pose=pose_at(-0.2)), to=pose_at(-0.2)) == []
    driver.value(telegram(clock + 16, pose=pose_at(-0.2)), to=pose_at(-0.2))
    assert driver.reports[-1].fault == "its clock jumped"
    (answer,) = driver.give(telegram(clock + 20, pose=pose_at(-0.2)), to=pose_at(0.0))
    assert (answer.ipoc, driver.reports[-1].fault, driver.lost) == (clock + 20, "", [])
    assert numbers(answer.values, TAGS) == pytest.approx([0.0] * 6, abs=0.2)


def test_silent_robot_resumes_with_its_reported_correction() -> None:
    driver = absolute()
    driver.give(telegram(0))
    driver.client.begin(START)
    driver.give(telegram(4), to=pose_at(-0.5))
    (answer,) = driver.give(telegram(404, pose=pose_at(-0.5)), to=pose_at(-0.6), after=1.5)
    assert driver.lost == ["it sent nothing for 1 s: the previous correction is no longer valid"]
    assert numbers(answer.values, TAGS) == pytest.approx([0.0, 0.0, -0.5, 0.0, 0.0, 0.0], abs=1e-9)


def test_stopped_program_is_a_fault() -> None:
    driver = relative()
    driver.give(telegram(0, ProgStatus_R="3"))
    assert driver.reports[-1].fault == ""
    driver.give(telegram(4, ProgStatus_R="4"))
    assert driver.reports[-1].fault.startswith("its program does not run (ProgStatus 4)")


def test_robot_not_following_is_reported_once_per_movement() -> None:
    driver = absolute()
    driver.give(telegram(0))
    driver.client.begin(START)
    for number in range(1, 400):
        driver.give(telegram(4 * number), to=pose_at(-0.02 * number))  # it does not move
    (notice,) = driver.notices
    assert notice.startswith("the robot is 1.0 mm away from its correction")
    # the next movement continues from where it is
    driver.client.end()
    driver.client.begin(START)
    assert driver.value(telegram(1600), to=pose_at(-0.1))[2] == pytest.approx(-0.1)


def test_lagging_robot_follows() -> None:
    driver = relative()
    driver.give(telegram(0))
    driver.client.begin(START)
    for number in range(1, 400):
        driver.give(
            telegram(4 * number, pose=pose_at(min(0.0, 0.4 * (40 - number)))), to=pose_at(-0.4 * number)
        )
    assert driver.notices == []


def test_invalid_position_is_reported_and_answered() -> None:
    driver = relative()
    driver.give(telegram(0))
    raw = telegram(4).replace(b'<RIst X="600.0000"', b'<RIst X="NaN"')
    assert len(driver.give(raw)) == 1
    assert math.isnan(driver.reports[-1].pose.position[0])


def test_consecutive_invalid_telegrams_are_reported_once() -> None:
    driver = relative()
    empty = b'<Rob Type="KUKA"><IPOC>4</IPOC></Rob>'
    other = b'<Sen Type="ImFree"><IPOC>4</IPOC></Sen>'
    late = telegram(4).replace(b'D="0"', b'D="x"')
    assert driver.give(empty, other, late, telegram(0)[:-4]) == []
    assert driver.give(telegram(8)) != []
    assert driver.give(other) == []
    assert [notice.partition(": ")[2] for notice in driver.notices] == [
        "it has no RIst; add DEF_RIst to the controller's Ethernet configuration",
        "it is a Sen telegram, not one from a robot",
    ]
    assert len(driver.reports) == 1


@given(
    st.sampled_from(["relative", "absolute"]),
    st.lists(
        st.tuples(
            st.sampled_from([0, 4, 4, 4, 8, -4, 12, 2000]),
            st.integers(0, 3),
            st.floats(-2.0, 2.0),
            st.booleans(),
        ),
        max_size=40,
    ),
)
def test_no_course_of_telegrams_makes_a_step_beyond_the_limits(
    mode: str, course: Sequence[tuple[int, int, float, bool]]
) -> None:
    """Clocks that jump, late counts that grow, any targets: each answer contains one bounded step."""
    driver = Driver(RsiLink(mode=mode, limit_mm=1.0))  # type: ignore[arg-type]
    driver.give(telegram(10_000))
    driver.client.begin(START)
    clock, late, answered = 10_000, 0, {10_000}
    robot = 0.0
    for passed, more, target, moving in course:
        clock, late = max(0, clock + passed), late + more
        if driver.lost:
            break
        answers = driver.give(telegram(clock, late=late), to=pose_at(target) if moving else None)
        if driver.lost:
            break
        assert len(answers) <= 1
        for answer in answers:
            assert answer.ipoc == clock
            assert clock not in answered
            answered.add(clock)
            value = (numbers(answer.values, TAGS) or [])[2]
            step = value if mode == "relative" else value - robot
            assert abs(step) <= (0.8 if mode == "relative" else 2.0) + 1e-6
            robot = value


@given(st.lists(st.binary(max_size=120), max_size=4), st.integers(0, 400), st.integers(0, 255))
def test_no_bytes_raise(data: list[bytes], at: int, byte: int) -> None:
    driver = relative()
    driver.give(telegram(0))
    driver.client.begin(START)
    spoiled = bytearray(telegram(4))
    spoiled[at % len(spoiled)] = byte
    for answer in driver.give(*data, bytes(spoiled), to=pose_at(-0.1)):
        assert (numbers(answer.values, TAGS) or [])[2] == pytest.approx(-0.1)
