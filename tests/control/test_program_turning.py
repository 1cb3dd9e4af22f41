"""Rotation of the tool by a program, compared with scipy's rotations; and its supervision by the guard."""

import math

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.orientation import behind, limit_turn, tilt
from hil_bridge.control.geometry.turning import moment_at, rotate_towards, tip_tool, yaw_tool
from hil_bridge.errors import Cause, Reason
from protocol.geometry import angle_between, normalise, rotate

COMPONENT = st.floats(-1.0, 1.0)
VECTORS = st.tuples(COMPONENT, COMPONENT, COMPONENT)
UNIT_VECTORS = VECTORS.filter(lambda v: math.hypot(*v) > 0.1).map(
    lambda v: tuple(part / math.hypot(*v) for part in v)
)
QUATERNIONS = (
    st.tuples(COMPONENT, COMPONENT, COMPONENT, COMPONENT)
    .filter(lambda q: math.hypot(*q) > 0.1)
    .map(normalise)
)
ANGLES = st.floats(1e-6, math.pi)
DOWN = 0.0, 1.0, 0.0, 0.0
"""The tool points down: half a turn about x."""


def scipy_of(quaternion):
    w, x, y, z = quaternion
    return Rotation.from_quat((x, y, z, w))


def about(axis, angle, home=DOWN):
    """`home` turned about an axis of the base frame."""
    x, y, z, w = (Rotation.from_rotvec(np.array(axis) * angle) * scipy_of(home)).as_quat()
    return w, x, y, z


# --- turning


@given(QUATERNIONS, VECTORS)
def test_rotate_matches_scipy(quaternion, vector):
    assert rotate(quaternion, vector) == pytest.approx(scipy_of(quaternion).apply(vector), abs=1e-12)


@given(QUATERNIONS, QUATERNIONS)
def test_angle_between_matches_scipy(a, b):
    expected = (scipy_of(a).inv() * scipy_of(b)).magnitude()
    assert angle_between(a, b) == pytest.approx(expected, abs=1e-7)
    assert angle_between(a, tuple(-part for part in b)) == pytest.approx(angle_between(a, b), abs=1e-9)


@given(QUATERNIONS, st.floats(1e-9, 1e-3))
def test_angle_between_is_exact_for_small_angles(home, angle):
    assert angle_between(home, about((1.0, 0.0, 0.0), angle, home)) == pytest.approx(
        angle, rel=1e-5, abs=1e-15
    )


@given(QUATERNIONS, UNIT_VECTORS)
@example(normalise((0.0, 0.0, 1.0, 1e-5)), (0.0, 0.0, 1.0))  # nearly opposite
@example(normalise((0.0, 0.0, 1.0, 1e-8)), (0.0, 0.0, 1.0))
def test_tip_tool_uses_smallest_rotation(home, axis):
    result = tip_tool(home, axis)
    assert math.hypot(*result) == pytest.approx(1.0)
    assert rotate(result, (0.0, 0.0, 1.0)) == pytest.approx(axis, abs=1e-7)
    before = np.array(rotate(home, (0.0, 0.0, 1.0)))
    angle = math.atan2(float(np.linalg.norm(np.cross(before, axis))), float(before @ axis))
    assert angle_between(home, result) == pytest.approx(angle, abs=1e-6)


@pytest.mark.parametrize("home", [DOWN, (1.0, 0.0, 0.0, 0.0), normalise((1.0, 0.0, 1.0, 0.0))])
def test_tip_tool_to_opposite_axis_works(home):
    axis = tuple(-part for part in rotate(home, (0.0, 0.0, 1.0)))
    assert rotate(tip_tool(home, axis), (0.0, 0.0, 1.0)) == pytest.approx(axis, abs=1e-9)


@given(st.floats(-math.pi, math.pi), st.floats(-math.pi, math.pi), QUATERNIONS)
def test_yaw_tool_keeps_angle_to_path(before, after, home):
    """Work frame: x = base x, y = base y, so its z axis is base z and the approach is −z."""
    headings = [(math.cos(angle), math.sin(angle)) for angle in (before, after)]
    result = yaw_tool(home, (0.0, 0.0, -1.0), *headings)
    expected = Rotation.from_rotvec((0.0, 0.0, after - before)) * scipy_of(home)
    assert rotate(result, (1.0, 2.0, 3.0)) == pytest.approx(expected.apply((1.0, 2.0, 3.0)), abs=1e-9)


