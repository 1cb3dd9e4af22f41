"""Checks of the tool's orientation: limits of its angular speed and of the tilt of its axis. Pure."""

import math

from hil_bridge.control.course.limits import Limits
from hil_bridge.control.geometry.turning import rotate_towards
from hil_bridge.errors.causes import Cause, Reason
from protocol.geometry import Quaternion, angle_between, angle_of_vectors, tool_axis

_FOLLOWS_S = 0.5
"""Time limit for a robot to follow an orientation order, s. Chosen: two cycles of the slowest link, plus the servo
lag.
"""
_ROUNDING = 1e-9
"""Tolerance for rounding errors, rad."""


def limit_turn(
    limits: Limits, home: Quaternion, before: Quaternion, target: Quaternion, dt: float
) -> tuple[Quaternion, tuple[Reason, ...]]:
    """Return the limited orientation, and the reason if it differs from the desired one. The previous order was
    `dt` seconds earlier.

    `home` is the orientation at the start, from which the tilt is measured.
    """
    reasons: tuple[Reason, ...] = ()
    allowed, most = target, math.radians(limits.turn_deg_s) * dt
    if angle_between(before, target) > most + _ROUNDING:
        allowed = rotate_towards(before, target, most)
        reasons = (Reason(Cause.TURN, f"turned faster than {limits.turn_deg_s:g}°/s"),)
    if tilt(home, allowed) > max(math.radians(limits.turn_total_deg), tilt(home, before)) + _ROUNDING:
        return before, (Reason(Cause.TIP, f"tilted by more than {limits.turn_total_deg:g}°"),)
    return allowed, reasons


def tilt(a: Quaternion, b: Quaternion) -> float:
    """Return the angle between the tool's axes at two orientations, rad. A rotation about the axis itself does not
    count.
    """
    return angle_of_vectors(tool_axis(a), tool_axis(b))


def behind(lag: float, turned: float, dt: float) -> float:
    """Return the rotation that the robot may still have to follow, rad: the sum of recent orders with decaying
    weights.
    """
    return lag * math.exp(-dt / _FOLLOWS_S) + turned
