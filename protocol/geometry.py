"""Positions, orientations and wrenches as plain values, and rotation arithmetic, for all devices, emulators and the
bridge.

All units are SI: m, N, N·m, rad. The base frame is the robot's own. The origin of the tool frame is the tool centre
point. Quaternions have unit length unless a function says otherwise. A rotation vector rotates by its length about
its direction. Because r and r·(1 − 2π/|r|) are the same orientation, rotation vectors are never compared, filtered
or averaged.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

Vector: TypeAlias = tuple[float, float, float]
"""Vector x y z. The name of the field or argument gives its frame and unit. By default, a position is the position
of the tool in the base frame, m.
"""
Quaternion: TypeAlias = tuple[float, float, float, float]
"""Quaternion w x y z. It rotates vectors of the tool frame into the base frame unless its field says otherwise."""
Wrench: TypeAlias = tuple[float, float, float, float, float, float]
"""Wrench fx fy fz mx my mz, N and N·m, about the origin of the frame that the name of the field gives."""


class Pose(NamedTuple):
    """Position and orientation of the tool."""

    position: Vector
    """Position of the tool centre point in the base frame, m."""
    quaternion: Quaternion
    """Orientation of the tool frame in the base frame, w x y z."""


_SMALL = 1e-9
"""Half angle below which its sine equals the angle, rad."""
_NO_COSINE = 1e-9
"""Limit of the cosine of the second of three angles, below which this angle is ±90° and rounding alone would
determine the first angle. Derived.
"""


# --- rotations


def product(p: Sequence[float], q: Sequence[float]) -> Quaternion:
    """Return the rotation that applies first `q`, then `p`."""
    a, b, c, d = p
    w, x, y, z = q
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )


def inverse(quaternion: Sequence[float]) -> Quaternion:
    """Return the inverse rotation."""
    w, x, y, z = quaternion
    return w, -x, -y, -z


def normalise(quaternion: Sequence[float]) -> Quaternion:
    """Return the quaternion scaled to unit length, because devices round the values that they send.

    Raises ValueError for a zero quaternion.
    """
    w, x, y, z = quaternion
    norm = math.hypot(w, x, y, z)
    if norm == 0.0:
        raise ValueError("a zero quaternion is not an orientation")
    return w / norm, x / norm, y / norm, z / norm


def rotate(quaternion: Sequence[float], vector: Sequence[float]) -> Vector:
    """Rotate a vector from the rotated frame into the reference frame, for example from the tool frame into the
    base frame.
    """
    w, x, y, z = quaternion
    a, b, c = vector
    u, v, t = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return a + w * u + y * t - z * v, b + w * v + z * u - x * t, c + w * t + x * v - y * u


def turn_between(start: Sequence[float], goal: Sequence[float]) -> Quaternion:
    """Return the rotation from one orientation to another, about axes of the base frame.

    It is exact for equal orientations. Its norm is the product of both norms.
    """
    w, x, y, z = start
    a, b, c, d = goal
    return (
        a * w + b * x + c * y + d * z,
        b * w - a * x - c * z + d * y,
        c * w - a * y - d * x + b * z,
        d * w - a * z - b * y + c * x,
    )


def angle_between(a: Sequence[float], b: Sequence[float]) -> float:
    """Return the angle of the shorter rotation between two orientations, rad, 0 … π. The quaternions may have any
    length; the result is NaN if one of them is zero.
    """
    w, x, y, z = turn_between(a, b)
    sine = math.hypot(x, y, z)
    return 2.0 * math.atan2(sine, abs(w)) if sine or w else math.nan


def rotation_vector(quaternion: Sequence[float]) -> Vector:
    """Convert a rotation to a rotation vector, rad, no longer than π."""
    w, x, y, z = quaternion
    sine = math.hypot(x, y, z)
    part = math.copysign(2.0, w) if sine < _SMALL else math.copysign(2.0 * math.atan2(sine, abs(w)), w) / sine
    return x * part, y * part, z * part


def turn_by(vector: Sequence[float]) -> Quaternion:
    """Convert a rotation vector, rad, to a rotation; NaN if the vector is too long."""
    x, y, z = vector
    angle = math.hypot(x, y, z)
    if not math.isfinite(angle):  # a device may report any number
        return math.nan, math.nan, math.nan, math.nan
    if angle < _SMALL:
        return 1.0, x / 2.0, y / 2.0, z / 2.0
    part = math.sin(angle / 2.0) / angle
    return math.cos(angle / 2.0), x * part, y * part, z * part


# --- derived functions


def turn_about(axis: Sequence[float], angle: float) -> Quaternion:
    """Return the rotation by an angle, rad, about a unit vector."""
    sine = math.sin(angle / 2.0)
    x, y, z = axis
    return math.cos(angle / 2.0), sine * x, sine * y, sine * z


def tool_axis(quaternion: Sequence[float]) -> Vector:
    """Return the direction of the tool's z axis, which points out of the tool, in the base frame."""
    w, x, y, z = quaternion
    return 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)


