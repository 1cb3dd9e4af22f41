"""A retracting tool that yields to a force from the side, and leaves free space the way it came. Pure."""

import math

from msgspec.structs import replace

from hil_bridge.control.course.contact_sample import ContactSample
from hil_bridge.control.course.state import M, StepState
from hil_bridge.control.course.wall import beyond_friction
from hil_bridge.control.geometry.ways import Place

YIELD_M = 10e-3
"""Chosen: farthest that a tool goes aside while it retracts, m."""
_PUSHED_N = 5.0
"""Chosen: force from the side, beyond friction, from which a tool that retracts yields, N."""
_RELEASED_N = 1.0
"""Chosen: force from the side down to which it continues yielding, N."""
_BACK_M = 1e-3
"""Chosen: distance that a tool goes back through free space at least, m, whatever the force says."""


def yield_to(
    state: StepState[M], contact: ContactSample, step: tuple[float, float], works_aside: bool
) -> StepState[M]:
    """State of a tool that retracts, one step away from what pushes it from the side. `step` is that way, m, and the
    share of the contact force that friction makes.

    Pulled straight back, a tool that presses against a wall would scrape along it. It goes back along its path, where
    it came from. A tool that works against the side too goes aside as well, and never on along its path. Where the
    direction of the force is not verified, its length counts; where its moment contradicts it, the tool goes back the
    way it came.
    """
    (pressed, x, y), (h, k), (way, friction_share) = contact.force, state.heading, step
    against = contact.against(state.heading)
    if contact.sample.hidden or not works_aside:
        against = max(against, contact.aside)
        if state.aside and works_aside:  # back to the path
            h, k = (-k, h) if state.aside > 0.0 else (k, -h)
    else:
        ahead = min(against, 0.0)
        x, y = x - ahead * h, y - ahead * k
        against = math.hypot(x, y)
        h, k = (x / against, y / against) if against > 0.0 else (0.0, 0.0)
    pushed = (
        against > _RELEASED_N or bool(contact.sample.hidden)
        if state.yielded
        else beyond_friction(against, pressed, friction_share) > _PUSHED_N
    )
    way = min(way, YIELD_M - state.yielded)
    if not (pushed and way > 0.0 and math.isfinite(against)):
        return state
    return replace(state, at=(state.at[0] - way * h, state.at[1] - way * k), yielded=state.yielded + way)


def go_back(state: StepState[M], origin: Place, contact: ContactSample, way: float) -> StepState[M]:
    """State of a tool whose motion through free space failed, one step of this length, m, back towards `origin`, where
    that motion began, m.
    """
    (x, y), (u, v) = state.at, origin
    left = math.hypot(x - u, y - v)
    way = min(way, left, YIELD_M - state.yielded)
    if not way > 0.0:
        return state
    h, k = (x - u) / left, (y - v) / left
    freed = max(contact.against((h, k)), contact.aside) <= _RELEASED_N and not contact.sample.hidden
    if freed and state.yielded >= _BACK_M:
        return state
    return replace(state, at=(x - way * h, y - way * k), yielded=state.yielded + way)
