"""Arms by model: dimensions, ranges and limits of the joints, forward and inverse kinematics.

Joints are those of Stream Motion, in degrees: J3 is measured against the upper arm. The pendant and the Remote Motion
Interface measure J3 against the horizontal, so their J3 is that of Stream Motion minus J2 (observed:
airo-ugent/airo-fanuc, docs/controller-notes.md, 1.5). The world frame of a FANUC controller has its origin on axis 1 at
the height of axis 2 (observed there, 1.10: joints and pose of one report). The z axis of the face plate points out of
it.

The inverse kinematics is numerical, because the wrist of a CRX is not spherical.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from protocol.arm_size import PerAxis
from protocol.geometry import (
    Pose,
    Quaternion,
    Vector,
    from_angles,
    inverse,
    product,
    rotate,
    rotation_vector,
    turn_about,
    turn_between,
)

Joints = PerAxis
"""Angles of the joints, degrees."""

_FLANGE: Quaternion = from_angles(0.0, -90.0, 180.0)
"""Orientation of the face plate with all joints at zero: z forward, x up."""
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


@dataclass(frozen=True, slots=True)
class Model:
    """Arm of one model."""

    links: tuple[Link, ...]
    flange_mm: Vector
    """Position of the face plate in the frame of joint 6, with all joints at zero, mm."""
    world_height_mm: float
    """Height of the world frame above the mounting face, mm."""
    lowest_deg: PerAxis
    highest_deg: PerAxis
    speeds_deg_s: PerAxis
    accelerations_deg_s2: PerAxis
    jerks_deg_s3: PerAxis
    payload_kg: float
    is_collaborative: bool

    @property
    def reach_m(self) -> float:
        """Upper limit of the distance of the face plate from axis 1 at the height of axis 2, m."""
        return (
            sum(math.hypot(*link.offset_mm) for link in self.links) / 1e3 + math.hypot(*self.flange_mm) / 1e3
        )


_AXES: tuple[Vector, ...] = (
    (0.0, 0.0, 1.0),
    (0.0, 1.0, 0.0),
    (0.0, -1.0, 0.0),
    (-1.0, 0.0, 0.0),
    (0.0, -1.0, 0.0),
    (-1.0, 0.0, 0.0),
)


def _links(*offsets: Vector) -> tuple[Link, ...]:
    return tuple(Link(offset, axis) for offset, axis in zip(offsets, _AXES, strict=True))


MODELS: Mapping[str, Model] = {
    # Dimensions, ranges, speeds: fanuc_crx_description in FANUC-CORPORATION/fanuc_description. Accelerations and jerks:
    # pendant of a simulated CRX-10iA/L, kumar-nikhil/stream_motion_interface.
    "crx-10ia/l": Model(
        _links((0, 0, 0), (0, 0, 0), (0, 0, 710), (0, 0, 0), (540, 0, 0), (0, -150, 0)),
        (160.0, 0.0, 0.0),
        245.0,
        (-179.9, -179.9, -270.0, -190.0, -179.9, -225.0),
        (179.9, 179.9, 270.0, 190.0, 179.9, 225.0),
        (120.0, 120.0, 180.0, 180.0, 180.0, 180.0),
        (265.0, 265.0, 399.0, 399.0, 399.0, 399.0),
        (1240.0, 1240.0, 1860.0, 1860.0, 1860.0, 1860.0),
        10.0,
        True,
    ),
    # Dimensions, ranges, speeds: fanuc_m10ia_support in ros-industrial/fanuc. Assumed: accelerations and jerks in the
    # same proportion to the speeds as those of the CRX.
    "m-10ia": Model(
        _links((0, 0, 0), (150, 0, 0), (0, 0, 600), (0, 0, 200), (640, 0, 0), (0, 0, 0)),
        (100.0, 0.0, 0.0),
        450.0,
        (-180.0, -90.0, -180.0, -190.0, -190.0, -360.0),
        (180.0, 160.0, 264.0, 190.0, 190.0, 360.0),
        (210.0, 190.0, 210.0, 400.0, 400.0, 600.0),
        (464.0, 420.0, 464.0, 884.0, 884.0, 1326.0),
        (2170.0, 1965.0, 2170.0, 4130.0, 4130.0, 6200.0),
        10.0,
        False,
    ),
}
"""Known arms by name."""
_ELBOWS = (0.0, 0.0), (30.0, -20.0), (45.0, -60.0), (-20.0, 20.0), (60.0, -10.0), (-45.0, -30.0)
_WRISTS = (0.0, -90.0, 0.0), (0.0, -45.0, 0.0), (90.0, -60.0, -90.0), (-90.0, -60.0, 90.0), (0.0, 60.0, 0.0)
"""Angles of joints 2 and 3 and of joints 4 to 6 from which a posture is sought. Chosen."""


class FanucArm:
    """Arm with a tool, in a base frame with its origin on the mounting face or wherever `world_height_mm` says."""

    def __init__(self, model: str, tool: Pose, world_height_mm: float | None = None) -> None:
        """Create an arm. `tool` is the tool centre point in the frame of the face plate. `world_height_mm` is the
        height of the world frame in the base frame; None for that of the model above its mounting face.
        """
        self.model = MODELS[model]
        self.tool = tool
        self._links = [((x / 1e3, y / 1e3, z / 1e3), axis) for (x, y, z), axis in self.model.links]
        x, y, z = self.model.flange_mm
        self._flange: Vector = x / 1e3, y / 1e3, z / 1e3
        height = self.model.world_height_mm if world_height_mm is None else world_height_mm
        self._origin: Vector = 0.0, 0.0, height / 1e3

    def pose(self, joints: Joints) -> Pose:
        """Return the pose of the tool in the base frame."""
        return self._frames(joints)[0]

    def face_plate(self, joints: Joints) -> Pose:
        """Return the pose of the face plate in the world frame."""
        (x, y, z), quaternion = self._flange_frame(joints)
        return Pose((x, y, z - self._origin[2]), quaternion)

    def tip_of(self, plate: Pose) -> Pose:
        """Return the pose of the tool that belongs to a pose of the face plate, in the same frame."""
        tip = _sum(plate.position, rotate(plate.quaternion, self.tool.position))
        return Pose(tip, product(plate.quaternion, self.tool.quaternion))

    def plate_of(self, tip: Pose) -> Pose:
        """Return the pose of the face plate that belongs to a pose of the tool, in the same frame."""
        turned = product(tip.quaternion, inverse(self.tool.quaternion))
        x, y, z = rotate(turned, self.tool.position)
        return Pose(_sum(tip.position, (-x, -y, -z)), turned)

    def in_world(self, pose: Pose) -> Pose:
        """Convert a pose from the base frame to the world frame."""
        x, y, z = pose.position
        return Pose((x, y, z - self._origin[2]), pose.quaternion)

    def in_base(self, pose: Pose) -> Pose:
        """Convert a pose from the world frame to the base frame."""
        x, y, z = pose.position
        return Pose((x, y, z + self._origin[2]), pose.quaternion)

    def allows(self, joints: Joints) -> bool:
        """Return whether each joint is inside its range."""
        ranges = zip(self.model.lowest_deg, joints, self.model.highest_deg, strict=True)
        return all(low - _ROUNDING_DEG <= at <= high + _ROUNDING_DEG for low, at, high in ranges)

    def nearest(self, pose: Pose, near: Joints) -> Joints | None:
        """Return the joints that hold the tool in a pose, reached from the posture `near` without leaving it; None if
        there are none inside the ranges.
        """
        return self._solve(pose, near, _ITERATIONS)

    def holding(self, pose: Pose) -> Joints | None:
        """Return the joints that hold the tool in a pose, in the posture nearest to zero; None if none do."""
        solutions = (self._solve(pose, seed, _FAR_ITERATIONS) for seed in _seeds(pose))
        return min((one for one in solutions if one is not None), key=_effort, default=None)

    def torques(self, joints: Joints, force: Vector) -> tuple[float, ...]:
        """Return the torques about the joints, N·m, of a force on the tool, N, base frame."""
        _, jacobian = self._frames(joints)
        return tuple((jacobian[:3].T @ np.array(force)).tolist())

    def rates(self, joints: Joints) -> np.ndarray:
        """Return the rates of the joints (6, 6) for motions of the tool, degrees per m and per rad, base frame. Near a
        singularity they are finite.
        """
        _, jacobian = self._frames(joints)
        rates: np.ndarray = np.degrees(np.linalg.pinv(jacobian, rcond=1e-6))
        return rates

    def _solve(self, pose: Pose, near: Joints, iterations: int) -> Joints | None:
        joints = near
        for _ in range(iterations):
            at, jacobian = self._frames(joints)
            error = _error(at, pose)
            if max(map(abs, error[:3])) < _EXACT_M and max(map(abs, error[3:])) < _EXACT_RAD:
                joints = _unwrapped(joints, near)
                return joints if self.allows(joints) else None
            joints = _stepped(joints, jacobian, error)
        return None

    def _flange_frame(self, joints: Joints) -> Pose:
        """Return the pose of the face plate in the base frame."""
        position, turned = self._origin, (1.0, 0.0, 0.0, 0.0)
        for (offset, axis), angle in zip(self._links, joints, strict=True):
            position = _sum(position, rotate(turned, offset))
            turned = product(turned, turn_about(axis, math.radians(angle)))
        return Pose(_sum(position, rotate(turned, self._flange)), product(turned, _FLANGE))

    def _frames(self, joints: Joints) -> tuple[Pose, np.ndarray]:
        """Return the pose of the tool, and its Jacobian (6, 6) in m/rad and rad/rad, base frame."""
        position, turned = self._origin, (1.0, 0.0, 0.0, 0.0)
        places, axes = [], []
        for (offset, axis), angle in zip(self._links, joints, strict=True):
            position = _sum(position, rotate(turned, offset))
            places.append(position)
            axes.append(rotate(turned, axis))
            turned = product(turned, turn_about(axis, math.radians(angle)))
        flange, quaternion = _sum(position, rotate(turned, self._flange)), product(turned, _FLANGE)
        tip = _sum(flange, rotate(quaternion, self.tool.position))
        jacobian = np.empty((6, 6))
        for k, (place, axis) in enumerate(zip(places, axes, strict=True)):
            (x, y, z), (a, b, c) = axis, (t - p for t, p in zip(tip, place, strict=True))
            jacobian[:, k] = y * c - z * b, z * a - x * c, x * b - y * a, x, y, z
        return Pose(tip, product(quaternion, self.tool.quaternion)), jacobian


def tool_of(arm: FanucArm, joints: Joints, reported: Pose) -> Pose:
    """Return the tool with which a controller reports this pose, world frame, at these joints: its frame in that of the
    face plate.
    """
    plate = arm.face_plate(joints)
    back = inverse(plate.quaternion)
    x, y, z = (r - p for r, p in zip(reported.position, plate.position, strict=True))
    return Pose(rotate(back, (x, y, z)), product(back, reported.quaternion))


def straight_tool(length: float) -> Pose:
    """Return a tool that extends along the z axis of the face plate by a length, m."""
    return Pose((0.0, 0.0, length), (1.0, 0.0, 0.0, 0.0))


def to_pendant(joints: Joints) -> Joints:
    """Convert joints of Stream Motion to those of the pendant and of the Remote Motion Interface."""
    a, b, c, d, e, f = joints
    return a, b, c - b, d, e, f


def from_pendant(joints: Joints) -> Joints:
    """Convert joints of the pendant and of the Remote Motion Interface to those of Stream Motion."""
    a, b, c, d, e, f = joints
    return a, b, c + b, d, e, f


def _seeds(pose: Pose) -> Iterator[Joints]:
    x, y, _ = pose.position
    ahead = math.degrees(math.atan2(y, x))
    for lean, bend in _ELBOWS:
        for a, b, c in _WRISTS:
            yield ahead, lean, bend, a, b, c


def _effort(joints: Joints) -> float:
    return sum(angle * angle for angle in joints[1:])


def _error(at: Pose, pose: Pose) -> tuple[float, ...]:
    """Return the displacement (6,) from one pose to another: m, and rotation vector, rad."""
    (x, y, z), (u, v, w) = at.position, pose.position
    return (u - x, v - y, w - z, *rotation_vector(turn_between(at.quaternion, pose.quaternion)))


def _stepped(joints: Joints, jacobian: np.ndarray, error: tuple[float, ...]) -> Joints:
    """Return the joints after one damped iteration of Newton's method."""
    weights = np.array([1.0, 1.0, 1.0, _LENGTH_M, _LENGTH_M, _LENGTH_M])
    columns, goal = jacobian * weights[:, None], np.array(error) * weights
    damped = columns.T @ columns + _DAMPING * float(goal @ goal) * np.eye(6) + 1e-15 * np.eye(6)
    change = np.linalg.solve(damped, columns.T @ goal)
    most = float(np.abs(change).max())
    change *= min(1.0, _STEP_RAD / most) if most else 1.0
    a, b, c, d, e, f = (q + math.degrees(by) for q, by in zip(joints, change.tolist(), strict=True))
    return a, b, c, d, e, f


def _unwrapped(joints: Joints, near: Joints) -> Joints:
    """Return the angles without full turns away from `near`."""
    a, b, c, d, e, f = (q - 360.0 * round((q - n) / 360.0) for q, n in zip(joints, near, strict=True))
    return a, b, c, d, e, f


def _sum(one: Vector, other: Vector) -> Vector:
    (a, b, c), (x, y, z) = one, other
    return a + x, b + y, c + z
