"""Whether a robot goes where it was ordered to lately."""

import pytest

from hil_bridge.control.course.following import PARTS, Following, Trail
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.verdict import Observation
from tests.observed import observation

FOLLOWING = Following(0.08)
LIMITS = Limits(path_error_mm=0.3)
SPEED = 0.01
"""Of the orders, m/s."""


def ordered(until: float, cycle: float = 0.01) -> Trail:
    """The trail of orders that go deeper at this speed from time 0 on."""
    trail: Trail = ()
    for k in range(round(until / cycle) + 1):
        trail = FOLLOWING.after(trail, (0.0, k * cycle * SPEED), k * cycle, None)
    return trail


def at(depth: float) -> Observation:
    """A reported depth, m."""
    return observation(0.0, 1.0, depth=depth, position=(0.0, 0.0, depth))


@pytest.mark.parametrize("behind_s", [0.0, 0.04, 0.08])
def test_a_robot_that_takes_its_time_follows(behind_s: float) -> None:
    assert FOLLOWING.fault(ordered(1.0), at((1.0 - behind_s) * SPEED), LIMITS) == ""


def test_a_robot_that_falls_behind_does_not_follow() -> None:
    assert "mm behind all" in FOLLOWING.fault(ordered(1.0), at(0.86 * SPEED), LIMITS)


def test_a_robot_that_runs_ahead_does_not_follow() -> None:
    assert "0.31 mm ahead of all" in FOLLOWING.fault(ordered(1.0), at(SPEED + 0.31e-3), LIMITS)


def test_the_resolution_of_the_position_is_no_error() -> None:
    coarse = Following(0.08, step_m=0.125e-3)
    assert coarse.fault(ordered(1.0), at(SPEED + 0.4e-3), LIMITS) == ""


def test_an_order_that_lasts_stays_in_the_trail() -> None:
    trail = FOLLOWING.after(ordered(0.1), (0.001, 0.002), 9.0, None)
    assert FOLLOWING.fault(trail, at(0.1 * SPEED), LIMITS) == ""


@pytest.mark.parametrize("cycle", [0.002, 0.01, 0.18])
def test_the_trail_stays_short(cycle: float) -> None:
    assert len(ordered(2.0, cycle)) <= PARTS + 2


def test_a_trail_begins_where_the_robot_comes_from() -> None:
    trail = FOLLOWING.after((), (-0.4e-3, 0.1e-3), 0.0, None)
    assert FOLLOWING.fault(trail, at(-0.4e-3), LIMITS) == ""
