"""Watch over a retraction: whether the force answers it, and where a tool may go without a force to go by. Pure."""

import math

from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.verdict import Observation, Retreat


def is_known(seen: Observation) -> bool:
    """Whether the observation tells the force, apart from its age."""
    return math.isfinite(seen.force + seen.resultant + seen.peak_resultant) and not (
        seen.fault or seen.saturated or seen.dead_axis
    )


def begin(limits: Limits, seen: Observation) -> Retreat:
    """State of a retraction at its first known force."""
    within = max(seen.resultant, seen.peak_resultant) <= limits.force_limit_n
    return Retreat(seen.now, seen.pressing, seen.resultant, seen.depth, within)


def advance(limits: Limits, before: Retreat, seen: Observation) -> Retreat:
    """The lowest force so far; while the retraction has not taken effect yet, the newest."""
    resultant = seen.resultant
    if before.from_contact and (seen.now - before.began_at) * 1e3 <= limits.retract_grace_ms:
        lowest = max(before.lowest, resultant)
        return Retreat(before.began_at, True, lowest, seen.depth, before.within)
    lowest = min(before.lowest, resultant)
    fell = resultant < before.lowest - _FELL_N
    return Retreat(
        before.began_at, before.from_contact, lowest, seen.depth if fell else before.depth, before.within
    )


def no_way_back(limits: Limits, before: Retreat, after: Retreat, seen: Observation) -> str:
    """Why the tool must stand still, in words; empty while it need not."""
    force = seen.resultant
    if before.within and force > limits.force_limit_n:
        return f"the force rose to {force:.1f} N while the tool retracted"
    if force > after.lowest + limits.retract_rise_n:
        return f"the force rose from {after.lowest:.1f} N to {force:.1f} N while the tool retracted"
    over = abs(seen.force) > limits.force_limit_n or force > limits.resultant_limit_n
    if over and (before.depth - seen.depth) * 1e3 > limits.unanswered_mm:
        back = (before.depth - seen.depth) * 1e3
        return f"the force stayed at {force:.1f} N while the tool retracted by {back:.1f} mm"
    return ""


def blind_goal(limits: Limits, pressed: tuple[float, float] | None, before: Retreat | None) -> float:
    """Depth to which a tool may go back without a force to go by, m. `pressed` is as in `SupervisorState`."""
    if pressed is None or (before is not None and not before.from_contact):
        return 0.0
    return min(0.0, pressed[1] - limits.blind_retract_mm * 1e-3)


_FELL_N = 0.25
"""Chosen: a force that came down by this much has answered the retraction."""
