"""How a program turns the tool, against scipy's rotations; and the guard over it."""

import math

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.orientation import behind, limit_turn, tilt
from hil_bridge.control.geometry.turning import brought, moment_at, tip_tool, yaw_tool
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
def test_a_vector_is_rotated_as_scipy_does(quaternion, vector):
    assert rotate(quaternion, vector) == pytest.approx(scipy_of(quaternion).apply(vector), abs=1e-12)


@given(QUATERNIONS, QUATERNIONS)
def test_the_angle_between_orientations_is_that_of_scipy(a, b):
    expected = (scipy_of(a).inv() * scipy_of(b)).magnitude()
    assert angle_between(a, b) == pytest.approx(expected, abs=1e-7)
    assert angle_between(a, tuple(-part for part in b)) == pytest.approx(angle_between(a, b), abs=1e-9)


@given(QUATERNIONS, st.floats(1e-9, 1e-3))
def test_small_angles_are_exact(home, angle):
    assert angle_between(home, about((1.0, 0.0, 0.0), angle, home)) == pytest.approx(
        angle, rel=1e-5, abs=1e-15
    )


@given(QUATERNIONS, UNIT_VECTORS)
@example(normalise((0.0, 0.0, 1.0, 1e-5)), (0.0, 0.0, 1.0))  # nearly opposite
@example(normalise((0.0, 0.0, 1.0, 1e-8)), (0.0, 0.0, 1.0))
def test_a_tipped_tool_has_the_wanted_axis_by_the_smallest_turn(home, axis):
    found = tip_tool(home, axis)
    assert math.hypot(*found) == pytest.approx(1.0)
    assert rotate(found, (0.0, 0.0, 1.0)) == pytest.approx(axis, abs=1e-7)
    before = np.array(rotate(home, (0.0, 0.0, 1.0)))
    angle = math.atan2(float(np.linalg.norm(np.cross(before, axis))), float(before @ axis))
    assert angle_between(home, found) == pytest.approx(angle, abs=1e-6)


@pytest.mark.parametrize("home", [DOWN, (1.0, 0.0, 0.0, 0.0), normalise((1.0, 0.0, 1.0, 0.0))])
def test_a_tool_tips_over_to_the_opposite_axis_too(home):
    axis = tuple(-part for part in rotate(home, (0.0, 0.0, 1.0)))
    assert rotate(tip_tool(home, axis), (0.0, 0.0, 1.0)) == pytest.approx(axis, abs=1e-9)


@given(st.floats(-math.pi, math.pi), st.floats(-math.pi, math.pi), QUATERNIONS)
def test_a_yawed_tool_looks_along_the_path_as_at_its_begin(before, after, home):
    """Work frame: x = base x, y = base y, so its z axis is base z and the approach is −z."""
    headings = [(math.cos(angle), math.sin(angle)) for angle in (before, after)]
    found = yaw_tool(home, (0.0, 0.0, -1.0), *headings)
    expected = Rotation.from_rotvec((0.0, 0.0, after - before)) * scipy_of(home)
    assert rotate(found, (1.0, 2.0, 3.0)) == pytest.approx(expected.apply((1.0, 2.0, 3.0)), abs=1e-9)


@given(QUATERNIONS, QUATERNIONS, ANGLES)
def test_an_orientation_is_brought_nearer_by_the_shortest_way_and_no_faster(before, wanted, angle):
    whole = angle_between(before, wanted)
    assume(whole < math.pi - 1e-3)  # half a turn has two shortest ways
    found = brought(before, wanted, angle)
    assert angle_between(before, found) <= angle * (1 + 1e-6) + 1e-9
    if whole > math.radians(0.02):
        assert angle_between(found, wanted) == pytest.approx(max(whole - angle, 0.0), abs=1e-6)
    else:
        assert found == before, "an orientation as near as this is not ordered again"


@given(st.tuples(*[st.floats(-50.0, 50.0)] * 6), VECTORS)
def test_a_moment_about_another_point_is_that_of_numpy(wrench, point):
    expected = np.array(wrench[3:]) - np.cross(point, wrench[:3])
    assert moment_at(wrench, point) == pytest.approx(expected, abs=1e-9)