@given(QUATERNIONS, QUATERNIONS, ANGLES)
def test_rotate_towards_takes_shortest_limited_step(before, desired, angle):
    total = angle_between(before, desired)
    assume(total < math.pi - 1e-3)  # half a turn has two shortest ways
    result = rotate_towards(before, desired, angle)
    assert angle_between(before, result) <= angle * (1 + 1e-6) + 1e-9
    if total > math.radians(0.02):
        assert angle_between(result, desired) == pytest.approx(max(total - angle, 0.0), abs=1e-6)
    else:
        assert result == before, "an orientation this close is not ordered again"


@given(st.tuples(*[st.floats(-50.0, 50.0)] * 6), VECTORS)
def test_moment_at_matches_numpy(wrench, point):
    expected = np.array(wrench[3:]) - np.cross(point, wrench[:3])
    assert moment_at(wrench, point) == pytest.approx(expected, abs=1e-9)


@given(QUATERNIONS, st.floats(0.9, 1.1))
def test_rounded_quaternion_is_normalised(quaternion, scale):
    assert normalise([part * scale for part in quaternion]) == pytest.approx(quaternion)


# --- the guard

LIMITS = Limits(turn_deg_s=10.0, turn_total_deg=30.0)


@given(QUATERNIONS, QUATERNIONS, QUATERNIONS, st.floats(1e-3, 0.5))
def test_limit_turn_bounds_rate_and_tilt(home, before, desired, dt):
    allowed, reasons = limit_turn(LIMITS, home, before, desired, dt)
    assert angle_between(before, allowed) <= math.radians(10.0) * dt + 1e-6
    assert tilt(home, allowed) <= max(math.radians(30.0), tilt(home, before)) + 1e-6
    assert bool(reasons) == (allowed != desired)


def test_limit_turn_within_limits_is_unchanged():
    target = about((1.0, 0.0, 0.0), math.radians(0.9))
    assert limit_turn(LIMITS, DOWN, DOWN, target, 0.1) == (target, ())


def test_limit_turn_too_fast_is_shortened():
    target = about((1.0, 0.0, 0.0), math.radians(5.0))
    allowed, reasons = limit_turn(LIMITS, DOWN, DOWN, target, 0.1)
    assert reasons == (Reason(Cause.TURN, "turned faster than 10°/s"),)
    assert angle_between(DOWN, allowed) == pytest.approx(math.radians(1.0))
    assert angle_between(allowed, target) == pytest.approx(math.radians(4.0))


def test_limit_turn_beyond_tilt_keeps_orientation():
    before, target = (about((0.0, 1.0, 0.0), math.radians(deg)) for deg in (29.8, 30.2))
    assert limit_turn(LIMITS, DOWN, before, target, 0.1) == (
        before,
        (Reason(Cause.TIP, "tilted by more than 30°"),),
    )


def test_limit_turn_tilted_tool_may_return():
    before, target = (about((0.0, 1.0, 0.0), math.radians(deg)) for deg in (40.0, 39.5))
    assert limit_turn(LIMITS, DOWN, before, target, 0.1) == (target, ())


def test_tilt_ignores_rotation_about_tool_axis():
    expected = about((0.0, 0.0, 1.0), math.radians(170.0))
    assert tilt(DOWN, expected) == pytest.approx(0.0, abs=1e-12)
    assert limit_turn(Limits(turn_deg_s=1e4), DOWN, DOWN, expected, 1.0) == (expected, ())


@given(QUATERNIONS, QUATERNIONS)
def test_tilt_is_angle_between_axes(a, b):
    before, after = (scipy_of(one).apply((0.0, 0.0, 1.0)) for one in (a, b))
    assert math.cos(tilt(a, b)) == pytest.approx(float(before @ after), abs=1e-9)


def test_turn_lag_is_half_a_second_and_fades():
    lag, dt, rate = 0.0, 0.012, math.radians(10.0)
    for _ in range(1000):
        lag = behind(lag, rate * dt, dt)
    assert lag == pytest.approx(rate * 0.5, rel=0.02)
    faded = lag
    for _ in range(round(2.0 / dt)):
        faded = behind(faded, 0.0, dt)
    assert faded == pytest.approx(lag * math.exp(-4.0), rel=0.05)


@given(st.lists(st.tuples(st.floats(0.0, 0.1), st.floats(1e-3, 0.2)), max_size=50))
def test_turn_lag_is_bounded_by_total_rotation(turns):
    lag = 0.0
    for turned, dt in turns:
        lag = behind(lag, turned, dt)
        assert lag >= turned
    assert lag <= sum(turned for turned, _ in turns) + 1e-12