def rotation_rows(quaternion: Sequence[float]) -> tuple[Vector, Vector, Vector]:
    """Return the rows of the matrix whose columns are the axes of the rotated frame."""
    w, x, y, z = quaternion
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )


def angle_of_vectors(a: Vector, b: Vector) -> float:
    """Return the angle between two vectors of any length, rad, 0 … π. The result is accurate for small angles too."""
    (x, y, z), (u, v, w) = a, b
    return math.atan2(math.hypot(y * w - z * v, z * u - x * w, x * v - y * u), x * u + y * v + z * w)


def from_angles(a_deg: float, b_deg: float, c_deg: float) -> Quaternion:
    """Return the orientation Rz(a)·Ry(b)·Rx(c), with angles in degrees.

    It rotates about z, the new y and the newest x, which is the same as about x, y and z of the fixed frame.
    """
    a, b, c = math.radians(a_deg) / 2.0, math.radians(b_deg) / 2.0, math.radians(c_deg) / 2.0
    ca, cb, cc = math.cos(a), math.cos(b), math.cos(c)
    sa, sb, sc = math.sin(a), math.sin(b), math.sin(c)
    return (
        ca * cb * cc + sa * sb * sc,
        ca * cb * sc - sa * sb * cc,
        ca * sb * cc + sa * cb * sc,
        sa * cb * cc - ca * sb * sc,
    )


def angles_of(quaternion: Sequence[float]) -> Vector:
    """Return the angles from which `from_angles` computes an orientation, degrees: the first and the last within
    ±180, the second within ±90.

    If the second angle is ±90, the first is 0 and the last contains the entire rotation.
    """
    w, x, y, z = quaternion  # only seven of the nine matrix elements, because this runs for every packet
    r11, r21, r31 = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)
    r12, r22 = 2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z)
    r13, r23 = 2.0 * (x * z + w * y), 2.0 * (y * z - w * x)
    a = 0.0 if abs(r11) < _NO_COSINE and abs(r21) < _NO_COSINE else math.atan2(r21, r11)
    ca, sa = math.cos(a), math.sin(a)
    b = math.atan2(-r31, ca * r11 + sa * r21)
    c = math.atan2(sa * r13 - ca * r23, ca * r22 - sa * r12)
    return math.degrees(a), math.degrees(b), math.degrees(c)


def slerp(a: Quaternion, b: Quaternion, part: float) -> Quaternion:
    """Interpolate between the orientations `a` and `b` along the shorter rotation, at the fraction `part` (0 … 1)."""
    cosine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    half = angle_between(a, b) / 2.0
    if half < _SMALL:
        return a
    near = math.sin((1.0 - part) * half) / math.sin(half)
    far = math.copysign(math.sin(part * half) / math.sin(half), cosine)
    w, x, y, z = (near * p + far * q for p, q in zip(a, b, strict=True))
    return w, x, y, z


def towards(start: Pose, goal: Pose, distance: float, angle: float) -> Pose:
    """Return the next pose on the straight path from `start` to `goal`; the goal itself if it is near enough.

    The pose is at most `distance`, m, and `angle`, rad, away from the start. Translation and rotation end together,
    and the rotation is the shorter one. Both orientations have unit length within rounding.
    """
    apart = math.dist(start.position, goal.position)
    cosine, x, y, z = turn_between(start.quaternion, goal.quaternion)
    half = math.atan2(math.hypot(x, y, z), abs(cosine))  # exact even for the smallest rotation
    share = min(distance / apart if apart else 1.0, angle / (2.0 * half) if half else 1.0)
    if share >= 1.0 - 1e-9:  # only a rounding error remains
        return goal
    here, there = 1.0 - share, math.copysign(share, cosine)
    if half > 1e-6:  # for smaller angles, the chord equals the arc
        here, there = (math.copysign(math.sin(abs(part) * half), part) for part in (here, there))
    (a, b, c, d), (e, f, g, h) = start.quaternion, goal.quaternion
    w, i, j, k = here * a + there * e, here * b + there * f, here * c + there * g, here * d + there * h
    norm = math.hypot(w, i, j, k)
    (x, y, z), (u, v, t) = start.position, goal.position
    return Pose(
        (x + (u - x) * share, y + (v - y) * share, z + (t - z) * share),
        (w / norm, i / norm, j / norm, k / norm),
    )
