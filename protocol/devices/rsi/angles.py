"""Poses as KUKA writes them: X Y Z in mm; A about Z, B about the new Y, C about the newest X, in degrees.

Columns of R = Rz(A)·Ry(B)·Rx(C) are the axes of the turned frame. Source: project specification of RSI, section 7.
"""

import math
from collections.abc import Sequence

from protocol.geometry import Pose, angles_of, from_angles


def pose_of(values: Sequence[float]) -> Pose:
    """Return the pose in X Y Z A B C, mm and degrees."""
    x, y, z, a, b, c = values
    return Pose((x / 1e3, y / 1e3, z / 1e3), from_angles(a, b, c))


def values_of(pose: Pose) -> tuple[float, ...]:
    """X Y Z A B C of a pose, mm and degrees. Its quaternion has unit length."""
    x, y, z = pose.position
    return (x * 1e3, y * 1e3, z * 1e3, *angles_of(pose.quaternion))


def nearest(angle_deg: float, to_deg: float) -> float:
    """Return the equivalent angle within half a turn of another, degrees."""
    return to_deg + math.remainder(angle_deg - to_deg, 360.0)
