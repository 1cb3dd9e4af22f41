"""Motion through free space that several steps share: motion towards a point, and the check for arrival. Pure."""

import math

from msgspec.structs import replace

from hil_bridge.control.course.contact_sample import ContactSample
from hil_bridge.control.course.state import M, StepState
from hil_bridge.control.geometry.ways import ROUNDING, Place
from hil_bridge.errors.causes import Cause, Reason

_THERE = 0.5e-3
"""Distance from the point at which the tool counts as arrived, m. Chosen."""
_PATIENCE_S = 5.0
"""Time limit for the tool to arrive after its last order, s. Chosen."""


def towards(state: StepState[M], place: Place, distance: float) -> tuple[StepState[M], bool]:
    """Move the commanded point towards `place` by at most `distance`, m. Return the state, and whether the point
    has been reached.
    """
    (x, y), (u, v) = state.at, place
    left = math.hypot(u - x, v - y)
    if left <= distance + ROUNDING:
        return replace(state, at=(u, v)), True
    share, heading = distance / left, ((u - x) / left, (v - y) / left)
    return replace(state, at=(x + (u - x) * share, y + (v - y) * share), heading=heading), False


def come_to(contact: ContactSample, at: Place, depth: float | None = None) -> bool:
    """Return whether the reported position matches the commanded position. The depth, m, is compared only if it is
    given.
    """
    if depth is not None and abs(contact.measurement.position - depth) > _THERE:
        return False
    return math.dist(contact.place, at) <= _THERE


def not_there(since: float, now: float) -> Reason | None:
    """Return the reason why the run must end because the tool has not arrived; None while it may still arrive.

    `since` is the time of the last order that moved the target, s.
    """
    if now - since <= _PATIENCE_S:
        return None
    text = "the tool does not reach its target: check the position that the robot reports"
    return Reason(Cause.NOT_THERE, text)
