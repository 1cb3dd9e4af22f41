"""Rotations, wrenches, twists and the weight of the tool."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from hil_bridge.control import (
    force_along,
    quaternion_of,
    rotate,
    rotation_matrix,
    tool_gravity_wrench,
    transform_wrench,
)

NUMBER = st.floats(-10, 10)
VECTOR = st.tuples(NUMBER, NUMBER, NUMBER)
SIX = st.tuples(*[NUMBER] * 6)
QUATERNION = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: math.hypot(*q) > 0.1)
HALF = math.sqrt(0.5)
DOWN = (0.0, 1.0, 0.0, 0.0)
"""Tool z points down: half a turn about x."""


def test_quarter_turn_about_z_takes_x_to_y():
    assert rotate((HALF, 0, 0, HALF), (1, 0, 0)) == pytest.approx([0, 1, 0])


@given(QUATERNION)
def test_rotation_is_orthogonal_and_right_handed(quaternion):
    matrix = rotation_matrix(quaternion)
    assert matrix @ matrix.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(matrix) == pytest.approx(1.0)
    assert rotation_matrix([-3 * q for q in quaternion]) == pytest.approx(matrix, abs=1e-12)


@pytest.mark.parametrize("wrong", [(0, 0, 0, 0), (math.nan, 0, 0, 1), (math.inf, 0, 0, 0), (1, 0, 0)])
def test_invalid_quaternion_is_refused(wrong):
    with pytest.raises(ValueError, match="not a rotation"):
        rotation_matrix(wrong)


@given(QUATERNION, VECTOR, SIX, SIX)
def test_power_is_the_same_in_every_frame(quaternion, origin, wrench, twist):
    rotation = rotation_matrix(quaternion)
    turning = rotation @ twist[3:]
    moving = rotation @ twist[:3] + np.cross(origin, turning)
    there = transform_wrench(rotation, origin, wrench) @ np.concatenate([moving, turning])
    assert there == pytest.approx(np.dot(wrench, twist), abs=1e-9)


@given(QUATERNION, VECTOR, SIX)
def test_wrench_round_trip_is_identity(quaternion, origin, wrench):
    rotation = rotation_matrix(quaternion)
    there = transform_wrench(rotation, origin, wrench)
    back = transform_wrench(rotation.T, -rotation.T @ np.array(origin), there)
    assert back == pytest.approx(wrench, abs=1e-9)


def test_force_at_a_lever_arm_gives_the_textbook_moment():
    # 10 N along z at 0.2 m along x: −2 N·m about y.
    wrench = transform_wrench(np.eye(3), (0.2, 0, 0), (0, 0, 10, 0, 0, 0))
    assert wrench == pytest.approx([0, 0, 10, 0, -2, 0])


def test_weight_of_a_tool_upright_and_on_its_side():
    weight = 2 * 9.80665
    assert tool_gravity_wrench(DOWN, 2.0, (0, 0, 0.1)) == pytest.approx([0, 0, weight, 0, 0, 0])
    # Tool z along base x, tool x along base −z: the weight pulls along tool x at 0.1 m of tool z.
    side = tool_gravity_wrench((HALF, 0, HALF, 0), 2.0, (0, 0, 0.1))
    assert side == pytest.approx([weight, 0, 0, 0, 0.1 * weight, 0])


@given(QUATERNION, VECTOR, st.floats(0.1, 20))
def test_weight_in_base_frame_is_vertical(quaternion, centre, mass):
    wrench = tool_gravity_wrench(quaternion, mass, centre)
    assert rotate(quaternion, wrench[:3]) == pytest.approx([0, 0, -mass * 9.80665], abs=1e-9)


def test_force_along_is_positive_while_pressing():
    # The table pushes up: along −z of a tool that points down.
    assert force_along((0, 0, -1), DOWN, (0, 0, -10, 0, 0, 0)) == pytest.approx(10.0)


@given(QUATERNION, QUATERNION, VECTOR)
def test_force_along_is_independent_of_tool_frame(one, other, force_base):
    assume(math.hypot(*force_base) > 1e-3)
    readings = [
        force_along((0.6, 0.0, 0.8), q, [*(rotation_matrix(q).T @ np.array(force_base)), 0, 0, 0])
        for q in (one, other)
    ]
    assert readings[0] == pytest.approx(readings[1], abs=1e-9)


@given(QUATERNION)
def test_matrix_and_quaternion_are_the_same_rotation(quaternion):
    matrix = rotation_matrix(quaternion)
    result = quaternion_of(matrix)
    assert math.hypot(*result) == pytest.approx(1.0, abs=1e-12)
    assert np.abs(rotation_matrix(result) - matrix).max() < 1e-12


@pytest.mark.parametrize("axis", range(3))
def test_quaternion_of_half_turn_is_valid(axis):
    quaternion = (0.0, *(float(k == axis) for k in range(3)))
    assert quaternion_of(rotation_matrix(quaternion)) == quaternion
