"""Geometry of an emulated cell, for its picture in three dimensions: the axes of the arm, and the work piece.

Lengths are in m, in the base frame of the robot.
"""

import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from emulators.seams import ArticulatedRobot, StartPose
from emulators.surface.profile import SurfaceProfile
from hil_bridge.errors.failures import RAISED, raise_if_interrupt
from hil_bridge.settings.configuration import Config
from hil_bridge.settings.devices import robot_in
from protocol.arm_size import PerAxis
from protocol.geometry import Pose, Quaternion, Vector, inverse, product, rotation_vector, tool_axis

Box: TypeAlias = tuple[tuple[float, float], tuple[float, float]]
"""Ranges along the path and across it, m."""

_TURN_RAD = 1.0
"""Angle by which an axis is turned to determine its line, rad. Chosen."""
_CELLS = 48
"""Number of grid cells along the longer side of a work piece. Chosen: smooth, and 20 kB."""
_ITERATIONS = 30
"""Number of Newton steps from the tangent plane to a curved surface. Chosen: they converge quadratically."""
_CLOSE_M = 1e-6
"""Distance from the surface up to which a point lies on it, m. Chosen."""


class ArmAxis(Struct, frozen=True):
    """Axis of an arm whose joint angles are all 0. A positive angle turns about it by the right-hand rule."""

    point: Vector
    """Point on the axis that is closest to the point of the previous axis; for axis 1, to the base."""
    direction: Vector
    less: int = 0
    """Number of the axis whose angle this axis's angle includes, or 0."""


class Arm(Struct, frozen=True):
    """Six axes of an arm, and its tool."""

    axes: tuple[ArmAxis, ...]
    tip: Vector
    """Tool centre point with all joint angles at 0."""
    direction: Vector
    """Direction of tool z with all joint angles at 0."""


class Piece(Struct, frozen=True):
    """Work piece: heights of its surface on a grid."""

    corner: tuple[float, float]
    """Base x and y of the first height of the first row."""
    along: tuple[float, float]
    """Unit vector of the path in base x and y. Rows follow it; the heights of a row lie further and further left."""
    spacing: tuple[float, float]
    """Distance between two rows, and between two heights of a row."""
    heights: tuple[tuple[float | None, ...], ...]
    """Heights, base z. None where there is no surface."""


def arm_of(config: Config) -> Arm | None:
    """Return the arm of an emulated robot; None for a real robot, and for a robot without a model of its joints."""
    try:
        robot = _robot(config)
        return _axes_of(robot) if isinstance(robot, ArticulatedRobot) else None
    except RAISED as error:  # code of a plug-in
        raise_if_interrupt(error)
        return None


def _robot(config: Config) -> object:
    device = robot_in(config)
    if not device.is_emulated or device.kind.emulation is None:
        return None
    cell = config.cell
    x, y, z = (value * 1e-3 for value in cell.start_position_mm)
    start = StartPose((x, y, z), cell.start_quaternion, cell.tool.length_mm * 1e-3)
    return device.kind.emulation.make(device.settings)(start, 0.0, config.run.seed)


def _axes_of(robot: ArticulatedRobot) -> Arm:
    zero = robot.tool_pose_at((0.0,) * 6)
    axes: list[ArmAxis] = []
    point: Vector = (0.0, 0.0, 0.0)
    less = 0
    for number in range(6):
        moved = robot.tool_pose_at(_turned(number))
        included, less = less, 0
        if math.hypot(*_rotation(zero, moved)) < _TURN_RAD / 2.0:
            # The angle of the next axis is measured against the base, so it must turn as well.
            moved, less = robot.tool_pose_at(_turned(number, number + 1)), number + 1
        point, direction = _line(zero, moved, point)
        axes.append(ArmAxis(point, direction, included))
    return Arm(tuple(axes), zero.position, tool_axis(zero.quaternion))


def _turned(*numbers: int) -> PerAxis:
    a, b, c, d, e, f = (_TURN_RAD if number in numbers else 0.0 for number in range(6))
    return a, b, c, d, e, f


