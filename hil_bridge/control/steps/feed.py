"""How fast the tool goes along its path: slower where the force is off, or where something pushes against it. Pure."""

from typing import TYPE_CHECKING

from msgspec.structs import replace

from hil_bridge.control.program.state import ProgramState
from hil_bridge.errors.causes import Cause, Reason

if TYPE_CHECKING:
    from hil_bridge.control.steps.track import Track

STUCK_S = 2.0
"""Chosen: time without progress along the path until the step fails."""
_PROGRESS = 0.05
"""Chosen: share of the way that the step's speed makes in this time, that counts as progress."""
_LEAST = 0.1
"""Chosen: share of the speed that the error of the force leaves, so that every path comes to its end."""
_FROM = 0.5
"""Chosen: share of the lateral limit from which the feed becomes slower."""
_BACK = -0.5
"""Chosen: share of the speed at which the tool backs away from a lateral force beyond its limit."""


def feed_of(step: "Track", error: float, lateral: float, local: float) -> tuple[float, Reason | None]:
    """Share of the speed, and why the step must fail; None while it need not.

    `error` is the force beyond the wanted one, N, `lateral` the force along the surface, N, `local` the way so far, m.
    """
    feed = 1.0
    if step.feed_error_n is not None:
        feed = max(1.0 - (1.0 - _LEAST) * abs(error) / step.feed_error_n, _LEAST)
    limit = step.lateral_limit_n
    if limit is None:
        return feed, None
    if step.at_wall == "stop" and lateral >= limit:
        text = (
            f"the lateral force of {lateral:.1f} N is beyond {limit:g} N, {local * 1e3:.1f} mm along the path: "
            "something stands in the way"
        )
        return 0.0, Reason(Cause.STEP_WALL, text)
    left = (limit - lateral) / (limit * (1.0 - _FROM))
    return min(feed, max(left, _BACK)), None


def progress(state: ProgramState, speed_mm_s: float, dt: float, local: float) -> ProgramState:
    """State that knows for how long the tool has not got along its path. `local` is the way so far, m."""
    stuck = state.stuck + dt
    if local - state.passed >= _PROGRESS * speed_mm_s * 1e-3 * STUCK_S:
        return replace(state, stuck=0.0, passed=local)
    return replace(state, stuck=stuck)
