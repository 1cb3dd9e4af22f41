"""Transformations of wrenches and rotations between frames.

Vectors have shape (3,). Wrenches are (fx fy fz mx my mz) in N and N·m. Quaternions are w x y z and give the
orientation of the tool in the base, so they rotate tool vectors into base vectors. Source: textbook rigid-body
statics. A wrench transforms by the transpose of the adjoint for a twist, so that force times velocity is the same
in every frame.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from protocol.geometry import Quaternion, Vector, rotation_rows

Array = NDArray[np.float64]

STANDARD_GRAVITY = 9.80665
"""Standard gravity, m/s². Source: ISO 80000-3."""

GRAVITY_BASE = np.array([0.0, 0.0, -STANDARD_GRAVITY])
"""Direction and magnitude of gravity in the base frame, m/s². Assumed: the robot is mounted upright, with its base
z axis up.
"""


def rotation_matrix(quaternion: Sequence[float]) -> Array:
    """Return the rotation matrix of a quaternion w x y z. The quaternion is first normalised, because robot links
    round the values that they send.

    Raises ValueError for a quaternion that is zero, infinite or not a number.
    """
    return np.array(unit_rows(quaternion))


def unit_rows(quaternion: Sequence[float]) -> tuple[Vector, Vector, Vector]:
    """Return the rows of `rotation_matrix` as plain numbers, because arrays would take ten times as long. Raises
    ValueError for the same quaternions as `rotation_matrix`.
    """
    length = math.hypot(*quaternion)
    if len(quaternion) != 4 or not math.isfinite(length) or length < 1e-6:
        raise ValueError(f"not a rotation: quaternion {tuple(quaternion)}")
    w, x, y, z = quaternion
    return rotation_rows((w / length, x / length, y / length, z / length))


def quaternion_of(rotation: Array) -> Quaternion:
    """Return the unit quaternion of a rotation matrix of shape (3, 3). Its largest component is positive."""
    (a, b, c), (d, e, f), (g, h, i) = rotation.tolist()
    # row k is the quaternion times 4 of its component k; the longest row has the smallest rounding error
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
    """Return a tool-frame vector in the base frame. Raises ValueError for an invalid quaternion."""
    rotated: Array = rotation_matrix(quaternion) @ np.asarray(vector, dtype=float)
    return rotated


def transform_wrench(rotation: Array, origin: ArrayLike, wrench: ArrayLike) -> Array:
    """Return a wrench from frame B in frame A: f_A = R f_B, m_A = R m_B + p × f_A.

    `rotation` rotates vectors from B into A. `origin` is the origin of B in A, m.
    """
    wrench = np.asarray(wrench, dtype=float)
    force = rotation @ wrench[:3]
    return np.concatenate([force, rotation @ wrench[3:] + _cross(np.asarray(origin, dtype=float), force)])


def tool_gravity_wrench(quaternion: Sequence[float], mass_kg: float, centre_of_gravity: ArrayLike) -> Array:
    """Return the wrench that the weight below the sensor exerts on it, in the tool frame. Subtract it from the
    measured wrench.

    The centre of gravity is relative to the sensor's origin, in the tool frame, m.
    """
    force = rotation_matrix(quaternion).T @ (mass_kg * GRAVITY_BASE)
    return np.concatenate([force, _cross(np.asarray(centre_of_gravity, dtype=float), force)])


def force_along(direction_base: ArrayLike, quaternion: Sequence[float], wrench_tool: ArrayLike) -> float:
    """Return the contact force along a unit vector into the surface, −(R f) · n, N. It is positive while the tool
    presses.

    The wrench acts on the tool, so a pressed surface pushes back against the direction.
    """
    force_base = rotate(quaternion, np.asarray(wrench_tool, dtype=float)[:3])
    return -float(force_base @ np.asarray(direction_base, dtype=float))


def _cross(a: Array, b: Array) -> Array:
    """Return the cross product of two vectors. For single vectors, numpy takes ten times as long."""
    (x, y, z), (u, v, w) = a.tolist(), b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])
