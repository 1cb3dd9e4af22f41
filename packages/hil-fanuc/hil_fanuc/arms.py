"""Arms by model: dimensions, ranges and limits of the joints, forward and inverse kinematics.

Joints are those of Stream Motion, in degrees: J3 is measured against the upper arm. The pendant and the Remote Motion
Interface measure J3 against the horizontal, so their J3 is that of Stream Motion minus J2 (observed:
airo-ugent/airo-fanuc, docs/controller-notes.md, 1.5). The world frame of a FANUC controller has its origin on axis 1 at
the height of axis 2 (observed there, 1.10: joints and pose of one report). The z axis of the face plate points out of
it.

The inverse kinematics is numerical (`emulators.arm.chain`), because the wrist of a CRX is not spherical.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from emulators.arm.chain import ArmShape, Chain, Link
from protocol.arm_size import PerAxis
from protocol.geometry import Pose, Quaternion, Vector, from_angles

Joints = PerAxis
"""Angles of the joints, degrees."""

_FLANGE: Quaternion = from_angles(0.0, -90.0, 180.0)
"""Orientation of the face plate with all joints at zero: z forward, x up."""


@dataclass(frozen=True, slots=True)
class Model:
    """Arm of one model."""

    shape: ArmShape
    world_height_mm: float
    """Height of the world frame above the mounting face, mm."""
    speeds_deg_s: PerAxis
    accelerations_deg_s2: PerAxis
    jerks_deg_s3: PerAxis
    payload_kg: float
    is_collaborative: bool


_AXES: tuple[Vector, ...] = (
    (0.0, 0.0, 1.0),
    (0.0, 1.0, 0.0),
    (0.0, -1.0, 0.0),
    (-1.0, 0.0, 0.0),
    (0.0, -1.0, 0.0),
    (-1.0, 0.0, 0.0),
)


def _shape(
    offsets: tuple[Vector, ...], plate_mm: Vector, lowest_deg: PerAxis, highest_deg: PerAxis
) -> ArmShape:
    links = tuple(Link(offset, axis) for offset, axis in zip(offsets, _AXES, strict=True))
    return ArmShape(links, plate_mm, _FLANGE, lowest_deg, highest_deg)


MODELS: Mapping[str, Model] = {
    # Dimensions, ranges, speeds: fanuc_crx_description in FANUC-CORPORATION/fanuc_description. Accelerations and jerks:
    # pendant of a simulated CRX-10iA/L, kumar-nikhil/stream_motion_interface.
    "crx-10ia/l": Model(
        _shape(
            ((0, 0, 0), (0, 0, 0), (0, 0, 710), (0, 0, 0), (540, 0, 0), (0, -150, 0)),
            (160.0, 0.0, 0.0),
            (-179.9, -179.9, -270.0, -190.0, -179.9, -225.0),
            (179.9, 179.9, 270.0, 190.0, 179.9, 225.0),
        ),
        245.0,
        (120.0, 120.0, 180.0, 180.0, 180.0, 180.0),
        (265.0, 265.0, 399.0, 399.0, 399.0, 399.0),
        (1240.0, 1240.0, 1860.0, 1860.0, 1860.0, 1860.0),
        10.0,
        True,
    ),
    # Dimensions, ranges, speeds: fanuc_m10ia_support in ros-industrial/fanuc. Assumed: accelerations and jerks in the
    # same proportion to the speeds as those of the CRX.
    "m-10ia": Model(
        _shape(
            ((0, 0, 0), (150, 0, 0), (0, 0, 600), (0, 0, 200), (640, 0, 0), (0, 0, 0)),
            (100.0, 0.0, 0.0),
            (-180.0, -90.0, -180.0, -190.0, -190.0, -360.0),
            (180.0, 160.0, 264.0, 190.0, 190.0, 360.0),
        ),
        450.0,
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


class FanucArm(Chain):
    """Arm with a tool, in a base frame with its origin on the mounting face or wherever `world_height_mm` says."""

    def __init__(self, model: str, tool: Pose, world_height_mm: float | None = None) -> None:
        """Create an arm. `tool` is the tool centre point in the frame of the face plate. `world_height_mm` is the
        height of the world frame in the base frame; None for that of the model above its mounting face.
        """
        self.model = MODELS[model]
        height = self.model.world_height_mm if world_height_mm is None else world_height_mm
        self._height = height / 1e3
        super().__init__(self.model.shape, tool, (0.0, 0.0, self._height))

    def face_plate(self, joints: Joints) -> Pose:
        """Return the pose of the face plate in the world frame."""
        return self.in_world(self.flange(joints))

    def in_world(self, pose: Pose) -> Pose:
        """Convert a pose from the base frame to the world frame."""
        x, y, z = pose.position
        return Pose((x, y, z - self._height), pose.quaternion)

    def in_base(self, pose: Pose) -> Pose:
        """Convert a pose from the world frame to the base frame."""
        x, y, z = pose.position
        return Pose((x, y, z + self._height), pose.quaternion)

    def at_rest(self, pose: Pose) -> Joints | None:
        """Return the joints that hold the tool in a pose, in the posture nearest to zero; None if none do."""
        return self.holding(pose, _seeds(pose))


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
