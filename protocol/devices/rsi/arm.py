"""Kinematics of KUKA arms, from the dimensions of each model.

On a KUKA, A1, A4 and A6 are counted against the right-hand rule. A2 is -90° with the upper arm upright, and A3 is
90° with the forearm at a right angle to the upper arm. With all wrist axes at zero and the forearm level, the
tool's x axis points down.

Observed: the dimensions, ranges, speeds and directions are from kuka_kr16_support in
ros-industrial/kuka_experimental.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from protocol.arm_size import PerAxis
from protocol.geometry import Pose, Vector
from protocol.kinematics import Arm, Joints

HOME: Joints = (0.0, -90.0, 90.0, 0.0, 90.0, 0.0)
"""Axes near which the nearest posture is chosen by default, degrees. Chosen."""
_TURNED = (-1.0, 1.0, 1.0, -1.0, 1.0, -1.0)
_AHEAD_DEG = (0.0, 90.0, -90.0, 0.0, 0.0, 180.0)
"""Offset of each angle of `Arm` from the KUKA axis, degrees, after the axis is negated where `_TURNED` is -1."""
_SMALL_DEG = 1e-4
"""Rotation of an axis with which the lever arm of a force is determined, degrees. Chosen."""

_ROUNDING_DEG = 1e-9
"""Tolerance at the ends of a range, degrees. An angle within this tolerance counts as inside."""


@dataclass(frozen=True, slots=True)
class Model:
    """Dimensions of an arm. It implements `ArmSize`."""

    axis_2_ahead_mm: float
    axis_2_height_mm: float
    upper_arm_mm: float
    elbow_offset_mm: float
    forearm_mm: float
    wrist_to_flange_mm: float
    lowest_deg: PerAxis
    highest_deg: PerAxis
    axis_speeds_deg_s: PerAxis
    axis_3_against: Literal["horizon", "upper_arm"] = "upper_arm"

    @property
    def axis_ranges_deg(self) -> PerAxis:
        a, b, c, d, e, f = (
            (high - low) / 2.0 for low, high in zip(self.lowest_deg, self.highest_deg, strict=True)
        )
        return a, b, c, d, e, f

    @property
    def axis_middles_deg(self) -> PerAxis:
        middles = ((high + low) / 2.0 for low, high in zip(self.lowest_deg, self.highest_deg, strict=True))
        a, b, c, d, e, f = (
            turned * middle + ahead
            for middle, turned, ahead in zip(middles, _TURNED, _AHEAD_DEG, strict=True)
        )
        return a, b, c, d, e, f


MODELS: Mapping[str, Model] = {
    "kr16-2": Model(
        axis_2_ahead_mm=260.0,
        axis_2_height_mm=675.0,
        upper_arm_mm=680.0,
        elbow_offset_mm=-35.0,
        forearm_mm=670.0,
        wrist_to_flange_mm=158.0,
        lowest_deg=(-185.0, -155.0, -130.0, -350.0, -130.0, -350.0),
        highest_deg=(185.0, 35.0, 154.0, 350.0, 130.0, 350.0),
        axis_speeds_deg_s=(156.0, 156.0, 156.0, 330.0, 330.0, 615.0),
    )
}
"""Known arms by name."""


class KukaArm:
    """Converter between axes in KUKA's convention, degrees, and poses of the tool."""

    def __init__(self, model: str, tool_length: float) -> None:
        """Create a converter. `tool_length` is the distance from the flange to the tool centre point, m."""
        self.model = MODELS[model]
        self._arm = Arm(self.model, tool_length, self.model.axis_2_ahead_mm / 1e3)
        self.reach = tool_length + 1e-3 * (
            self.model.axis_2_ahead_mm
            + self.model.upper_arm_mm
            + math.hypot(self.model.elbow_offset_mm, self.model.forearm_mm)
            + self.model.wrist_to_flange_mm
        )
        """Upper limit of the distance of the tool from any axis, m."""

    def pose(self, axes: Joints) -> Pose:
        """Return the pose of the tool for these axes."""
        return self._arm.pose(_from_kuka(axes))

    def holding(self, pose: Pose, near: Joints = HOME) -> Joints | None:
        """Return the axes nearest to `near` that hold the tool in a pose; None if no axes do."""
        joints = self._arm.nearest(pose.position, pose.quaternion, _from_kuka(near))
        return None if joints is None else _to_kuka(joints)

    def allows(self, axes: Joints) -> bool:
        """Return whether each axis is inside its range."""
        ranges = zip(self.model.lowest_deg, axes, self.model.highest_deg, strict=True)
        return all(low - _ROUNDING_DEG <= axis <= high + _ROUNDING_DEG for low, axis, high in ranges)

    def torques(self, axes: Joints, force: Vector) -> tuple[float, ...]:
        """Return the torque on each axis, N·m, caused by a force on the tool centre point, N, in the base frame: τ
        = Jᵀ·F.
        """
        at = self.pose(axes).position
        torques = []
        for index in range(len(axes)):
            a, b, c, d, e, f = (
                axis + (_SMALL_DEG if number == index else 0.0) for number, axis in enumerate(axes)
            )
            position = self.pose((a, b, c, d, e, f)).position
            work = sum(part * (to - was) for part, to, was in zip(force, position, at, strict=True))
            torques.append(work / math.radians(_SMALL_DEG))
        return tuple(torques)


def _from_kuka(axes: Joints) -> Joints:
    a, b, c, d, e, f = [
        math.radians(turned * axis + ahead)
        for axis, turned, ahead in zip(axes, _TURNED, _AHEAD_DEG, strict=True)
    ]
    return a, b, c, d, e, f


def _to_kuka(joints: Joints) -> Joints:
    a, b, c, d, e, f = [
        turned * (math.degrees(joint) - ahead)
        for joint, turned, ahead in zip(joints, _TURNED, _AHEAD_DEG, strict=True)
    ]
    return a, b, c, d, e, f
