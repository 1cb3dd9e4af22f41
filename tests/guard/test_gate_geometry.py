"""Arithmetic of the last gate, compared with rotations and distances known by construction."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, strategies

from hil_bridge.devices.robots.gate import Bounds, Gate, contradiction, depth_of
from protocol.geometry import Pose, Quaternion, Vector, product, rotate, turn_about

ORIGIN = (0.0, 0.0, 0.0)
UPRIGHT = (0.0, 1.0, 0.0, 0.0)


def unit(vector: Vector) -> Vector:
    """Return a vector divided by its length."""
    length = math.hypot(*vector)
    x, y, z = vector
    return x / length, y / length, z / length


AXES = (
    strategies.tuples(*[strategies.floats(-1.0, 1.0)] * 3)
    .filter(lambda axis: math.hypot(*axis) > 0.1)
    .map(unit)
)
ORIENTATIONS = strategies.builds(turn_about, AXES, strategies.floats(0.1, 3.0))


def unit_across(axis: Vector, other: Vector) -> Vector:
    """Return a unit vector perpendicular to an axis."""
    x, y, z = np.cross(axis, other).tolist()
    assume(math.hypot(x, y, z) > 0.1)
    return unit((x, y, z))


@pytest.mark.parametrize(("margin", "message"), [(-0.01, "tilted more than allowed"), (0.01, "")])
@given(start=ORIENTATIONS, other=AXES, angle=strategies.floats(0.05, 3.0))
def test_gate_tilt_is_the_angle_of_the_tool_axis(
    margin: float, message: str, start: Quaternion, other: Vector, angle: float
) -> None:
    """A turn about the tool's own axis tilts nothing, one about an axis across it by its angle."""
    across = unit_across(rotate(start, (0.0, 0.0, 1.0)), other)
    twisted = product(start, turn_about((0.0, 0.0, 1.0), 0.7))
    gate = Gate(Bounds(Pose(ORIGIN, start), tilt=angle + margin), 0.0)
    refused = gate.judge(Pose(ORIGIN, product(turn_about(across, angle), twisted)), 0.0)
    assert bool(refused) == bool(message)
    assert message in refused


@pytest.mark.parametrize(("share", "message"), [(0.99, "across the approach faster"), (1.01, "")])
@given(approach=AXES, other=AXES, along=strategies.floats(-0.1, 0.1), across=strategies.floats(0.01, 0.1))
def test_gate_distance_across_excludes_the_approach(
    share: float, message: str, approach: Vector, other: Vector, along: float, across: float
) -> None:
    side = unit_across(approach, other)
    x, y, z = (along * a + across * s for a, s in zip(approach, side, strict=True))
    bounds = Bounds(Pose(ORIGIN, UPRIGHT), approach, across=across * share)
    refused = Gate(bounds, 0.0).judge(Pose((x, y, z), UPRIGHT), 0.0)
    assert bool(refused) == bool(message)
    assert message in refused


@given(
    origin=strategies.tuples(*[strategies.floats(-1.0, 1.0)] * 3),
    approach=AXES,
    other=AXES,
    depth=strategies.floats(-0.1, 0.1),
    aside=strategies.floats(-0.1, 0.1),
)
def test_gate_depth_is_counted_from_the_start_along_the_approach(
    origin: Vector, approach: Vector, other: Vector, depth: float, aside: float
) -> None:
    side = unit_across(approach, other)
    x, y, z = (o + depth * a + aside * s for o, a, s in zip(origin, approach, side, strict=True))
    assert contradiction((x, y, z), origin, approach, depth) == ""
    assert "0.2 mm from the depth" in contradiction((x, y, z), origin, approach, depth + 2e-4)
    bounds = Bounds(Pose(origin, UPRIGHT), approach, deepest=depth)
    assert depth_of((x, y, z), bounds) == pytest.approx(depth, abs=1e-9)
    assert Gate(bounds, 0.0).judge(Pose((x, y, z), UPRIGHT), 0.0) == ""
    shallower = Bounds(Pose(origin, UPRIGHT), approach, deepest=depth - 1e-3)
    assert "1.0 mm deeper than allowed" in Gate(shallower, 0.0).judge(Pose((x, y, z), UPRIGHT), 0.0)
