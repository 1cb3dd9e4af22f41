"""Unit quaternions, w x y z."""

import math

from protocol.geometry import Quaternion


def normalised(quaternion: Quaternion) -> Quaternion:
    """The unit quaternion of the same direction. Raises ValueError for a zero quaternion."""
    w, x, y, z = quaternion
    norm = math.hypot(w, x, y, z)
    if norm == 0.0:
        raise ValueError("a zero quaternion is no orientation")
    return w / norm, x / norm, y / norm, z / norm


def angle_between(a: Quaternion, b: Quaternion) -> float:
    """Angle of the rotation from one unit quaternion to another, rad, 0 … π."""
    # atan2 keeps small angles exact, where the arc cosine of the dot product loses half the digits.
    sign = math.copysign(1.0, _dot(a, b))
    (w, x, y, z), (e, f, g, h) = a, b
    e, f, g, h = sign * e, sign * f, sign * g, sign * h
    difference, total = math.hypot(w - e, x - f, y - g, z - h), math.hypot(w + e, x + f, y + g, z + h)
    return 4.0 * math.atan2(difference, total)


def slerp(a: Quaternion, b: Quaternion, part: float) -> Quaternion:
    """The unit quaternion `part` (0 … 1) of the way from `a` to `b` along the shorter arc."""
    half_angle = angle_between(a, b) / 2.0
    if half_angle < 1e-9:
        return a
    near = math.sin((1.0 - part) * half_angle) / math.sin(half_angle)
    far = math.copysign(math.sin(part * half_angle) / math.sin(half_angle), _dot(a, b))
    w, x, y, z = (near * p + far * q for p, q in zip(a, b, strict=True))
    return w, x, y, z


def product(p: Quaternion, q: Quaternion) -> Quaternion:
    """The turn by `q`, then by `p`."""
    a, b, c, d = p
    w, x, y, z = q
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )


def _dot(a: Quaternion, b: Quaternion) -> float:
    (w, x, y, z), (e, f, g, h) = a, b
    return w * e + x * f + y * g + z * h
