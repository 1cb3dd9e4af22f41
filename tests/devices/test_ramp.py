"""Speed profile of a stream's set point: it starts and ends without a velocity step, and stops immediately."""

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bridge.devices.robots.ramp import Pace, Ramp
from protocol.geometry import Pose, Vector

CYCLE = 0.004
PACE = Pace(
    speed=0.05, turn_speed=math.radians(20.0), acceleration=2.0, turn_acceleration=math.radians(800.0)
)
START = Pose((0.9, -0.1, 0.6), (0.0, 1.0, 0.0, 0.0))
SLACK = 1e-9


def displaced(mm: float, degrees: float = 0.0) -> Pose:
    (x, y, z), half = START.position, math.radians(degrees) / 2.0
    return Pose((x, y, z + mm * 1e-3), (0.0, math.cos(half), math.sin(half), 0.0))


def angle(one: Pose, other: Pose) -> float:
    chord = min(
        math.dist(one.quaternion, other.quaternion), math.dist(one.quaternion, [-q for q in other.quaternion])
    )
    return 4.0 * math.asin(min(1.0, chord / 2.0))


def course(goal: Pose, start: Pose = START, pace: Pace = PACE) -> list[Pose]:
    """Return the set points on the path to a goal, including both ends."""
    ramp, points = Ramp(CYCLE), [start]
    while points[-1] != goal:
        points.append(ramp.step(points[-1], goal, pace, CYCLE))
        assert len(points) < 100_000, "the ramp never reaches its goal"
    return points


def speeds(points: list[Pose]) -> list[float]:
    """Return the speeds of a path that begins and ends at standstill, m/s."""
    return [0.0, *(math.dist(a.position, b.position) / CYCLE for a, b in itertools.pairwise(points)), 0.0]


@pytest.mark.full
@given(st.floats(1e-4, 100.0), st.floats(0.001, 0.5), st.floats(0.1, 50.0))
def test_ramp_has_no_velocity_step_at_start_and_end(
    distance_mm: float, speed: float, acceleration: float
) -> None:
    pace = Pace(speed, 1.0, acceleration, 1.0)
    points = course(displaced(-distance_mm), pace=pace)
    rates = speeds(points)
    assert max(rates) <= speed + SLACK
    for before, after in itertools.pairwise(rates):
        assert abs(after - before) <= acceleration * CYCLE + 1e-6
    heights = [point.position[2] for point in points]
    assert heights == sorted(heights, reverse=True)  # in a straight line, without overshoot
    shortest = distance_mm * 1e-3 / speed + speed / acceleration
    assert (len(points) - 1) * CYCLE <= shortest + 4 * CYCLE


def test_ramp_of_rotation_is_smooth_and_ends_with_path() -> None:
    points = course(displaced(-1.0, 10.0))
    turns = [0.0, *(angle(a, b) / CYCLE for a, b in itertools.pairwise(points)), 0.0]
    assert max(turns) == pytest.approx(PACE.turn_speed, rel=1e-6)
    for before, after in itertools.pairwise(turns):
        assert abs(after - before) <= PACE.turn_acceleration * CYCLE * 1.001
    middle = points[len(points) // 2]
    assert (0.6 - middle.position[2]) / 1e-3 == pytest.approx(
        angle(START, middle) / math.radians(10.0), abs=1e-6
    )
    alone = course(displaced(0.0, 10.0))
    assert len(alone) == len(points)


def test_ramp_follows_reversed_goal_at_once() -> None:
    ramp, point = Ramp(CYCLE), START
    for _ in range(20):
        point = ramp.step(point, displaced(-50.0), PACE, CYCLE)
    deepest = point
    first = ramp.step(point, START, PACE, CYCLE)
    assert first.position[2] > deepest.position[2]
    assert first.position[2] - deepest.position[2] == pytest.approx(PACE.acceleration * CYCLE**2)


def test_ramp_follows_moving_goal_at_its_speed() -> None:
    """The goal moves at 10 mm/s and is updated in every cycle; the set point follows at the same speed."""
    ramp, point, speeds = Ramp(CYCLE), START, []
    for number in range(1, 101):
        after = ramp.step(point, displaced(-0.04 * number), PACE, CYCLE)
        speeds.append(math.dist(point.position, after.position) / CYCLE)
        point = after
    assert speeds[-20:] == [pytest.approx(0.01, abs=1e-5)] * 20
    assert max(speeds) < 0.015
    assert math.dist(point.position, displaced(-4.0).position) < 0.05e-3


def test_ramp_reaches_goal_with_early_packets() -> None:
    ramp, point = Ramp(CYCLE), START
    for number in range(20):
        point = ramp.step(point, displaced(-0.2), PACE, CYCLE * (0.99 if number % 2 else 0.97))
    assert point == displaced(-0.2)


def test_ramp_restarts_after_stop_and_after_gap() -> None:
    for interrupt in ("rest", "gap"):
        ramp, point = Ramp(CYCLE), START
        for _ in range(20):
            point = ramp.step(point, displaced(-50.0), PACE, CYCLE)
        if interrupt == "rest":
            ramp.rest()
        after = ramp.step(point, displaced(-50.0), PACE, CYCLE if interrupt == "rest" else 0.02)
        assert math.dist(point.position, after.position) == pytest.approx(PACE.acceleration * CYCLE**2)


@given(
    st.lists(
        st.tuples(
            st.sampled_from([0.0, 0.0005, CYCLE, 2 * CYCLE, 0.05]), st.floats(-5.0, 5.0), st.floats(-5, 5)
        ),
        min_size=1,
        max_size=60,
    )
)
def test_ramp_limits_acceleration_and_never_overshoots(
    steps: list[tuple[float, float, float]],
) -> None:
    ramp, point, before = Ramp(CYCLE), START, 0.0
    for elapsed, mm, degrees in steps:
        goal = displaced(mm, degrees)
        after = ramp.step(point, goal, PACE, elapsed)
        distance = math.dist(point.position, after.position)
        speed = distance / min(elapsed, CYCLE) if elapsed else 0.0
        assert speed <= min(PACE.speed, before + PACE.acceleration * CYCLE) + 1e-6
        assert distance <= math.dist(point.position, goal.position) + SLACK
        if elapsed:
            before = speed
        point = after


@pytest.mark.parametrize(
    ("begin", "end"),
    [
        (
            (2.1863579654e-06, 2.1975398654e-06, 1.8227558319e-06),
            (2.1863579749e-06, 2.1975398666e-06, 1.8227558300e-06),
        ),
        (
            (2.1863575628e-06, 2.1975395130e-06, 1.8227557973e-06),
            (2.1863573745e-06, 2.1975397819e-06, 1.8227556722e-06),
        ),
    ],
)
def test_ramp_tiny_rotation_does_not_delay_path(begin: Vector, end: Vector) -> None:
    start, goal = (
        Pose(point.position, (w, -0.9999999999935341, -y, -z))
        for point, (w, y, z) in ((START, begin), (displaced(0.1), end))
    )
    assert len(course(goal, start)) < 50
