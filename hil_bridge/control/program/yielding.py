"""A tool that retracts yields to a force from the side. Pure."""

import math

from msgspec.structs import replace

from hil_bridge.control.course.wall import beyond_friction
from hil_bridge.control.program.state import Felt, ProgramState

YIELD_M = 10e-3
"""Chosen: farthest that a tool goes aside while it retracts, m."""
_PUSHED_N = 5.0
"""Chosen: force from the side, beyond friction, from which a tool that retracts yields, N."""
_RELEASED_N = 1.0
"""Chosen: force from the side down to which it goes on yielding, N."""


def yield_aside(state: ProgramState, felt: Felt, way: float, friction_share: float) -> ProgramState:
    """State of a tool that retracts, one step away from what pushes it from the side. `way` is that step, m.

    Pulled straight back, a tool that presses against a wall would scrape along it. It goes aside or back along its
    path, where it came from, and never on along it.
    """
    (pressed, x, y), (h, k) = felt.force, state.heading
    ahead = min(x * h + y * k, 0.0)
    x, y = x - ahead * h, y - ahead * k
    length = math.hypot(x, y)
    pushed = (
        length > _RELEASED_N
        if state.yielded
        else beyond_friction(length, pressed, friction_share) > _PUSHED_N
    )
    step = min(way, YIELD_M - state.yielded)
    if not (pushed and step > 0.0):
        return state
    at = state.at[0] - step * x / length, state.at[1] - step * y / length
    return replace(state, at=at, yielded=state.yielded + step)
