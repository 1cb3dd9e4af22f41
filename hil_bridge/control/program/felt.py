"""Forces and moments in the work frame: from the own zero of a program, along the surface, and at a flat face. Pure."""

import math
from typing import NamedTuple

from msgspec import Struct

from hil_bridge.control.course.facing import inward
from hil_bridge.control.geometry.turning import moment_at
from hil_bridge.control.geometry.ways import Place
from hil_bridge.control.program.state import Felt, ProgramState
from hil_bridge.control.sample import Sample
from protocol.geometry import Vector, normalise, rotate


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
    """From the point about which contact moments are told, m."""
    radius: float = 0.0
    """Radius of a flat face, m; 0 for a tool that touches in a point."""


def lateral_of(force: Vector, fall: Place) -> float:
    """Length of the force along the surface, N."""
    a, t, b = inward(fall)
    pressed = force[0] * a + force[1] * t + force[2] * b
    return math.hypot(force[0] - pressed * a, force[1] - pressed * t, force[2] - pressed * b)


def subtract_zero(
    state: ProgramState, frame: WorkFrame, sample: Sample, force: Vector
) -> tuple[Vector, tuple[float, ...]]:
    """Force along the approach, x and y, N, and wrench of a sample from the program's zero."""
    quaternion = sample.orientation or state.home
    if quaternion is None or len(sample.wrench) != 6:
        return force, sample.wrench
    turned = rotate(normalise(quaternion), state.zero[:3])
    a, t, b = (along(turned, way) for way in (frame.approach, frame.x, frame.y))
    wrench = tuple(value - zero for value, zero in zip(sample.wrench, state.zero, strict=True))
    return (force[0] + a, force[1] + t, force[2] + b), wrench


def find_across(frame: WorkFrame, sample: Sample) -> float:
    """Contact force along y, N, of a recording that has it in the wrench alone; 0 where it is not known."""
    if sample.orientation is None or len(sample.wrench) != 6:
        return 0.0
    return -along(rotate(sample.orientation, sample.wrench[:3]), frame.y)


def measure_skew(frame: WorkFrame, face: Face, felt: Felt, per_angle: float) -> tuple[Vector, Place | None]:
    """The tool's axis, and how its face's moments say that it must tip, in the task frame."""
    orientation = felt.sample.orientation
    if orientation is None or not per_angle or len(felt.wrench) != 6:
        return (1.0, 0.0, 0.0), None
    quaternion = normalise(orientation)
    axis = rotate(quaternion, (0.0, 0.0, 1.0))
    u, v, _ = moment_at(felt.wrench, face.centre)
    # the tool yields to the moment: a turn about it by moment / stiffness tips the axis
    x, y, z = rotate(quaternion, (v / per_angle, -u / per_angle, 0.0))
    a, t, b = (along(axis, way) for way in (frame.approach, frame.x, frame.y))
    return (a, t, b), (along((x, y, z), frame.x), along((x, y, z), frame.y))


def along(vector: Vector, axis: Vector) -> float:
    return vector[0] * axis[0] + vector[1] * axis[1] + vector[2] * axis[2]
