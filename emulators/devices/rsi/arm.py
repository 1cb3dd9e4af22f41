"""The arm of an emulated KUKA controller: its set point as corrections move it, the axes that hold it, its torques."""

import math

from emulators.arm.followed import FollowedArm
from emulators.devices.rsi.correction import NOTHING, TOO_FAST, AxisCorrection, Correction
from emulators.devices.rsi.profile import RsiProfile
from emulators.seams import ContactSource, Joints, StartPose
from protocol.devices.rsi.arm import KukaArm
from protocol.geometry import Pose
from protocol.kinematics import Joints as Axes

OUT_OF_REACH = "the correction leads out of the reach of the arm's axes"
"""Chosen: words of its own, for those of the controller are not known."""
_PASSED_S = 1e-6
"""Chosen: how long ago the moment of a look at the contact is, so that the path up to it is settled."""
_ROUNDING_M = 1e-9


class CorrectedArm:
    """An arm that goes where its corrections lead. Axes are in degrees."""

    def __init__(self, profile: RsiProfile, start: StartPose, now: float) -> None:
        """Raise ValueError for a start that the axes cannot hold."""
        self._arm = FollowedArm(profile.arm, Pose(start.position, start.quaternion), now)
        self.path, self.pose, self.hold = self._arm.path, self._arm.pose, self._arm.hold
        self.set_point = self._arm.set_point
        self.kinematics = KukaArm(profile.model, start.tool_length)
        pose = self.set_point(now)
        axes = self.kinematics.holding(pose)
        if axes is None:
            raise ValueError(
                f"no axes of the {profile.model} hold the start pose; change start_position_mm or start_quaternion "
                f"(tool at {', '.join(f'{p * 1e3:g}' for p in start.position)} mm)"
            )
        self._ordered: tuple[Pose, Axes] = pose, axes
        """Pose that was ordered last, and its axes."""
        self._reported: tuple[Pose, Axes] = self._ordered
        """Pose that was reported last, and its axes."""
        self._contact: ContactSource | None = None

    @property
    def ordered_pose(self) -> Pose:
        """The pose that the corrections make, before any lag of the arm."""
        return self._ordered[0]

    def joints_holding(self, pose: Pose) -> Joints | None:
        """Return the axes of a pose, rad; None if none hold it."""
        axes = self.kinematics.holding(pose, self._reported[1])
        return None if axes is None else tuple(map(math.radians, axes))

    def axes_of(self, pose: Pose) -> Axes:
        """Return the axes of a pose, next to those reported last; those themselves if no axes hold it."""
        if pose != self._reported[0]:
            axes = self.kinematics.holding(pose, self._reported[1])
            self._reported = pose, axes or self._reported[1]
        return self._reported[1]

    def feel(self, contact: ContactSource) -> None:
        """Set the source of the force at the tool."""
        self._contact = contact

    def torques(self, now: float) -> Joints | None:
        """Torques of the contact about the axes; None without a source of its force."""
        if self._contact is None:
            return None
        return self.kinematics.torques(self._ordered[1], self._contact(now - _PASSED_S))

    def correct(self, tool: Correction, axes: AxisCorrection, limit: float, now: float) -> str:
        """Move by these corrections, the tool by at most `limit`, m. The error that ends RSI, or an empty string."""
        before = self._ordered
        if not self._order(tool, axes):
            return OUT_OF_REACH
        if math.dist(self._ordered[0].position, before[0].position) > limit + _ROUNDING_M:
            self._ordered = before
            return TOO_FAST
        self._arm.follow(self._ordered[0], now)
        return ""

    def _order(self, tool: Correction, by_axes: AxisCorrection) -> bool:
        """Work out pose and axes of the corrections; False where the axes cannot hold them."""
        pose = tool.pose
        if by_axes.total != NOTHING:
            joints = by_axes.joints
            if not self.kinematics.allows(joints):
                return False
            pose = self.kinematics.pose(joints)
            if tool.total != NOTHING:
                pose = tool.applied_to(pose)
        if pose != self._ordered[0]:
            axes = self.kinematics.holding(pose, self._ordered[1])
            if axes is None:
                return False
            self._ordered = pose, axes
        return True
