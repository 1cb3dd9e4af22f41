"""Rotation vectors and unit quaternions.

A rotation vector r turns by |r| about its direction. r and r·(1 − 2π/|r|) are the same orientation, and a tool that
points down lives where both have the length π. So rotation vectors are never compared, filtered or mixed.
"""

import math
from collections.abc import Sequence

from protocol.geometry import Pose, Quaternion, Vector

_SMALL = 1e-9
"""Below, rad, the sine of a half angle is the half angle."""


def quaternion_of(vector: Sequence[float]) -> Quaternion:
    """Unit quaternion w x y z of a rotation vector, rad; NaN for one that is too long to turn by."""
    x, y, z = vector
    angle = math.hypot(x, y, z)
    if not math.isfinite(angle):  # a device may tell any number
        return math.nan, math.nan, math.nan, math.nan
    if angle < _SMALL:
        return 1.0, x / 2.0, y / 2.0, z / 2.0
    part = math.sin(angle / 2.0) / angle
    return math.cos(angle / 2.0), x * part, y * part, z * part


def rotation_vector(quaternion: Quaternion) -> Vector:
    """Rotation vector, rad, no longer than π, of a unit quaternion."""
    w, x, y, z = quaternion
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    sine = math.hypot(x, y, z)
    if sine < _SMALL:
        return 2.0 * x, 2.0 * y, 2.0 * z
    part = 2.0 * math.atan2(sine, w) / sine
    return x * part, y * part, z * part


def pose_of(six: Sequence[float]) -> Pose:
    """The pose of x y z, m, and a rotation vector, rad."""
    x, y, z, *vector = six
    return Pose((x, y, z), quaternion_of(vector))


def six_of(pose: Pose) -> tuple[float, float, float, float, float, float]:
    """x y z, m, and the rotation vector, rad, of a pose."""
    return (*pose.position, *rotation_vector(pose.quaternion))


def turn_between(a: Quaternion, b: Quaternion) -> float:
    """The shorter turn between two orientations, rad."""
    chord = min(math.dist(a, b), math.hypot(*(p + q for p, q in zip(a, b, strict=True))))
    return 4.0 * math.asin(min(chord / 2.0, 1.0))
