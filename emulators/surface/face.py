"""The face of a tool: a flat disc of contact points, each of which bears its share of what the surface pushes."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from protocol.geometry import Quaternion

Floats: TypeAlias = NDArray[np.float64]


ONE_POINT_REMEMBERED = (
    "tool.face_radius_mm must be 0 on a material with memory, which remembers one point; "
    "or choose another material"
)
"""Why a face and a surface do not go together."""


class Pushed(NamedTuple):
    """Force and moment on the tool at each moment, base frame."""

    force: Floats
    """(n, 3), N."""
    moment: Floats | None
    """(n, 3), N·m, about the tool centre point; None for a tool whose face is a point."""


def joined(parts: Sequence[Pushed]) -> Pushed:
    """Force and moment at the moments of all parts, one after the other; at least one."""
    moments = [part.moment for part in parts if part.moment is not None]
    return Pushed(
        np.concatenate([part.force for part in parts]), np.concatenate(moments) if moments else None
    )


class Spread(NamedTuple):
    """The contact points at each moment; those of a moment follow each other."""

    positions: Floats
    """(n·points, 3), base frame, m."""
    velocities: Floats
    """(n·points, 3), base frame, m/s."""
    arms: Floats
    """From the tool centre point to each contact point, (3, n, points), base frame, m."""


def ring_points(radius: float, rings: int) -> Floats:
    """Points (3, 1 + 3·rings·(rings + 1)) of a disc in the tool frame, m: a middle, and rings of 6, 12, 18 … about it.

    Each stands for the same area, and lies at its root mean square distance: so a disc on springs is as stiff against
    tilting as one of the same area throughout, but for the middle's own part.
    """
    count = 1 + 3 * rings * (rings + 1)
    points = [(0.0, 0.0, 0.0)]
    for ring in range(1, rings + 1):
        inner, outer = 1 + 3 * ring * (ring - 1), 1 + 3 * ring * (ring + 1)
        distance = radius * math.sqrt((inner + outer) / (2 * count))
        for k in range(6 * ring):
            # A quarter of a step keeps points of one ring from following each other's track along tool x or y.
            angle = 2.0 * math.pi * (k + 0.25) / (6 * ring)
            points.append((distance * math.cos(angle), distance * math.sin(angle), 0.0))
    return np.array(points).T


def turning_of(
    now: Sequence[tuple[slice, Quaternion]], before: Sequence[tuple[slice, Quaternion]], seconds: float
) -> Floats | None:
    """Mean angular velocity (3, n), base frame, rad/s, between the orientations at n moments and those so long before;
    None where nothing turned. Both are stretches that cover the moments.
    """
    first = now[0][1]
    if all(quaternion == first for _, quaternion in (*now, *before)):
        return None
    (w, x, y, z), (v, a, b, c) = _each(now), _each(before)
    # The turn from the one before to the one now: their quotient, taken the short way round.
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
    found: Floats = turn * (np.where(real < 0.0, -angle, angle) / np.where(sine > 0.0, sine, 1.0) / seconds)
    return found


def _each(stretches: Sequence[tuple[slice, Quaternion]]) -> Floats:
    """Quaternion (4, n) of each moment."""
    found = np.empty((4, stretches[-1][0].stop))
    for part, quaternion in stretches:
        found[:, part] = np.array(quaternion)[:, None]
    return found


class Face:
    """A flat disc perpendicular to tool z, centred on the tool centre point.

    Its points move with the tool's turning too, so there is torsional friction.
    """

    def __init__(self, radius: float, rings: int) -> None:
        """`radius` in m."""
        self.points = ring_points(radius, rings)
        """Contact points (3, count), tool frame from the tool centre point, m."""
        self.count = self.points.shape[1]
        self.area = math.pi * radius * radius
        """m²"""

    def spread(
        self,
        positions: Floats,
        velocities: Floats,
        orientations: Sequence[tuple[slice, Quaternion]],
        rotation_of: Callable[[Quaternion], Floats],
        turning: Floats | None = None,
    ) -> Spread:
        """Return the contact points for positions and velocities (n, 3) of the tool centre point.

        `orientations` are stretches that cover the n moments; `rotation_of` gives the matrix (3, 3) of one. `turning`
        (3, n) is the angular velocity, base frame, rad/s; None for none.
        """
        n = len(positions)
        arms = np.empty((3, n, self.count))
        for part, quaternion in orientations:
            arms[:, part] = (rotation_of(quaternion) @ self.points)[:, None]
        places = (positions.T[:, :, None] + arms).reshape(3, -1)
        speeds = np.repeat(velocities.T, self.count, axis=1)
        if turning is not None:
            (ax, ay, az), (wx, wy, wz) = arms, turning[:, :, None]
            about = np.stack((wy * az - wz * ay, wz * ax - wx * az, wx * ay - wy * ax))
            speeds += about.reshape(3, -1)
        return Spread(places.T, speeds.T, arms)

    def gathered(self, forces: Floats, arms: Floats) -> Pushed:
        """Return the sum of forces (n·points, 3), each as if its point bore all; each bears the same share."""
        fx, fy, fz = shared = forces.T.reshape(arms.shape) / self.count
        ax, ay, az = arms
        moment = np.stack((ay * fz - az * fy, az * fx - ax * fz, ax * fy - ay * fx))
        return Pushed(shared.sum(axis=2).T, moment.sum(axis=2).T)
