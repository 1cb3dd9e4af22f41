"""Check that a robot follows its recent orders."""

import pytest

from hil_bridge.control.course.following import PARTS, Following, Trail
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.verdict import Observation
from tests.observed import observation

FOLLOWING = Following(0.08)
LIMITS = Limits(path_error_mm=0.3)
SPEED = 0.01
"""Speed of the orders, m/s."""


def ordered(until: float, cycle: float = 0.01) -> Trail:
    """Trail of orders that go deeper at this speed from time 0 on."""
    trail: Trail = ()
    for k in range(round(until / cycle) + 1):
        trail = FOLLOWING.after(trail, (0.0, k * cycle * SPEED), k * cycle, None)
    return trail


def at(depth: float) -> Observation:
    """Observation with a reported depth, m."""
    return observation(0.0, 1.0, depth=depth, position=(0.0, 0.0, depth))


@pytest.mark.parametrize("behind_s", [0.0, 0.04, 0.08])
def test_following_slow_robot_passes(behind_s: float) -> None:
    assert FOLLOWING.fault(ordered(1.0), at((1.0 - behind_s) * SPEED), LIMITS) == ""


def test_following_lagging_robot_fails() -> None:
    assert "mm behind all" in FOLLOWING.fault(ordered(1.0), at(0.86 * SPEED), LIMITS)


def test_following_leading_robot_fails() -> None:
    assert "0.31 mm ahead of all" in FOLLOWING.fault(ordered(1.0), at(SPEED + 0.31e-3), LIMITS)


def test_following_position_resolution_is_tolerated() -> None:
    coarse = Following(0.08, step_m=0.125e-3)
    assert coarse.fault(ordered(1.0), at(SPEED + 0.4e-3), LIMITS) == ""


def test_following_constant_order_stays_in_trail() -> None:
    trail = FOLLOWING.after(ordered(0.1), (0.001, 0.002), 9.0, None)
    assert FOLLOWING.fault(trail, at(0.1 * SPEED), LIMITS) == ""


@pytest.mark.parametrize("cycle", [0.002, 0.01, 0.18])
def test_following_trail_length_is_bounded(cycle: float) -> None:
    assert len(ordered(2.0, cycle)) <= PARTS + 2


def test_following_trail_starts_at_previous_position() -> None:
    trail = FOLLOWING.after((), (-0.4e-3, 0.1e-3), 0.0, None)
    assert FOLLOWING.fault(trail, at(-0.4e-3), LIMITS) == ""
