"""The angles A, B, C of KUKA: A about Z, B about the new Y, C about the newest X, in degrees; R = Rz(A)·Ry(B)·Rx(C).

Columns of R are the axes of the turned frame. Source: project specification of RSI, section 7.
"""

import math

from protocol.geometry import Pose, Quaternion, Vector

_NO_COSINE = 1e-9
"""Derived: below it, B is ±90°, and A would be read from rounding. A is then 0, and C has the whole turn."""


def quaternion_of(angles_deg: Vector) -> Quaternion:
    """Unit quaternion w x y z of A, B, C, degrees."""
    a, b, c = angles_deg
    a, b, c = math.radians(a) / 2.0, math.radians(b) / 2.0, math.radians(c) / 2.0
    ca, cb, cc = math.cos(a), math.cos(b), math.cos(c)
    sa, sb, sc = math.sin(a), math.sin(b), math.sin(c)
    return (
        ca * cb * cc + sa * sb * sc,
        ca * cb * sc - sa * sb * cc,
        ca * sb * cc + sa * cb * sc,
        sa * cb * cc - ca * sb * sc,
    )


def angles_of(quaternion: Quaternion) -> Vector:
    """A, B, C of a unit quaternion w x y z, degrees: A and C in ±180, B in ±90."""
    w, x, y, z = quaternion
    r11, r21, r31 = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)
    r12, r22 = 2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z)
    r13, r23 = 2.0 * (x * z + w * y), 2.0 * (y * z - w * x)
    a = 0.0 if abs(r11) < _NO_COSINE and abs(r21) < _NO_COSINE else math.atan2(r21, r11)
    ca, sa = math.cos(a), math.sin(a)
    b = math.atan2(-r31, ca * r11 + sa * r21)
    c = math.atan2(sa * r13 - ca * r23, ca * r22 - sa * r12)
    return math.degrees(a), math.degrees(b), math.degrees(c)


def times(p: Quaternion, q: Quaternion) -> Quaternion:
    """The turn by `q`, then by `p`."""
    a, b, c, d = p
    w, x, y, z = q
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )


def inverse(quaternion: Quaternion) -> Quaternion:
    """The turn back, of a unit quaternion."""
    w, x, y, z = quaternion
    return w, -x, -y, -z


def turned(quaternion: Quaternion, vector: Vector) -> Vector:
    """A vector of the turned frame, in the frame that it was turned from."""
    _, x, y, z = times(times(quaternion, (0.0, *vector)), inverse(quaternion))
    return x, y, z


def pose_of(values: list[float]) -> Pose:
    """The pose in X Y Z A B C, mm and degrees."""
    x, y, z, a, b, c = values
    return Pose((x / 1e3, y / 1e3, z / 1e3), quaternion_of((a, b, c)))


def values_of(pose: Pose) -> tuple[float, ...]:
    """X Y Z A B C of a pose, mm and degrees. Its quaternion has unit length."""
    x, y, z = pose.position
    return (x * 1e3, y * 1e3, z * 1e3, *angles_of(pose.quaternion))


def nearest(angle_deg: float, to_deg: float) -> float:
    """The angle that means the same and lies within half a turn of another, degrees."""
    return to_deg + math.remainder(angle_deg - to_deg, 360.0)
