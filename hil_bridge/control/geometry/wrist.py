"""Conversion of the wrist sensor's readings to the contact wrench on the tool.

There are three frames: the sensor frame, in which the sensor measures; a frame with the same origin and the tool's
axes; and the tool frame. The tool's weight is subtracted in the second frame. The contact wrench is about the
origin of the tool frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from hil_bridge.control.geometry.frames import (
    STANDARD_GRAVITY,
    Array,
    rotation_matrix,
    tool_gravity_wrench,
    transform_wrench,
    unit_rows,
)
from protocol.geometry import Quaternion, Vector, Wrench

NO_WRENCH = (0.0,) * 6


@dataclass(frozen=True, slots=True)
class Wrist:
    """Mounting of the sensor between flange and tool, and its reading without contact."""

    orientation: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """Orientation of the sensor frame in the tool frame, w x y z."""
    position: Vector = (0.0, 0.0, 0.0)
    """Origin of the sensor in the tool frame, m."""
    flip: bool = False
    """Whether to negate Fx and Mx. This is required for a sensor with left-handed axes, viewed from the tool (JR3
    manual 5907E).
    """
    bias: tuple[float, ...] = NO_WRENCH
    """Reading of the sensor without load, before the flip, N and N·m, shape (6,)."""
    mass: float = 0.0
    """Mass below the sensor, kg."""
    centre_of_gravity: Vector = (0.0, 0.0, 0.0)
    """Centre of gravity of that mass relative to the sensor's origin, along the axes of the tool frame, m."""

    def alignment(self) -> Array:
        """Return the matrix of shape (3, 3) that rotates forces and moments from the sensor's axes to the tool's
        axes.
        """
        matrix = rotation_matrix(self.orientation)
        return matrix * (-1.0, 1.0, 1.0) if self.flip else matrix

    def in_sensor_axes(self, direction_base: Sequence[float], quaternion: Sequence[float]) -> Array:
        """Return the components of a base-frame direction along the sensor's three force axes, shape (3,)."""
        in_sensor: Array = self.alignment().T @ rotation_matrix(quaternion).T @ np.asarray(direction_base)
        return in_sensor

    def contact_wrench(
        self,
        measured: Sequence[float],
        quaternion: Sequence[float],
        quaternion_tare: Sequence[float] | None,
    ) -> Array:
        """Return the wrench of the environment on the tool about the origin of the tool frame, N and N·m, shape
        (6,).

        `measured` is in the sensor frame. Quaternions are w x y z, tool in base. A reading relative to a zero taken
        at `quaternion_tare` does not contain the bias and the weight at that orientation, so only the change of the
        weight since then is subtracted. If it is None, no zero was taken, and the known bias and weight are
        subtracted.
        """
        counted = np.asarray(measured, dtype=float)
        if quaternion_tare is None:
            counted = counted - self.bias
        alignment = self.alignment()
        wrench = np.concatenate([alignment @ counted[:3], alignment @ counted[3:]])
        if self.mass and (quaternion_tare is None or tuple(quaternion) != tuple(quaternion_tare)):
            wrench -= tool_gravity_wrench(quaternion, self.mass, self.centre_of_gravity)
            if quaternion_tare is not None:
                wrench += tool_gravity_wrench(quaternion_tare, self.mass, self.centre_of_gravity)
        return transform_wrench(np.eye(3), self.position, wrench)

    def at_orientation(
        self, quaternion: Sequence[float], quaternion_tare: Sequence[float] | None, *directions_base: Vector
    ) -> "WristAtOrientation":
        """Return `contact_wrench` and the given directions, precomputed for one orientation of the tool.

        For a robot that reports a noisy orientation, it is called in every cycle. Raises ValueError for the same
        quaternions as `rotation_matrix`.
        """
        matrix, biased, weight = _fixed(self)
        rows = unit_rows(quaternion)
        offset = biased if quaternion_tare is None else NO_WRENCH
        if weight is not None and (quaternion_tare is None or tuple(quaternion) != tuple(quaternion_tare)):
            x, y, z = rows[2]
            if quaternion_tare is not None:
                a, b, c = unit_rows(quaternion_tare)[2]
                x, y, z = x - a, y - b, z - c
            offset = tuple([at + a * x + b * y + c * z for at, (a, b, c) in zip(offset, weight, strict=True)])
        (a, b, c), (d, e, f), (g, h, i) = rows
        directions = [
            (a * x + d * y + g * z, b * x + e * y + h * z, c * x + f * y + i * z)
            for x, y, z in directions_base
        ]
        return WristAtOrientation(matrix, offset, tuple(directions))


