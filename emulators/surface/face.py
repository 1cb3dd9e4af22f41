"""Face of a tool: a flat disc of contact points, each of which carries an equal share of the contact force."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from protocol.geometry import Quaternion

Floats: TypeAlias = NDArray[np.float64]


FACE_NEEDS_NO_MEMORY = (
    "tool.face_radius_mm must be 0 on a material with memory, which remembers one point; "
    "or choose another material"
)
"""Error message for a face and a surface that are incompatible."""


class ContactLoad(NamedTuple):
    """Force and moment on the tool at each of n times, base frame."""

    force: Floats
    """Force (n, 3) on the tool, N."""
    moment: Floats | None
    """Moment (n, 3) about the tool centre point, N·m; None if the face of the tool is a point."""


def join_loads(parts: Sequence[ContactLoad]) -> ContactLoad:
    """Concatenate the loads of all parts. There must be at least one part."""
    moments = [part.moment for part in parts if part.moment is not None]
    return ContactLoad(
        np.concatenate([part.force for part in parts]), np.concatenate(moments) if moments else None
    )


class Spread(NamedTuple):
    """Contact points at each of n times. The points of one time are consecutive."""

    positions: Floats
    """Positions (n·points, 3), base frame, m."""
    velocities: Floats
    """Velocities (n·points, 3), base frame, m/s."""
    arms: Floats
    """Vectors from the tool centre point to each contact point (3, n, points), base frame, m."""


def ring_points(radius: float, rings: int) -> Floats:
    """Return contact points (3, 1 + 3·rings·(rings + 1)) of a disc in the tool frame, m.

    They are the centre and rings of 6, 12, 18 … points around it. Each point represents an equal area and is at the
    root mean square distance of that area. A disc on springs therefore has the tilting stiffness of a continuous
    disc, except for the contribution of the central area.
    """
    count = 1 + 3 * rings * (rings + 1)
    points = [(0.0, 0.0, 0.0)]
    for ring in range(1, rings + 1):
        inner, outer = 1 + 3 * ring * (ring - 1), 1 + 3 * ring * (ring + 1)
        distance = radius * math.sqrt((inner + outer) / (2 * count))
        for k in range(6 * ring):
            # The quarter step prevents points of one ring from following the same track along tool x or y.
            angle = 2.0 * math.pi * (k + 0.25) / (6 * ring)
            points.append((distance * math.cos(angle), distance * math.sin(angle), 0.0))
    return np.array(points).T


def turn_rates(
    now: Sequence[tuple[slice, Quaternion]], before: Sequence[tuple[slice, Quaternion]], seconds: float
) -> Floats | None:
    """Return the mean angular velocity (3, n), base frame, rad/s.

    It results from the orientations at n times and `seconds` earlier. Both sequences consist of slices that cover
    the n times. The result is None if the tool did not turn.
    """
    first = now[0][1]
    if all(quaternion == first for _, quaternion in (*now, *before)):
        return None
    (w, x, y, z), (v, a, b, c) = _each(now), _each(before)
    # The shorter rotation from the earlier to the present orientation, which is their quotient.
    real = w * v + x * a + y * b + z * c
    turn = np.stack(
        (
            -w * a + x * v - y * c + z * b,
            -w * b + x * c + y * v - z * a,
            -w * c - x * b + y * a + z * v,
        )
    )
    sine = np.sqrt((turn * turn).sum(axis=0))
    angle = 2.0 * np.arctan2(sine, np.abs(real))
    rates: Floats = turn * (np.where(real < 0.0, -angle, angle) / np.where(sine > 0.0, sine, 1.0) / seconds)
    return rates


def _each(stretches: Sequence[tuple[slice, Quaternion]]) -> Floats:
    """Return the quaternion (4, n) at each of n times."""
    quaternions = np.empty((4, stretches[-1][0].stop))
    for part, quaternion in stretches:
        quaternions[:, part] = np.array(quaternion)[:, None]
    return quaternions


class Face:
    """Flat disc perpendicular to tool z, centred on the tool centre point.

    The points of the disc also move when the tool turns, which causes torsional friction.
    """

    def __init__(self, radius: float, rings: int) -> None:
        """`radius` is in m."""
        self.points = ring_points(radius, rings)
        """Contact points (3, count) relative to the tool centre point, tool frame, m."""
        self.count = self.points.shape[1]
        self.area = math.pi * radius * radius
        """Area of the disc, m²."""

    def spread(
        self,
        positions: Floats,
        velocities: Floats,
        orientations: Sequence[tuple[slice, Quaternion]],
        rotation_of: Callable[[Quaternion], Floats],
        turning: Floats | None = None,
    ) -> Spread:
        """Return the contact points for positions and velocities (n, 3) of the tool centre point.

        `orientations` are slices that cover the n times. `rotation_of` returns the matrix (3, 3) of an orientation.
        `turning` (3, n) is the angular velocity, base frame, rad/s; None if the tool does not turn.
        """
        n = len(positions)
        arms = np.empty((3, n, self.count))
        for part, quaternion in orientations:
            arms[:, part] = (rotation_of(quaternion) @ self.points)[:, None]
        points = (positions.T[:, :, None] + arms).reshape(3, -1)
        speeds = np.repeat(velocities.T, self.count, axis=1)
        if turning is not None:
            (ax, ay, az), (wx, wy, wz) = arms, turning[:, :, None]
            about = np.stack((wy * az - wz * ay, wz * ax - wx * az, wx * ay - wy * ax))
            speeds += about.reshape(3, -1)
        return Spread(points.T, speeds.T, arms)

    def gather(self, forces: Floats, arms: Floats) -> ContactLoad:
        """Return the load of forces (n·points, 3), each computed as if its point carried the entire load.

        The result is the load if each point carries an equal share.
        """
        fx, fy, fz = shared = forces.T.reshape(arms.shape) / self.count
        ax, ay, az = arms
        moment = np.stack((ay * fz - az * fy, az * fx - ax * fz, ax * fy - ay * fx))
        return ContactLoad(shared.sum(axis=2).T, moment.sum(axis=2).T)
