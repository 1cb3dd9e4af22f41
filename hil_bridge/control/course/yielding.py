"""Retraction that yields to a force from the side, and the return through free space along the same path. Pure."""

import math

from msgspec.structs import replace

from hil_bridge.control.course.contact_sample import ContactSample
from hil_bridge.control.course.state import M, StepState
from hil_bridge.control.course.wall import beyond_friction
from hil_bridge.control.geometry.ways import Place

YIELD_M = 10e-3
"""Maximum sideways motion of the tool while it retracts, m. Chosen."""
_PUSHED_N = 5.0
"""Force from the side, beyond friction, above which a retracting tool begins to yield, N. Chosen."""
_RELEASED_N = 1.0
"""Force from the side below which a retracting tool stops yielding, N. Chosen."""
_BACK_M = 1e-3
"""Minimum distance that a tool moves back through free space, regardless of the force, m. Chosen."""


def yield_to(
    state: StepState[M], contact: ContactSample, step: tuple[float, float], works_aside: bool
) -> StepState[M]:
    """Return the state of a retracting tool after one step away from a force from the side.

    `step` holds the distance of the step, m, and the share of the contact force that friction may cause.

    A tool that presses against a wall would scrape along it if it were pulled straight back. So it moves back along
    its path. A tool that also works sideways moves aside as well, but never forward along its path. If the
    direction of the force is not verified, its magnitude counts; if the moment contradicts the force, the tool
    moves back along its path.
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


def go_back(state: StepState[M], origin: Place, contact: ContactSample, distance: float) -> StepState[M]:
    """Return the state after one step back towards `origin`, for a tool whose motion through free space failed.
    `distance` is the length of the step, m; `origin` is where the motion began, m.
    """
    (x, y), (u, v) = state.at, origin
    left = math.hypot(x - u, y - v)
    distance = min(distance, left, YIELD_M - state.yielded)
    if not distance > 0.0:
        return state
    h, k = (x - u) / left, (y - v) / left
    freed = max(contact.against((h, k)), contact.aside) <= _RELEASED_N and not contact.sample.hidden
    if freed and state.yielded >= _BACK_M:
        return state
    return replace(state, at=(x - distance * h, y - distance * k), yielded=state.yielded + distance)