Rows = tuple[tuple[float, ...], ...]


class Fixed(NamedTuple):
    """Values of a wrist that do not depend on the tool's orientation."""

    matrix: Rows
    """Matrix of `WristAtOrientation.matrix`."""
    biased: tuple[float, ...]
    """Contact wrench due to the bias alone, N and N·m, shape (6,)."""
    weight: Rows | None
    """Matrix, shape (6, 3), from the upward direction along the tool's axes to the contribution of the weight below
    the sensor to the contact wrench, N and N·m. None without a weight.
    """


@lru_cache(maxsize=8)
def _fixed(wrist: Wrist) -> Fixed:
    bare, level = replace(wrist, bias=NO_WRENCH, mass=0.0), (1.0, 0.0, 0.0, 0.0)
    columns = [bare.contact_wrench(unit, level, None) + 0.0 for unit in np.eye(6).tolist()]
    biased = replace(wrist, mass=0.0).contact_wrench(NO_WRENCH, level, None)
    weight = None
    if wrist.mass:
        pulls = []
        for force in wrist.mass * STANDARD_GRAVITY * np.eye(3):
            pull = [*force, *np.cross(wrist.centre_of_gravity, force)]
            pulls.append(transform_wrench(np.eye(3), wrist.position, pull))
        weight = _rows(pulls)
    return Fixed(_rows(columns), tuple(biased.tolist()), weight)


def _rows(columns: Sequence[Array]) -> Rows:
    return tuple(map(tuple, np.transpose(columns).tolist()))


class WristAtOrientation(Struct, frozen=True, gc=False):
    """Wrist at one orientation, in plain numbers, because arrays of three elements would take ten times as long in
    every cycle.
    """

    matrix: Rows
    """Matrix from a measured wrench to the contact wrench before the offset is added, shape (6, 6)."""
    offset: tuple[float, ...]
    """Contact wrench for a measurement of 0, N and N·m, shape (6,)."""
    directions: Rows
    """Requested directions, along the tool's axes."""

    def contact_wrench(self, measured: Sequence[float]) -> Wrench:
        """Return the contact wrench at this orientation, as `Wrist.contact_wrench` does."""
        fx, fy, fz, mx, my, mz = measured
        _, _, _, (a, b, c, d, e, f), (g, h, i, j, k, m), (n, o, p, q, r, s) = self.matrix
        _, _, _, x, y, z = self.offset
        u, v, w = self.contact_force(measured)
        return (
            u,
            v,
            w,
            a * fx + b * fy + c * fz + d * mx + e * my + f * mz + x,
            g * fx + h * fy + i * fz + j * mx + k * my + m * mz + y,
            n * fx + o * fy + p * fz + q * mx + r * my + s * mz + z,
        )

    def contact_force(self, measured: Sequence[float]) -> Vector:
        """Return only the force of `contact_wrench`, N. The force does not depend on moments."""
        fx, fy, fz, _, _, _ = measured
        (a, b, c, _, _, _), (d, e, f, _, _, _), (g, h, i, _, _, _), _, _, _ = self.matrix
        x, y, z, _, _, _ = self.offset
        return a * fx + b * fy + c * fz + x, d * fx + e * fy + f * fz + y, g * fx + h * fy + i * fz + z

    def force_along(self, number: int, wrench: Sequence[float]) -> float:
        """Return the force along one of the requested directions, N, positive while the tool presses in that
        direction.
        """
        x, y, z = self.directions[number]
        return -(x * wrench[0] + y * wrench[1] + z * wrench[2])
