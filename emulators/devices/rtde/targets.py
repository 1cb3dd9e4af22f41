"""Check of servoj targets by the emulated controller."""

import math

from emulators.devices.rtde.kinematics import ARMS, RANGE, Arm, Joints, flange, reachable_start
from emulators.devices.rtde.profile import RtdeProfile
from protocol.geometry import Pose, angle_between

SUDDEN_CHANGE = "a sudden change of the target"
"""Reason of a protective stop for a jump between two targets."""


def problem_of_start(model: str, start: Pose, tool: Pose) -> str:
    """Describe why an arm cannot start at a pose with this tool, and where it can start."""
    place = reachable_start(ARMS[model], start, tool)
    x, y, z = (part * 1e3 for part in start.position)
    problem = f"a {model} cannot hold its tool at the start, {x:g}, {y:g}, {z:g} mm"
    if place is None:
        return f"{problem}; choose another start_position_mm, start_quaternion or model"
    x, y, z = (round(part * 1e3) for part in place)
    return f"{problem}; set start_position_mm = [{x}, {y}, {z}], or another model"


def _reach(arm: Arm) -> float:
    """Return an upper limit of the flange's distance from any joint axis, m."""
    return arm.d1 - arm.a2 - arm.a3 + arm.d4 + arm.d5 + arm.d6


def problem_of_target(profile: RtdeProfile, arm: Arm, old: Joints, joints: Joints) -> str:
    """Return the reason why a servo target causes a protective stop, or an empty string.

    `old` is the previous target, or the arm's joint angles.
    """
    if not all(map(math.isfinite, joints)):
        return "a target that is not a number"
    if max(map(abs, joints)) > RANGE:
        return "a target beyond the end of a joint's range"
    leaps = [abs(new - before) for new, before in zip(joints, old, strict=True)]
    turns, most_m = sum(leaps), profile.max_target_step_mm * 1e-3
    if turns <= profile.max_target_turn_rad and turns * _reach(arm) <= most_m:
        return ""  # the usual case: within the limit even if all joints turn in the same direction
    before, after = flange(arm, old), flange(arm, joints)
    leap = max(leaps)
    step = math.dist(before.position, after.position)
    turn = angle_between(before.quaternion, after.quaternion)
    if step * 1e3 > profile.max_target_step_mm or max(turn, leap) > profile.max_target_turn_rad:
        return SUDDEN_CHANGE
    return ""
