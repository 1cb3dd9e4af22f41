"""Motion through free space that steps share: towards a place, and whether the tool has come there. Pure."""

import math

from msgspec.structs import replace

from hil_bridge.control.course.contact_sample import ContactSample
from hil_bridge.control.course.state import M, StepState
from hil_bridge.control.geometry.ways import ROUNDING, Place
from hil_bridge.errors.causes import Cause, Reason

_THERE = 0.5e-3
"""Chosen: distance from the place at which the tool counts as arrived, m."""
_PATIENCE_S = 5.0
"""Chosen: time after the last order within which the tool must come to its place."""


def towards(state: StepState[M], place: Place, way: float) -> tuple[StepState[M], bool]:
    """Move the commanded place nearer to another one, by at most `way`, m; return whether it is there."""
    (x, y), (u, v) = state.at, place
    left = math.hypot(u - x, v - y)
    if left <= way + ROUNDING:
        return replace(state, at=(u, v)), True
    share, heading = way / left, ((u - x) / left, (v - y) / left)
    return replace(state, at=(x + (u - x) * share, y + (v - y) * share), heading=heading), False


def come_to(contact: ContactSample, at: Place, depth: float | None = None) -> bool:
    """Return whether the reported place is the commanded one; the depth is compared where it is given, m."""
    if depth is not None and abs(contact.measurement.position - depth) > _THERE:
        return False
    return math.dist(contact.place, at) <= _THERE


def not_there(since: float, now: float) -> Reason | None:
    """Return why the run must end although the tool was ordered to its place; None while it may still come.

    `since` is when it was last ordered farther, s.
    """
    if now - since <= _PATIENCE_S:
        return None
    text = "the tool does not come to its place: look at the position that the robot reports"
    return Reason(Cause.NOT_THERE, text)
