"""Conversion of poses to and from KUKA notation: X Y Z in mm; A about Z, B about the new Y, C about the newest X,
in degrees.

Columns of R = Rz(A)·Ry(B)·Rx(C) are the axes of the rotated frame. Source: project specification of RSI, section 7.
"""

import math
from collections.abc import Sequence

from protocol.geometry import Pose, angles_of, from_angles


def pose_of(values: Sequence[float]) -> Pose:
    """Convert X Y Z A B C, in mm and degrees, to a pose."""
    x, y, z, a, b, c = values
    return Pose((x / 1e3, y / 1e3, z / 1e3), from_angles(a, b, c))


def values_of(pose: Pose) -> tuple[float, ...]:
    """Convert a pose with a unit quaternion to X Y Z A B C, in mm and degrees."""
    x, y, z = pose.position
    return (x * 1e3, y * 1e3, z * 1e3, *angles_of(pose.quaternion))


def nearest(angle_deg: float, to_deg: float) -> float:
    """Return the equivalent angle that is within half a turn of another angle, degrees."""
    return to_deg + math.remainder(angle_deg - to_deg, 360.0)
