"""Poses of the bridge, in m, and of the wire, in mm."""

import math

from protocol.devices.egm.messages import PoseMm
from protocol.geometry import Pose, Quaternion, Vector

_TINY = 1e-9
"""Half of an angle, rad, below which its sine is the angle."""


def from_wire(pose: PoseMm) -> Pose:
    """The pose with its position in m."""
    x, y, z = pose.position_mm
    return Pose((x / 1e3, y / 1e3, z / 1e3), pose.quaternion)


def to_wire(pose: Pose) -> PoseMm:
    """The pose with its position in mm."""
    x, y, z = pose.position
    return PoseMm((x * 1e3, y * 1e3, z * 1e3), pose.quaternion)


def rotation_vector(before: Quaternion, after: Quaternion) -> Vector:
    """The shortest turn from one orientation to another about an axis of the base frame, rad."""
    a, b, c, d = before
    w, x, y, z = after
    turn = (
        w * a + x * b + y * c + z * d,
        x * a - w * b + z * c - y * d,
        y * a - w * c + x * d - z * b,
        z * a - w * d + y * b - x * c,
    )
    cosine, i, j, k = turn
    sine = math.hypot(i, j, k)
    if sine < _TINY:
        scale = math.copysign(2.0, cosine)
    else:
        scale = math.copysign(1.0, cosine) * 2.0 * math.atan2(sine, abs(cosine)) / sine
    return scale * i, scale * j, scale * k


def turned(quaternion: Quaternion, by: Vector) -> Quaternion:
    """The orientation after a turn by a rotation vector of the base frame, rad."""
    x, y, z = by
    angle = math.hypot(x, y, z)
    share = 0.5 if angle < _TINY else math.sin(angle / 2.0) / angle
    w, x, y, z = math.cos(angle / 2.0), share * x, share * y, share * z
    a, b, c, d = quaternion
    p, q, r, s = (
        w * a - x * b - y * c - z * d,
        w * b + x * a + y * d - z * c,
        w * c - x * d + y * a + z * b,
        w * d + x * c - y * b + z * a,
    )
    norm = math.hypot(p, q, r, s)
    return p / norm, q / norm, r / norm, s / norm


def rotated(quaternion: Quaternion, vector: Vector) -> Vector:
    """A vector of the tool frame in the base frame, by the tool's orientation of unit length."""
    w, x, y, z = quaternion
    a, b, c = vector
    u, v, t = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return a + w * u + y * t - z * v, b + w * v + z * u - x * t, c + w * t + x * v - y * u
