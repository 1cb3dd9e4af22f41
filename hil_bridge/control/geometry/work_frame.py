"""The work frame: axes in the base frame, and the face of the tool."""

from typing import NamedTuple

from msgspec import Struct

from protocol.geometry import Vector


class WorkFrame(Struct, frozen=True):
    """Axes of the work frame in the base frame, unit vectors, and its origin."""

    approach: Vector
    """Into the surface: against the frame's z axis."""
    x: Vector
    """The travel direction."""
    y: Vector
    origin: Vector | None = None
    """Base frame, m; None for the start point."""
    plane: Vector | None = None
    """A point of the plane from which the safe height counts, base frame, m; None for the start point."""


class Face(NamedTuple):
    """The tool's end, in the tool frame."""

    centre: Vector = (0.0, 0.0, 0.0)
    """From the point about which contact moments are given, m."""
    radius: float = 0.0
    """Radius of a flat face, m; 0 for a tool that touches in a point."""


def along(vector: Vector, axis: Vector) -> float:
    """Component of a vector along a unit vector."""
    return vector[0] * axis[0] + vector[1] * axis[1] + vector[2] * axis[2]
