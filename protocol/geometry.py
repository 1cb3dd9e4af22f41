"""Positions, orientations and wrenches as plain values, and how orientations turn: the one place for all devices,
emulators and the bridge.

SI units inside: m, N, N·m, rad. The base frame is the robot's own. The tool frame lies in the tool centre point.
Quaternions have unit length unless a function says otherwise. Rotation vectors turn by their length about their
direction; r and r·(1 − 2π/|r|) are the same orientation, so that they are never compared, filtered or mixed.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

Vector: TypeAlias = tuple[float, float, float]
"""x y z. Field and argument say the frame and the unit; a position without a word is the tool in the base frame, m."""
Quaternion: TypeAlias = tuple[float, float, float, float]
"""w x y z. It turns vectors of the tool frame into vectors of the base frame unless its field says otherwise."""
Wrench: TypeAlias = tuple[float, float, float, float, float, float]
"""fx fy fz mx my mz, N and N·m, about the origin of the frame that its field names."""


class Pose(NamedTuple):
    """Where the tool is and how it stands."""

    position: Vector
    """Tool centre point in the base frame, m."""
    quaternion: Quaternion
    """Tool frame in the base frame, w x y z."""


_SMALL = 1e-9
"""Half an angle, rad, below which its sine is the angle."""
_NO_COSINE = 1e-9
"""Derived: below it the second of three angles is ±90°, and the first would be read from rounding."""


# --- turns


def product(p: Sequence[float], q: Sequence[float]) -> Quaternion:
    """First the turn `q`, then the turn `p`."""
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
    """Return the orientation with unit length: devices round what they send.

    Raises ValueError for a zero quaternion.
    """
    w, x, y, z = quaternion
    norm = math.hypot(w, x, y, z)
    if norm == 0.0:
        raise ValueError("a zero quaternion is no orientation")
    return w / norm, x / norm, y / norm, z / norm


def rotate(quaternion: Sequence[float], vector: Sequence[float]) -> Vector:
    """Rotate a vector of the turned frame into the frame it was turned from: of the tool frame into the base frame."""
    w, x, y, z = quaternion
    a, b, c = vector
    u, v, t = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return a + w * u + y * t - z * v, b + w * v + z * u - x * t, c + w * t + x * v - y * u


def turn_between(start: Sequence[float], goal: Sequence[float]) -> Quaternion:
    """Return the rotation from one orientation to another, about axes of the base frame.

    It is exact for equal ones, and as long as the product of both lengths.
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
    """Angle of the shorter turn from one orientation to another, rad, 0 … π; of quaternions of any length. NaN where
    one of them is zero.
    """
    w, x, y, z = turn_between(a, b)
    sine = math.hypot(x, y, z)
    return 2.0 * math.atan2(sine, abs(w)) if sine or w else math.nan


def rotation_vector(quaternion: Sequence[float]) -> Vector:
    """Return the rotation as a rotation vector, rad, no longer than π."""
    w, x, y, z = quaternion
    sine = math.hypot(x, y, z)
    part = math.copysign(2.0, w) if sine < _SMALL else math.copysign(2.0 * math.atan2(sine, abs(w)), w) / sine
    return x * part, y * part, z * part


def turn_by(vector: Sequence[float]) -> Quaternion:
    """Return the rotation of a rotation vector, rad; NaN for one that is too long."""
    x, y, z = vector
    angle = math.hypot(x, y, z)
    if not math.isfinite(angle):  # a device may tell any number
        return math.nan, math.nan, math.nan, math.nan
    if angle < _SMALL:
        return 1.0, x / 2.0, y / 2.0, z / 2.0
    part = math.sin(angle / 2.0) / angle
    return math.cos(angle / 2.0), x * part, y * part, z * part


# --- what follows from them


def turn_about(axis: Sequence[float], angle: float) -> Quaternion:
    """Return the rotation by an angle, rad, about a unit vector."""
    sine = math.sin(angle / 2.0)
    x, y, z = axis
    return math.cos(angle / 2.0), sine * x, sine * y, sine * z


