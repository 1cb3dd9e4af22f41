"""Which poses the arm reaches: a check of distance, not of joint ranges, whose zero positions are not public.

Source of the lengths: project specification of the computer link, section 6.
"""

import math

from emulators.robot.profile import S3Profile
from protocol.arap import Quaternion, Vector


class WorkArea:
    """The shell about axis 2 in which the wrist can be. Assumed: axis 2 stands above the base's origin."""

    def __init__(self, profile: S3Profile, tool_length: float) -> None:
        forearm = math.hypot(profile.elbow_offset_mm, profile.forearm_mm) / 1000.0
        upper_arm = profile.upper_arm_mm / 1000.0
        self._axis_2 = (0.0, 0.0, profile.axis_2_height_mm / 1000.0)
        self._farthest = upper_arm + forearm
        self._nearest = abs(upper_arm - forearm)
        self._wrist_to_tip = profile.wrist_to_flange_mm / 1000.0 + tool_length

    def holds(self, position: Vector, quaternion: Quaternion) -> bool:
        """Whether the tool centre point reaches a position in the base frame, m, in a unit orientation."""
        approach = tool_axis(quaternion)
        wrist = [p - self._wrist_to_tip * a for p, a in zip(position, approach, strict=True)]
        return self._nearest <= math.dist(wrist, self._axis_2) <= self._farthest


def tool_axis(quaternion: Quaternion) -> Vector:
    """The tool's z axis, out of the flange, in the base frame."""
    w, x, y, z = quaternion
    return 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)
