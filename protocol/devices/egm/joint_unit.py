"""Unit of the joints in a robot's datagrams: degrees, or radians from controllers before RobotWare 6.07.01.

Source: abb_libegm interpreted the joints as radians (commit eef43c6, RobotWare 6.0 to 6.06.01) until its commit
3e852f7. Its README (commit 6722d8b) has required 6.07.01 ever since. Its issue 42 shows joints that are 57 times
too large with an older controller.
"""

import math
from typing import Literal, NamedTuple, TypeAlias

from protocol.devices.egm.messages import VALUES_MAX, Place, PoseMm
from protocol.endpoint import NO_TROUBLE, Trouble
from protocol.geometry import tool_axis
from protocol.kinematics import Arm

JointUnit: TypeAlias = Literal["degrees", "radians"]
_NEAR_MM, _NEAR_RAD = 10.0, math.radians(2.0)
"""Limits within which joints fit a pose: distance of the flange from the tool's axis, mm, and tilt of that axis,
rad. Chosen. An arm of other dimensions fits by chance in about one of ten thousand poses, and then only with the
wrong unit.
"""
_TOOL_MM = 1000.0
"""Maximum length of a tool, mm. Chosen."""


class JointCheck(NamedTuple):
    """Check of a robot's joints against its pose, with the arm and the unit to use."""

    arm: Arm
    """Kinematics of the arm without a tool."""
    unit: JointUnit
    """Unit in which the joints in the robot's datagrams are interpreted."""

    def find_trouble(self, place: Place) -> Trouble:
        """Return the reason to reject a robot whose joints contradict its own pose in the configured unit and fit
        it in the other unit.

        The joints are compared by forward kinematics. The tool is assumed to lie along the flange's axis and may
        have any length up to `_TOOL_MM`. For any other tool or arm, nothing can be concluded.
        """
        if place.pose is None or len(place.joints_deg) != VALUES_MAX:
            return NO_TROUBLE
        other: JointUnit = "radians" if self.unit == "degrees" else "degrees"
        if self._fits(place, self.unit) or not self._fits(place, other):
            return NO_TROUBLE
        return Trouble(
            f"its joints, read in {self.unit}, contradict its own pose; they match it in {other}",
            f'set robot.egm.joints_in to "{other}"',
        )

    def _fits(self, place: Place, unit: JointUnit) -> bool:
        pose = place.pose
        assert pose is not None, "checked by the caller"
        a, b, c, d, e, f = place.joints_deg if unit == "radians" else map(math.radians, place.joints_deg)
        return _is_ahead(self.arm, (a, b, c, d, e, f), pose)


def _is_ahead(arm: Arm, joints: tuple[float, float, float, float, float, float], pose: PoseMm) -> bool:
    """Return whether a tool on the flange can have this pose, given the joints."""
    if not all(map(math.isfinite, (*joints, *pose.position_mm, *pose.quaternion))):
        return False
    flange = arm.pose(joints)
    axis = tool_axis(flange.quaternion)
    away = [tool - 1e3 * here for tool, here in zip(pose.position_mm, flange.position, strict=True)]
    length = sum(part * along for part, along in zip(away, axis, strict=True))
    lateral = math.dist(away, [length * along for along in axis])
    turned = sum(a * b for a, b in zip(axis, tool_axis(pose.quaternion), strict=True))
    return lateral < _NEAR_MM and -_NEAR_MM < length < _TOOL_MM and turned > math.cos(_NEAR_RAD)
