"""Arm of six rotary joints in a chain: forward kinematics, and numerical inverse kinematics.

For arms whose wrist is not spherical; those with a spherical wrist have the closed form of `protocol.kinematics`.
Angles are in degrees, lengths in m.
"""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from emulators.seams import Floats
from protocol.arm_size import PerAxis
from protocol.geometry import (
    Pose,
    Quaternion,
    Vector,
    inverse,
    product,
    rotate,
    rotation_vector,
    turn_about,
    turn_between,
)

_NO_TURN: Quaternion = (1.0, 0.0, 0.0, 0.0)
_ITERATIONS, _FAR_ITERATIONS = 12, 60
"""Largest number of iterations near a known posture, and from a distant one. Chosen."""
_EXACT_M, _EXACT_RAD = 1e-9, 1e-9
"""Error at which a posture counts as exact. Chosen."""
_STEP_RAD = 0.4
"""Largest change of the joints in one iteration, rad. Chosen."""
_LENGTH_M = 0.3
"""Length at which an error of the orientation counts as much as one of the position, m. Chosen."""
_DAMPING = 1e-4
"""Share of the error that damps an iteration near a singularity. Chosen."""
_ROUNDING_DEG = 1e-6


class Link(NamedTuple):
    """Joint with its position in the frame of the joint before."""

    offset_mm: Vector
    axis: Vector
    """Axis of rotation with all joints at zero."""


class ArmShape(NamedTuple):
    """Dimensions of an arm, and the ranges of its joints. With all joints at zero, the frame of each joint has the
    orientation of the base frame.
    """

    links: tuple[Link, ...]
    flange_mm: Vector
    """Position of the flange in the frame of joint 6, mm."""
    flange_quaternion: Quaternion
    """Orientation of the flange with all joints at zero; its z axis points out of it."""
    lowest_deg: PerAxis
    highest_deg: PerAxis


class Chain:
    """Arm with a tool, on a base at a place."""

    def __init__(self, shape: ArmShape, tool: Pose, origin: Vector = (0.0, 0.0, 0.0)) -> None:
        """Create an arm. `tool` is the tool centre point in the frame of the flange, `origin` the position of the arm's
        base in the base frame, m.
        """
        self.tool = tool
        self._shape, self._origin = shape, origin
        self._links = [((x / 1e3, y / 1e3, z / 1e3), axis) for (x, y, z), axis in shape.links]
        x, y, z = shape.flange_mm
        self._flange: Vector = x / 1e3, y / 1e3, z / 1e3

    def pose(self, joints: PerAxis) -> Pose:
        """Return the pose of the tool in the base frame."""
        return self.frames(joints)[0]

    def flange(self, joints: PerAxis) -> Pose:
        """Return the pose of the flange in the base frame."""
        position, turned = self._origin, _NO_TURN
        for (offset, axis), angle in zip(self._links, joints, strict=True):
            position = _sum(position, rotate(turned, offset))
            turned = product(turned, turn_about(axis, math.radians(angle)))
        return Pose(
            _sum(position, rotate(turned, self._flange)), product(turned, self._shape.flange_quaternion)
        )

    def tip_of(self, flange: Pose) -> Pose:
        """Return the pose of the tool that belongs to a pose of the flange, in the same frame."""
        tip = _sum(flange.position, rotate(flange.quaternion, self.tool.position))
        return Pose(tip, product(flange.quaternion, self.tool.quaternion))

    def flange_of(self, tip: Pose) -> Pose:
        """Return the pose of the flange that belongs to a pose of the tool, in the same frame."""
        turned = product(tip.quaternion, inverse(self.tool.quaternion))
        x, y, z = rotate(turned, self.tool.position)
        return Pose(_sum(tip.position, (-x, -y, -z)), turned)

    def allows(self, joints: PerAxis) -> bool:
        """Return whether each joint is inside its range."""
        ranges = zip(self._shape.lowest_deg, joints, self._shape.highest_deg, strict=True)
        return all(low - _ROUNDING_DEG <= at <= high + _ROUNDING_DEG for low, at, high in ranges)

    def nearest(self, pose: Pose, near: PerAxis) -> PerAxis | None:
        """Return the joints that hold the tool in a pose, reached from the posture `near` without leaving it; None if
        there are none inside the ranges.
        """
        return self._solve(pose, near, _ITERATIONS)

    def holding(self, pose: Pose, seeds: Iterable[PerAxis]) -> PerAxis | None:
        """Return the joints that hold the tool in a pose, sought from several postures; of several solutions, that
        nearest to zero. None if there is none.
        """
        solutions = (self._solve(pose, seed, _FAR_ITERATIONS) for seed in seeds)
        return min((one for one in solutions if one is not None), key=_effort, default=None)

    def torques(self, joints: PerAxis, force: Vector) -> tuple[float, ...]:
        """Return the torques about the joints, N·m, of a force on the tool, N, base frame."""
        _, jacobian = self.frames(joints)
        return tuple((jacobian[:3].T @ np.array(force)).tolist())

    def rates(self, joints: PerAxis) -> Floats:
        """Return the rates of the joints (6, 6) for motions of the tool, degrees per m and per rad, base frame. Near a
        singularity they are finite.
        """
        _, jacobian = self.frames(joints)
        rates: Floats = np.degrees(np.linalg.pinv(jacobian, rcond=1e-6))
        return rates

    def frames(self, joints: PerAxis) -> tuple[Pose, Floats]:
        """Return the pose of the tool, and its Jacobian (6, 6) in m/rad and rad/rad, base frame."""
        position, turned = self._origin, _NO_TURN
        places, axes = [], []
        for (offset, axis), angle in zip(self._links, joints, strict=True):
            position = _sum(position, rotate(turned, offset))
            places.append(position)
            axes.append(rotate(turned, axis))
            turned = product(turned, turn_about(axis, math.radians(angle)))
        flange = _sum(position, rotate(turned, self._flange))
        quaternion = product(turned, self._shape.flange_quaternion)
        tip = _sum(flange, rotate(quaternion, self.tool.position))
        jacobian = np.empty((6, 6))
        for k, (place, axis) in enumerate(zip(places, axes, strict=True)):
            (x, y, z), (a, b, c) = axis, (t - p for t, p in zip(tip, place, strict=True))
            jacobian[:, k] = y * c - z * b, z * a - x * c, x * b - y * a, x, y, z
        return Pose(tip, product(quaternion, self.tool.quaternion)), jacobian

    def _solve(self, pose: Pose, near: PerAxis, iterations: int) -> PerAxis | None:
        joints = near
        for _ in range(iterations):
            at, jacobian = self.frames(joints)
            error = _error(at, pose)
            if max(map(abs, error[:3])) < _EXACT_M and max(map(abs, error[3:])) < _EXACT_RAD:
                joints = _unwrapped(joints, near)
                return joints if self.allows(joints) else None
            joints = _stepped(joints, jacobian, error)
        return None


