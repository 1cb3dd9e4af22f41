"""Which targets of servoj the emulated controller refuses."""

import math

from emulators.devices.rtde.kinematics import RANGE, Arm, Joints, flange
from emulators.devices.rtde.profile import RtdeProfile
from protocol.geometry import angle_between

SUDDEN_CHANGE = "a sudden change of the target"
"""Reason of a protective stop for a leap between two targets."""


def _reach(arm: Arm) -> float:
    """A bound of how far the flange is from any axis, m."""
    return arm.d1 - arm.a2 - arm.a3 + arm.d4 + arm.d5 + arm.d6


def problem_of_target(profile: RtdeProfile, arm: Arm, old: Joints, joints: Joints) -> str:
    """Why the next servo target makes a protective stop after the last one, or the arm's joints; empty for none."""
    if not all(map(math.isfinite, joints)):
        return "a target that is no number"
    if max(map(abs, joints)) > RANGE:
        return "a target beyond the end of a joint's range"
    leaps = [abs(new - before) for new, before in zip(joints, old, strict=True)]
    turns, most_m = sum(leaps), profile.max_target_step_mm * 1e-3
    if turns <= profile.max_target_turn_rad and turns * _reach(arm) <= most_m:
        return ""  # as nearly always: not even with all turns in one direction
    before, after = flange(arm, old), flange(arm, joints)
    leap = max(leaps)
    step = math.dist(before.position, after.position)
    turn = angle_between(before.quaternion, after.quaternion)
    if step * 1e3 > profile.max_target_step_mm or max(turn, leap) > profile.max_target_turn_rad:
        return SUDDEN_CHANGE
    return ""
