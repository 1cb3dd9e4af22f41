"""Conversion of the sensor's wrench to the contact wrench on the tool."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bridge.control import (
    Wrist,
    force_along,
    rotate,
    rotation_matrix,
    tool_gravity_wrench,
)
from protocol.geometry import angle_between, product, rotation_vector, turn_about, turn_between, turn_by

DOWN = (0.0, 1.0, 0.0, 0.0)
LEVEL = (math.cos(math.pi / 4), 0.0, math.sin(math.pi / 4), 0.0)  # tool z along base x
WRENCH = (1.0, 2.0, 3.0, 0.1, 0.2, 0.3)
QUARTER = turn_about((0.0, 0.0, 1.0), math.pi / 2)
NUMBER = st.floats(-10, 10)
VECTOR = st.tuples(NUMBER, NUMBER, NUMBER)
SIX = st.tuples(*[NUMBER] * 6)
QUATERNION = (
    st.tuples(*[st.floats(-1, 1)] * 4)
    .filter(lambda q: math.hypot(*q) > 0.1)
    .map(lambda q: tuple(part / math.hypot(*q) for part in q))
)


def test_wrist_aligned_sensor_is_unchanged() -> None:
    assert Wrist().contact_wrench(WRENCH, DOWN, DOWN).tolist() == list(WRENCH)


def test_wrist_rotated_by_90_degrees_swaps_axes() -> None:
    turned = Wrist(QUARTER).contact_wrench(WRENCH, DOWN, DOWN)
    assert turned.tolist() == pytest.approx([-2.0, 1.0, 3.0, -0.2, 0.1, 0.3])


def test_wrist_flips_left_handed_sensor_before_rotation() -> None:
    flipped = Wrist(flip=True).contact_wrench(WRENCH, DOWN, DOWN)
    assert flipped.tolist() == pytest.approx([-1.0, 2.0, 3.0, -0.1, 0.2, 0.3])
    both = Wrist(QUARTER, flip=True).contact_wrench(WRENCH, DOWN, DOWN)
    assert both.tolist() == pytest.approx([-2.0, -1.0, 3.0, -0.2, -0.1, 0.3])


def test_wrist_force_at_tip_has_moment_only_at_sensor() -> None:
    """10 N across at the tip, 0.2 m below the sensor: 2 N·m at the sensor, none about the tool centre point."""
    read = (10.0, 0.0, 0.0, 0.0, 2.0, 0.0)
    contact = Wrist(position=(0.0, 0.0, -0.2)).contact_wrench(read, DOWN, DOWN)
    assert contact.tolist() == pytest.approx([10.0, 0.0, 0.0, 0.0, 0.0, 0.0])


@given(QUATERNION, VECTOR, SIX, SIX)
def test_wrist_power_is_equal_at_sensor_and_tool(orientation, position, read, twist) -> None:
    wrench = Wrist(orientation, position).contact_wrench(read, DOWN, DOWN)
    rotation = rotation_matrix(orientation)
    turning = rotation @ twist[3:]
    moving = rotation @ twist[:3] + np.cross(position, turning)
    assert wrench @ np.concatenate([moving, turning]) == pytest.approx(np.dot(read, twist), abs=1e-9)


def test_wrist_subtracts_weight_change_since_zero() -> None:
    """2 kg, 0.1 m below the sensor. The zero was taken pointing down, where the weight lies along tool z; held
    level it pulls along tool x and bends about tool y.
    """
    wrist = Wrist(mass=2.0, centre_of_gravity=(0.0, 0.0, 0.1), bias=(1.0,) * 6)
    weight = 2.0 * 9.80665
    assert wrist.contact_wrench((0.0,) * 6, DOWN, DOWN).tolist() == [0.0] * 6
    wrench_level, wrench_down = (
        np.array([weight, 0, 0, 0, 0.1 * weight, 0]),
        np.array([0, 0, weight, 0, 0, 0]),
    )
    contact = wrist.contact_wrench((wrench_level - wrench_down).tolist(), LEVEL, DOWN)
    assert contact.tolist() == pytest.approx([0.0] * 6, abs=1e-9)


@given(QUATERNION, VECTOR, st.booleans(), SIX, st.floats(0.1, 5), VECTOR, QUATERNION)
def test_wrist_free_tool_without_zero_reads_zero(
    orientation, position, flip, bias, mass, centre, quaternion
) -> None:
    wrist = Wrist(orientation, position, flip, bias, mass, centre)
    weight = tool_gravity_wrench(quaternion, mass, centre)
    to_sensor = wrist.alignment().T
    read = np.concatenate([to_sensor @ weight[:3], to_sensor @ weight[3:]]) + bias
    assert wrist.contact_wrench(read, quaternion, None).tolist() == pytest.approx([0.0] * 6, abs=1e-8)


@given(QUATERNION, QUATERNION, VECTOR)
def test_quaternion_product_is_sequential_rotation(a, b, vector) -> None:
    assert rotate(product(a, b), vector) == pytest.approx(rotate(a, rotate(b, vector)), abs=1e-9)


@given(QUATERNION, QUATERNION)
def test_rotation_between_orientations_is_shortest(a, b) -> None:
    turn = rotation_vector(turn_between(a, b))
    assert math.hypot(*turn) == pytest.approx(angle_between(a, b), abs=1e-9)
    assert angle_between(a, b) <= math.pi + 1e-9
    there = product(turn_by(turn), a)
    assert rotation_matrix(there) == pytest.approx(rotation_matrix(b), abs=1e-9)


def test_wrist_direction_is_converted_to_sensor_axes() -> None:
    """Base down is z of a tool that points down, and x of one held level: −y of a sensor turned by 90°."""
    assert Wrist(QUARTER).in_sensor_axes((0.0, 0.0, -1.0), DOWN) == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)
    level = Wrist(QUARTER, flip=True).in_sensor_axes((0.0, 0.0, -1.0), LEVEL)
    assert level == pytest.approx([0.0, -1.0, 0.0], abs=1e-12)


@given(QUATERNION, QUATERNION, QUATERNION, VECTOR, SIX, VECTOR, st.booleans())
def test_wrist_at_orientation_gives_same_wrench(
    mounted: tuple[float, ...],
    quaternion: tuple[float, ...],
    tare: tuple[float, ...],
    position: tuple[float, ...],
    read: tuple[float, ...],
    direction: tuple[float, ...],
    flip: bool,
) -> None:
    wrist = Wrist(mounted, position, flip, (1.0,) * 6, 2.0, (0.01, 0.02, 0.1))  # type: ignore[arg-type]
    for zero in (tare, None):
        turned = wrist.at_orientation(quaternion, zero, (1.0, 0.0, 0.0), direction)  # type: ignore[arg-type]
        wrench = turned.contact_wrench(read)
        assert wrench == pytest.approx(wrist.contact_wrench(read, quaternion, zero).tolist(), abs=1e-9)
        assert turned.force_along(1, wrench) == pytest.approx(
            force_along(direction, quaternion, wrench), abs=1e-8
        )