def tool_on(flange: Pose, reported: Pose) -> Pose:
    """Return the tool whose pose is reported for this pose of the flange: its frame in that of the flange."""
    back = inverse(flange.quaternion)
    x, y, z = (r - p for r, p in zip(reported.position, flange.position, strict=True))
    return Pose(rotate(back, (x, y, z)), product(back, reported.quaternion))


def straight_tool(length: float) -> Pose:
    """Return a tool that extends along the z axis of the flange by a length, m."""
    return Pose((0.0, 0.0, length), _NO_TURN)


def _effort(joints: PerAxis) -> float:
    return sum(angle * angle for angle in joints[1:])


def _error(at: Pose, pose: Pose) -> tuple[float, ...]:
    """Return the displacement (6,) from one pose to another: m, and rotation vector, rad."""
    (x, y, z), (u, v, w) = at.position, pose.position
    return (u - x, v - y, w - z, *rotation_vector(turn_between(at.quaternion, pose.quaternion)))


def _stepped(joints: PerAxis, jacobian: Floats, error: Sequence[float]) -> PerAxis:
    """Return the joints after one damped iteration of Newton's method."""
    weights = np.array([1.0, 1.0, 1.0, _LENGTH_M, _LENGTH_M, _LENGTH_M])
    columns, goal = jacobian * weights[:, None], np.array(error) * weights
    damped = columns.T @ columns + _DAMPING * float(goal @ goal) * np.eye(6) + 1e-15 * np.eye(6)
    change = np.linalg.solve(damped, columns.T @ goal)
    most = float(np.abs(change).max())
    change *= min(1.0, _STEP_RAD / most) if most else 1.0
    a, b, c, d, e, f = (q + math.degrees(by) for q, by in zip(joints, change.tolist(), strict=True))
    return a, b, c, d, e, f


def _unwrapped(joints: PerAxis, near: PerAxis) -> PerAxis:
    """Return the angles without full turns away from `near`."""
    a, b, c, d, e, f = (q - 360.0 * round((q - n) / 360.0) for q, n in zip(joints, near, strict=True))
    return a, b, c, d, e, f


def _sum(one: Vector, other: Vector) -> Vector:
    (a, b, c), (x, y, z) = one, other
    return a + x, b + y, c + z
