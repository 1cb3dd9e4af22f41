"""Wrenches and rotations between frames.

Vectors have shape (3,), wrenches are (fx fy fz mx my mz) in N and N·m. Quaternions are w x y z and say how the tool
stands in the base, so they turn tool vectors into base vectors. Source: textbook rigid-body statics. A wrench moves by
the transpose of the adjoint that moves a twist, so that force times velocity is the same number in every frame.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from protocol.geometry import Quaternion, Vector, rotation_rows

Array = NDArray[np.float64]

STANDARD_GRAVITY = 9.80665
"""m/s². Source: ISO 80000-3."""

GRAVITY_BASE = np.array([0.0, 0.0, -STANDARD_GRAVITY])
"""Assumed: the robot stands upright, its base z axis points up."""


def rotation_matrix(quaternion: Sequence[float]) -> Array:
    """Rotation of a quaternion w x y z, brought to unit length first, for robot links round what they send.

    Raises ValueError for one without direction: zero, infinite or not a number.
    """
    return np.array(unit_rows(quaternion))


def unit_rows(quaternion: Sequence[float]) -> tuple[Vector, Vector, Vector]:
    """Rows of `rotation_matrix` in plain numbers: arrays would take ten times as long. Raises ValueError as it does."""
    length = math.hypot(*quaternion)
    if len(quaternion) != 4 or not math.isfinite(length) or length < 1e-6:
        raise ValueError(f"not a rotation: quaternion {tuple(quaternion)}")
    w, x, y, z = quaternion
    return rotation_rows((w / length, x / length, y / length, z / length))


def quaternion_of(rotation: Array) -> Quaternion:
    """Return the unit quaternion of a rotation matrix (3, 3), its largest part above 0."""
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    # row k is the quaternion times 4 of its part k; the longest row is the one with the least rounding
    rows = np.array(
        [
            [1 + a + e + i, h - f, c - g, d - b],
            [h - f, 1 + a - e - i, b + d, c + g],
            [c - g, b + d, 1 - a + e - i, f + h],
            [d - b, c + g, f + h, 1 - a - e + i],
        ]
    )
    longest = rows[np.diag(rows).argmax()]
    w, x, y, z = (longest / np.linalg.norm(longest)).tolist()
    return w, x, y, z


def rotate(quaternion: Sequence[float], vector: ArrayLike) -> Array:
    """Convert a vector from the tool frame to the base frame. Raises ValueError for an impossible quaternion."""
    rotated: Array = rotation_matrix(quaternion) @ np.asarray(vector, dtype=float)
    return rotated


def transform_wrench(rotation: Array, origin: ArrayLike, wrench: ArrayLike) -> Array:
    """Convert a wrench from frame B to frame A: f_A = R f_B, m_A = R m_B + p × f_A.

    `rotation` turns B's vectors into A's, `origin` is where B's origin lies in A, m.
    """
    wrench = np.asarray(wrench, dtype=float)
    force = rotation @ wrench[:3]
    return np.concatenate([force, rotation @ wrench[3:] + _cross(np.asarray(origin, dtype=float), force)])


def tool_gravity_wrench(quaternion: Sequence[float], mass_kg: float, centre_of_gravity: ArrayLike) -> Array:
    """Wrench that the weight below the sensor puts on it, in the tool frame; subtract it from the measured one.

    The centre of gravity is given from the sensor's origin in the tool frame, m.
    """
    force = rotation_matrix(quaternion).T @ (mass_kg * GRAVITY_BASE)
    return np.concatenate([force, _cross(np.asarray(centre_of_gravity, dtype=float), force)])


def force_along(direction_base: ArrayLike, quaternion: Sequence[float], wrench_tool: ArrayLike) -> float:
    """Contact force along a unit vector into the surface, N, positive while the tool presses: −(R f) · n.

    The wrench acts on the tool, so a surface that is pressed pushes back against the direction.
    """
    force_base = rotate(quaternion, np.asarray(wrench_tool, dtype=float)[:3])
    return -float(force_base @ np.asarray(direction_base, dtype=float))


def _cross(a: Array, b: Array) -> Array:
    """Return the cross product of two vectors; numpy's own takes ten times as long for single ones."""
    (x, y, z), (u, v, w) = a.tolist(), b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])
