"""Rotation of the tool towards the orientation that a step requests, within the allowed speed."""

import math
from collections.abc import Sequence

from hil_bridge.control.geometry.ways import Place
from protocol.geometry import Pose, Quaternion, Vector, angle_between, product, rotate, towards, turn_about

_NOWHERE: Vector = (0.0, 0.0, 0.0)
_ALIGNED = math.radians(0.02)
"""Largest angle to the desired orientation at which no new orientation is ordered, rad. Chosen."""


def tip_tool(home: Quaternion, axis: Vector) -> Quaternion:
    """Return the orientation nearest to `home` whose tool z axis is the given unit vector in the base frame."""
    return product(_smallest_rotation(rotate(home, (0.0, 0.0, 1.0)), axis), home)


def yaw_tool(home: Quaternion, approach: Vector, before: Place, heading: Place) -> Quaternion:
    """Return `home` rotated about the approach by the angle between two headings in the work frame."""
    sine = before[0] * heading[1] - before[1] * heading[0]
    angle = math.atan2(sine, before[0] * heading[0] + before[1] * heading[1])
    # x towards y turns about the work frame's z axis, which points against the approach
    return product(turn_about(approach, -angle), home)


def rotate_towards(before: Quaternion, target: Quaternion, angle: float) -> Quaternion:
    """Return the next orientation on the rotation from the previous to the desired one, after at most `angle`, rad."""
    if angle_between(before, target) < _ALIGNED:
        return before
    return towards(Pose(_NOWHERE, before), Pose(_NOWHERE, target), 0.0, angle).quaternion


def moment_at(wrench: Sequence[float], point: Vector) -> Vector:
    """Return the moment of a wrench about another point in its frame, N·m."""
    fx, fy, fz, mx, my, mz = wrench
    x, y, z = point
    return mx - (y * fz - z * fy), my - (z * fx - x * fz), mz - (x * fy - y * fx)


def _smallest_rotation(a: Vector, b: Vector) -> Quaternion:
    """Return the smallest rotation from one unit vector to another; for opposite vectors, any rotation by 180°."""
    (x, y, z), (u, v, w) = a, b
    i, j, k = y * w - z * v, z * u - x * w, x * v - y * u
    real = 1.0 + x * u + y * v + z * w
    if real < 1e-15:
        i, j, k = (0.0, -z, y) if abs(x) < 0.9 else (z, 0.0, -x)
        real = 0.0
    length = math.sqrt(real * real + i * i + j * j + k * k)
    return real / length, i / length, j / length, k / length
