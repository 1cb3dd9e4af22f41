"""Unit of the joints in a robot's datagrams: degrees, or radians from controllers before RobotWare 6.07.01. Pure.

Source: abb_libegm took the joints for radians (commit eef43c6, RobotWare 6.0 to 6.06.01) until its commit 3e852f7. Its
README (commit 6722d8b) asks for 6.07.01 since. Its issue 42 has joints that are 57 times too large by the older one.
"""

import math
from typing import Literal, NamedTuple, TypeAlias

from protocol.devices.egm.messages import VALUES_MAX, Place, PoseMm
from protocol.endpoint import NO_TROUBLE, Trouble
from protocol.geometry import tool_axis
from protocol.kinematics import Arm

JointUnit: TypeAlias = Literal["degrees", "radians"]
_NEAR_MM, _NEAR_RAD = 10.0, math.radians(2.0)
"""Chosen: joints fit a pose where the tool's axis passes the flange by no more, and is turned by no more. An arm of
other sizes fits by chance in one of some ten thousand poses, and then only by the wrong unit.
"""
_TOOL_MM = 1000.0
"""Chosen: no tool is longer."""


class JointCheck(NamedTuple):
    """What is known of a robot's joints."""

    arm: Arm
    """Its arm without a tool."""
    unit: JointUnit
    """In which its datagrams are read."""

    def find_trouble(self, place: Place) -> Trouble:
        """Reason not to use a robot whose joints contradict its own pose by forward kinematics in the unit in which
        they are read, and fit it in the other one.

        The tool lies along the flange's axis and may have any length; of another tool or arm nothing is known.
        """
        if place.pose is None or len(place.joints_deg) != VALUES_MAX:
            return NO_TROUBLE
        other: JointUnit = "radians" if self.unit == "degrees" else "degrees"
        if self._fits(place, self.unit) or not self._fits(place, other):
            return NO_TROUBLE
        return Trouble(
            f"its joints, read in {self.unit}, contradict its own pose; they fit it in {other}",
            f'set robot.egm.joints_in to "{other}"',
        )

    def _fits(self, place: Place, unit: JointUnit) -> bool:
        pose = place.pose
        assert pose is not None, "the caller has looked"
        a, b, c, d, e, f = place.joints_deg if unit == "radians" else map(math.radians, place.joints_deg)
        return _is_ahead(self.arm, (a, b, c, d, e, f), pose)


def _is_ahead(arm: Arm, joints: tuple[float, float, float, float, float, float], pose: PoseMm) -> bool:
    """Whether a tool at the flange of these joints can have this pose."""
    if not all(map(math.isfinite, (*joints, *pose.position_mm, *pose.quaternion))):
        return False
    flange = arm.pose(joints)
    axis = tool_axis(flange.quaternion)
    away = [told - 1e3 * here for told, here in zip(pose.position_mm, flange.position, strict=True)]
    length = sum(part * along for part, along in zip(away, axis, strict=True))
    beside = math.dist(away, [length * along for along in axis])
    turned = sum(a * b for a, b in zip(axis, tool_axis(pose.quaternion), strict=True))
    return beside < _NEAR_MM and -_NEAR_MM < length < _TOOL_MM and turned > math.cos(_NEAR_RAD)