@given(QUATERNIONS, st.floats(0.9, 1.1))
def test_rounded_words_become_an_orientation_again(quaternion, scale):
    assert normalise([part * scale for part in quaternion]) == pytest.approx(quaternion)


# --- the guard

LIMITS = Limits(turn_deg_s=10.0, turn_total_deg=30.0)


@given(QUATERNIONS, QUATERNIONS, QUATERNIONS, st.floats(1e-3, 0.5))
def test_whatever_is_wanted_the_guard_lets_neither_turn_too_fast_nor_tip_too_far(home, before, wanted, dt):
    given_, reasons = limit_turn(LIMITS, home, before, wanted, dt)
    assert angle_between(before, given_) <= math.radians(10.0) * dt + 1e-6
    assert tilt(home, given_) <= max(math.radians(30.0), tilt(home, before)) + 1e-6
    assert bool(reasons) == (given_ != wanted)


def test_a_turn_within_the_limits_is_allowed():
    wanted = about((1.0, 0.0, 0.0), math.radians(0.9))
    assert limit_turn(LIMITS, DOWN, DOWN, wanted, 0.1) == (wanted, ())


def test_a_turn_that_is_too_fast_goes_as_far_as_it_may():
    wanted = about((1.0, 0.0, 0.0), math.radians(5.0))
    given_, reasons = limit_turn(LIMITS, DOWN, DOWN, wanted, 0.1)
    assert reasons == (Reason(Cause.TURN, "turned faster than 10°/s"),)
    assert angle_between(DOWN, given_) == pytest.approx(math.radians(1.0))
    assert angle_between(given_, wanted) == pytest.approx(math.radians(4.0))


def test_a_tool_that_would_tip_too_far_stays_as_it_is():
    before, wanted = (about((0.0, 1.0, 0.0), math.radians(deg)) for deg in (29.8, 30.2))
    assert limit_turn(LIMITS, DOWN, before, wanted, 0.1) == (
        before,
        (Reason(Cause.TIP, "tilted by more than 30°"),),
    )


def test_a_tool_that_is_tipped_too_far_may_come_back():
    before, wanted = (about((0.0, 1.0, 0.0), math.radians(deg)) for deg in (40.0, 39.5))
    assert limit_turn(LIMITS, DOWN, before, wanted, 0.1) == (wanted, ())


def test_a_turn_about_the_tools_own_axis_is_no_tilt():
    wanted = about((0.0, 0.0, 1.0), math.radians(170.0))
    assert tilt(DOWN, wanted) == pytest.approx(0.0, abs=1e-12)
    assert limit_turn(Limits(turn_deg_s=1e4), DOWN, DOWN, wanted, 1.0) == (wanted, ())


@given(QUATERNIONS, QUATERNIONS)
def test_the_tilt_is_the_angle_between_the_axes(a, b):
    before, after = (scipy_of(one).apply((0.0, 0.0, 1.0)) for one in (a, b))
    assert math.cos(tilt(a, b)) == pytest.approx(float(before @ after), abs=1e-9)


def test_the_lag_of_a_steady_turn_comes_to_half_a_second_of_it_and_fades():
    lag, dt, rate = 0.0, 0.012, math.radians(10.0)
    for _ in range(1000):
        lag = behind(lag, rate * dt, dt)
    assert lag == pytest.approx(rate * 0.5, rel=0.02)
    faded = lag
    for _ in range(round(2.0 / dt)):
        faded = behind(faded, 0.0, dt)
    assert faded == pytest.approx(lag * math.exp(-4.0), rel=0.05)


@given(st.lists(st.tuples(st.floats(0.0, 0.1), st.floats(1e-3, 0.2)), max_size=50))
def test_the_lag_is_never_more_than_all_that_was_turned(turns):
    lag = 0.0
    for turned, dt in turns:
        lag = behind(lag, turned, dt)
        assert lag >= turned
    assert lag <= sum(turned for turned, _ in turns) + 1e-12
