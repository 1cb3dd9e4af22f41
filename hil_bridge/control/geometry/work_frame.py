"""Work frame, with its axes in the base frame, and the end face of the tool."""

from typing import NamedTuple

from msgspec import Struct

from protocol.geometry import Vector


class WorkFrame(Struct, frozen=True):
    """Work frame: its axes as unit vectors in the base frame, and its origin."""

    approach: Vector
    """Direction into the surface, opposite to the frame's z axis."""
    x: Vector
    """Travel direction."""
    y: Vector
    origin: Vector | None = None
    """Origin in the base frame, m; None to use the start point."""
    plane: Vector | None = None
    """Point on the plane from which the safe height is measured, base frame, m; None for the start point."""


class Face(NamedTuple):
    """End face of the tool, in the tool frame."""

    centre: Vector = (0.0, 0.0, 0.0)
    """Centre of the face relative to the reference point of the contact moments, m."""
    radius: float = 0.0
    """Radius of a flat face, m; 0 for a tool with a point contact."""


def along(vector: Vector, axis: Vector) -> float:
    """Return the component of a vector along a unit vector."""
    return vector[0] * axis[0] + vector[1] * axis[1] + vector[2] * axis[2]
