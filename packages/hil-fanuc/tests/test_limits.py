"""Set points that keep speed, acceleration and jerk."""

import pytest
from hil_fanuc.limits import AxisLimits, JointLimiter, LimitTable, find_breach, interpolate
from hil_fanuc.packets import Limit, Threshold
from hypothesis import given
from hypothesis import strategies as st

LIMITS = (AxisLimits(120.0, 265.0, 1240.0),)
"""Joint 1 of a CRX-10iA/L."""
CYCLE = 0.008


def followed(goals: list[float], exact: bool = False) -> list[float]:
    """Return the set points for these goals. Fail if one of them exceeds the limits."""
    limiter, positions = JointLimiter((0.0,), CYCLE), []
    for goal in goals:
        before = limiter.states
        limiter.step((goal,), LIMITS, exact)
        assert find_breach(before, limiter.states, LIMITS, CYCLE) is None
        positions.append(limiter.joints[0])
    return positions


@pytest.mark.parametrize("goal", [0.001, 1.0, 30.0])
def test_step_is_reached_without_overshoot(goal: float) -> None:
    positions = followed([goal] * 200)
    assert positions[-1] == goal
    assert max(positions) == goal


def test_motion_that_ends_abruptly_has_no_overshoot() -> None:
    goals = [min(1.15 * CYCLE * k, 1.0) for k in range(300)]
    positions = followed(goals)
    assert max(positions) == 1.0
    delay = max(goal - at for goal, at in zip(goals, positions, strict=True)) / 1.15
    assert delay == pytest.approx((1.15 / 1240.0) ** 0.5, rel=0.15)  # of the shortest stop at this speed


def test_exact_goals_within_the_limits_are_followed() -> None:
    goals = [0.0005 * k * k * CYCLE for k in range(1, 100)]
    assert followed(goals, exact=True) == goals


@given(st.lists(st.floats(-20.0, 20.0), min_size=1, max_size=80))
def test_any_goals_keep_the_limits(goals: list[float]) -> None:
    positions = followed(goals)
    assert max(map(abs, positions)) <= max(map(abs, goals)) + 1e-9


@pytest.mark.parametrize(
    ("goal", "limit"), [(2.0, Limit.SPEED), (0.02, Limit.ACCELERATION), (0.001, Limit.JERK)]
)
def test_breach_names_the_first_limit(goal: float, limit: Limit) -> None:
    breach = JointLimiter((0.0,), CYCLE).breach((goal,), LIMITS)
    assert breach is not None
    assert (breach.axis, breach.limit) == (1, limit)


def test_thresholds_are_interpolated_by_speed_and_load() -> None:
    light, heavy = tuple(float(k) for k in range(1, 21)), tuple(0.5 * k for k in range(1, 21))
    table = Threshold(3, 1, 0, 2000, 8, light, heavy)
    assert interpolate(table, 2.0, 0.0) == 20.0  # 100 % of 2000 mm/s
    assert interpolate(table, 0.1, 0.0) == 1.0  # 5 %
    assert interpolate(table, 0.0, 0.0) == 1.0
    assert interpolate(table, 0.15, 0.0) == pytest.approx(1.5)
    assert interpolate(table, 9.0, 0.5) == pytest.approx(15.0)
    limits = LimitTable({(axis, kind): table for axis in range(1, 7) for kind in Limit})
    assert limits.at(2.0, 1.0) == (AxisLimits(10.0, 10.0, 10.0),) * 6
