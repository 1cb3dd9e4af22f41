"""How a program turns the tool: the orientation that a step wants, brought there no faster than allowed."""

import math
from collections.abc import Sequence

from hil_bridge.control.geometry.ways import Place
from protocol.geometry import Pose, Quaternion, Vector, angle_between, product, rotate, towards, turn_about

_NOWHERE: Vector = (0.0, 0.0, 0.0)
_ALIGNED = math.radians(0.02)
"""Chosen: an orientation that is nearer than this is not ordered again, rad."""


def tip_tool(home: Quaternion, axis: Vector) -> Quaternion:
    """Return the orientation nearest to `home` whose tool z axis is this unit vector of the base frame."""
    return product(_shortest(rotate(home, (0.0, 0.0, 1.0)), axis), home)


def yaw_tool(home: Quaternion, approach: Vector, before: Place, heading: Place) -> Quaternion:
    """`home` turned about the approach by the angle from one heading in the work frame to another."""
    sine = before[0] * heading[1] - before[1] * heading[0]
    angle = math.atan2(sine, before[0] * heading[0] + before[1] * heading[1])
    # x towards y turns about the work frame's z axis, which points against the approach
    return product(turn_about(approach, -angle), home)


def brought(before: Quaternion, wanted: Quaternion, angle: float) -> Quaternion:
    """Return the next orientation towards the desired one, at most `angle`, rad, from the one before."""
    if angle_between(before, wanted) < _ALIGNED:
        return before
    return towards(Pose(_NOWHERE, before), Pose(_NOWHERE, wanted), 0.0, angle).quaternion


def moment_at(wrench: Sequence[float], point: Vector) -> Vector:
    """Moment of a wrench about another point of its frame, N·m."""
    fx, fy, fz, mx, my, mz = wrench
    x, y, z = point
    return mx - (y * fz - z * fy), my - (z * fx - x * fz), mz - (x * fy - y * fx)


def _shortest(a: Vector, b: Vector) -> Quaternion:
    """Return the smallest rotation from one unit vector to another; of opposite ones, any half turn."""
    (x, y, z), (u, v, w) = a, b
    i, j, k = y * w - z * v, z * u - x * w, x * v - y * u
    real = 1.0 + x * u + y * v + z * w
    if real < 1e-15:
        i, j, k = (0.0, -z, y) if abs(x) < 0.9 else (z, 0.0, -x)
        real = 0.0
    length = math.sqrt(real * real + i * i + j * j + k * k)
    return real / length, i / length, j / length, k / length