def _rotation(before: Pose, after: Pose) -> Vector:
    turn: Quaternion = product(after.quaternion, inverse(before.quaternion))
    return rotation_vector(turn)


def _line(before: Pose, after: Pose, near: Vector) -> tuple[Vector, Vector]:
    """Return the axis about which a pose was turned: its point closest to `near`, and its direction."""
    turn = np.array(_rotation(before, after))
    angle = float(np.linalg.norm(turn))
    direction = turn / angle
    start, chord = np.array(before.position), np.subtract(after.position, before.position)
    centre = start + chord / 2.0 + np.cross(direction, chord) / (2.0 * math.tan(angle / 2.0))
    point = centre + direction * np.dot(np.array(near) - centre, direction)
    return _vector(point), _vector(direction)


def _vector(values: NDArray[np.float64]) -> Vector:
    x, y, z = (round(float(value), 9) + 0.0 for value in values)
    return x, y, z


def piece_of(config: Config, places: Sequence[Sequence[float]]) -> Piece | None:
    """Return the work piece around some positions of the tool; None if the surface is unknown.

    The surface of a real cell and that of a plug-in are unknown, as is a height map whose file cannot be read.
    """
    if not robot_in(config).is_emulated or config.cell.surface_kind or not places:
        return None
    surface = config.cell.surface
    angle = math.radians(surface.path_deg)
    along = (math.cos(angle), math.sin(angle))
    try:
        return _piece(surface, along, _box(surface, along, np.array(places)))
    except ValueError:
        return None


def _box(surface: SurfaceProfile, along: tuple[float, float], places: NDArray[np.float64]) -> Box:
    """Return the displayed part of the surface: that around the positions, with a margin."""
    x, y = places[:, 0] - surface.origin_x_mm * 1e-3, places[:, 1] - surface.origin_y_mm * 1e-3
    sides = (x * along[0] + y * along[1], y * along[0] - x * along[1])
    margin = max(0.03, 0.2 * max(float(np.ptp(side)) for side in sides))
    (left, right), (near, far) = ((float(side.min()) - margin, float(side.max()) + margin) for side in sides)
    return (left, right), (near, far)


def _piece(surface: SurfaceProfile, along: tuple[float, float], box: Box) -> Piece:
    (left, right), (near, far) = box
    if surface.begin_mm is not None:
        left = max(left, surface.begin_mm * 1e-3)
    if surface.end_mm is not None:
        right = min(right, surface.end_mm * 1e-3)
    if right <= left:
        raise ValueError("the tool was never above the surface")
    step = max(right - left, far - near) / _CELLS
    counts = [max(3, round(side / step)) + 1 for side in (right - left, far - near)]
    u, v = np.linspace(left, right, counts[0]), np.linspace(near, far, counts[1])
    heights = _heights(surface, *np.meshgrid(u, v, indexing="ij"))
    x, y = surface.origin_x_mm * 1e-3, surface.origin_y_mm * 1e-3
    rows = [[None if math.isnan(one) else round(one, 6) for one in row] for row in heights.tolist()]
    return Piece(
        (x + left * along[0] - near * along[1], y + left * along[1] + near * along[0]),
        along,
        (float(u[1] - u[0]), float(v[1] - v[0])),
        tuple(map(tuple, rows)),
    )


def _heights(
    surface: SurfaceProfile, along: NDArray[np.float64], across: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the heights of the surface, m; NaN where there is none, as next to a cylinder."""
    shape, u, v = surface.shape(), along.ravel(), across.ravel()
    height = np.full_like(u, surface.height_mm * 1e-3)
    depth = np.zeros_like(u)
    for _ in range(_ITERATIONS):
        depth, (_, _, up) = shape.depth_and_normal(u, v, height)
        height = height + depth / np.maximum(up, 0.1)
    height[(np.abs(depth) > _CLOSE_M) | (height < shape.narrows_below)] = np.nan
    if surface.wall_at_mm is not None:
        height[u > surface.wall_at_mm * 1e-3] += min(surface.wall_height_mm * 1e-3, 0.1)
    return height.reshape(along.shape)
