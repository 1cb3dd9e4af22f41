"""Arm of an emulated KUKA controller: its set point with corrections, its axes and its torques."""

import math

from emulators.arm.followed import FollowedArm
from emulators.devices.rsi.correction import NOTHING, TOO_FAST, AxisCorrection, Correction
from emulators.devices.rsi.profile import RsiProfile
from emulators.seams import ContactSource, Joints, StartPose
from protocol.devices.rsi.arm import KukaArm
from protocol.geometry import Pose
from protocol.kinematics import Joints as Axes

OUT_OF_REACH = "the correction leads out of the arm's reach"
"""Error text. Chosen: the text of the real controller is unknown."""
_PASSED_S = 1e-6
"""Age at which the contact force is read, s. Chosen: the path up to that time is committed."""
_ROUNDING_M = 1e-9


class CorrectedArm:
    """Arm that follows its corrections. Axes are in degrees."""

    def __init__(self, profile: RsiProfile, start: StartPose, now: float) -> None:
        """Create the arm. Raises ValueError for a start that the axes cannot hold."""
        self._arm = FollowedArm(profile.arm, Pose(start.position, start.quaternion), now)
        self.path, self.pose, self.hold = self._arm.path, self._arm.pose, self._arm.hold
        self.set_point = self._arm.set_point
        self._period = profile.period
        self.kinematics = KukaArm(profile.model, start.tool_length)
        pose = self.set_point(now)
        axes = self.kinematics.holding(pose)
        if axes is None:
            raise ValueError(
                f"no axes of the {profile.model} hold the start pose; change start_position_mm or start_quaternion "
                f"(tool at {', '.join(f'{p * 1e3:g}' for p in start.position)} mm)"
            )
        self._ordered: tuple[Pose, Axes] = pose, axes
        """Last commanded pose and its axes."""
        self._reported: tuple[Pose, Axes] = self._ordered
        """Last reported pose and its axes."""
        self._contact: ContactSource | None = None

    @property
    def ordered_pose(self) -> Pose:
        """Corrected pose, before any lag of the arm."""
        return self._ordered[0]

    def joints_holding(self, pose: Pose) -> Joints | None:
        """Return the axes of a pose, rad; None if there is no solution."""
        axes = self.kinematics.holding(pose, self._reported[1])
        return None if axes is None else tuple(map(math.radians, axes))

    def axes_of(self, pose: Pose) -> Axes:
        """Return the axes of a pose, the solution nearest to the axes reported last. Without a solution, return
        those axes.
        """
        if pose != self._reported[0]:
            axes = self.kinematics.holding(pose, self._reported[1])
            self._reported = pose, axes or self._reported[1]
        return self._reported[1]

    def feel(self, contact: ContactSource) -> None:
        """Set the source of the force at the tool."""
        self._contact = contact

    def torques(self, now: float) -> Joints | None:
        """Return the torques that the contact exerts about the axes; None if no source of the contact force is set."""
        if self._contact is None:
            return None
        return self.kinematics.torques(self._ordered[1], self._contact(now - _PASSED_S))

    def correct(self, tool: Correction, axes: AxisCorrection, limit: float, now: float) -> str:
        """Apply these corrections. They may move the tool by at most `limit`, m.

        Return the error that ends RSI, or an empty string.
        """
        before = self._ordered
        if not self._order(tool, axes):
            return OUT_OF_REACH
        if math.dist(self._ordered[0].position, before[0].position) > limit + _ROUNDING_M:
            self._ordered = before
            return TOO_FAST
        self._arm.follow(self._ordered[0], now, now - self._period)
        return ""

    def _order(self, tool: Correction, by_axes: AxisCorrection) -> bool:
        """Compute pose and axes after the corrections. Return False if there is no solution."""
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