def tool_axis(quaternion: Sequence[float]) -> Vector:
    """Return the tool's z axis, out of the tool, in the base frame."""
    w, x, y, z = quaternion
    return 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)


def rotation_rows(quaternion: Sequence[float]) -> tuple[Vector, Vector, Vector]:
    """Rows of the matrix whose columns are the axes of the turned frame."""
    w, x, y, z = quaternion
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )


def angle_of_vectors(a: Vector, b: Vector) -> float:
    """Angle between two vectors of any length, rad, 0 … π. The cosine alone says little of a small one."""
    (x, y, z), (u, v, w) = a, b
    return math.atan2(math.hypot(y * w - z * v, z * u - x * w, x * v - y * u), x * u + y * v + z * w)


def from_angles(a_deg: float, b_deg: float, c_deg: float) -> Quaternion:
    """Return the orientation Rz(a)·Ry(b)·Rx(c), degrees.

    It turns about z, the new y and the newest x, or about x, y and z of the fixed frame.
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
    """Return the angles of `from_angles`, degrees: the first and the last in ±180, the second in ±90.

    Where that is ±90, the first is 0 and the last has the whole turn.
    """
    w, x, y, z = quaternion  # seven of nine elements of the matrix, for it is asked for with every packet
    r11, r21, r31 = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)
    r12, r22 = 2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z)
    r13, r23 = 2.0 * (x * z + w * y), 2.0 * (y * z - w * x)
    a = 0.0 if abs(r11) < _NO_COSINE and abs(r21) < _NO_COSINE else math.atan2(r21, r11)
    ca, sa = math.cos(a), math.sin(a)
    b = math.atan2(-r31, ca * r11 + sa * r21)
    c = math.atan2(sa * r13 - ca * r23, ca * r22 - sa * r12)
    return math.degrees(a), math.degrees(b), math.degrees(c)


def slerp(a: Quaternion, b: Quaternion, part: float) -> Quaternion:
    """Interpolate the orientation at `part` (0 … 1) from `a` to `b` along the shorter turn."""
    cosine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    half = angle_between(a, b) / 2.0
    if half < _SMALL:
        return a
    near = math.sin((1.0 - part) * half) / math.sin(half)
    far = math.copysign(math.sin(part * half) / math.sin(half), cosine)
    w, x, y, z = (near * p + far * q for p, q in zip(a, b, strict=True))
    return w, x, y, z


def towards(start: Pose, goal: Pose, distance: float, angle: float) -> Pose:
    """Return the next pose on the straight path from `start` to `goal`; the goal itself when it is near enough.

    It is at most `distance`, m, and `angle`, rad, away from the start. Way and turn end together; the turn is the
    shorter one. Both orientations have unit length within rounding.
    """
    apart = math.dist(start.position, goal.position)
    cosine, x, y, z = turn_between(start.quaternion, goal.quaternion)
    half = math.atan2(math.hypot(x, y, z), abs(cosine))  # exact for the smallest turn too
    share = min(distance / apart if apart else 1.0, angle / (2.0 * half) if half else 1.0)
    if share >= 1.0 - 1e-9:  # what rounding leaves of a way
        return goal
    here, there = 1.0 - share, math.copysign(share, cosine)
    if half > 1e-6:  # below, the chord is the arc
        here, there = (math.copysign(math.sin(abs(part) * half), part) for part in (here, there))
    (a, b, c, d), (e, f, g, h) = start.quaternion, goal.quaternion
    w, i, j, k = here * a + there * e, here * b + there * f, here * c + there * g, here * d + there * h
    norm = math.hypot(w, i, j, k)
    (x, y, z), (u, v, t) = start.position, goal.position
    return Pose(
        (x + (u - x) * share, y + (v - y) * share, z + (t - z) * share),
        (w / norm, i / norm, j / norm, k / norm),
    )
