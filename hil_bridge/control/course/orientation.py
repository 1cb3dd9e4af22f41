"""The guard over the tool's orientation: how fast it may be turned, and how far its axis may tip. Pure."""

import math

from hil_bridge.control.course.limits import Limits
from hil_bridge.control.geometry.turning import brought
from hil_bridge.errors.causes import Cause, Reason
from protocol.geometry import Quaternion, angle_between, angle_of_vectors, tool_axis

_FOLLOWS_S = 0.5
"""Chosen: time within which a robot follows an order to turn: two cycles of the slowest line, and the servo."""
_ROUNDING = 1e-9
"""Slack for arithmetic, rad."""


def limit_turn(
    limits: Limits, home: Quaternion, before: Quaternion, wanted: Quaternion, dt: float
) -> tuple[Quaternion, tuple[Reason, ...]]:
    """Limit the orientation ordered `dt` seconds after the one before, and say why it is not the desired one.

    `home` is the orientation of the start, from which the tilt counts.
    """
    reasons: tuple[Reason, ...] = ()
    given, most = wanted, math.radians(limits.turn_deg_s) * dt
    if angle_between(before, wanted) > most + _ROUNDING:
        given = brought(before, wanted, most)
        reasons = (Reason(Cause.TURN, f"turned faster than {limits.turn_deg_s:g}°/s"),)
    if tilt(home, given) > max(math.radians(limits.turn_total_deg), tilt(home, before)) + _ROUNDING:
        return before, (Reason(Cause.TIP, f"tilted by more than {limits.turn_total_deg:g}°"),)
    return given, reasons


def tilt(a: Quaternion, b: Quaternion) -> float:
    """Angle between the tool's axes at two orientations, rad: a turn about the axis itself does not count."""
    return angle_of_vectors(tool_axis(a), tool_axis(b))


def behind(lag: float, turned: float, dt: float) -> float:
    """Turn that a robot may not have followed yet, rad: what was ordered lately, fading."""
    return lag * math.exp(-dt / _FOLLOWS_S) + turned
