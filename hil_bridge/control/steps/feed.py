"""How fast the tool goes along its path: slower where the force is off, or where something pushes against it. Pure."""

from typing import Any, Protocol

from msgspec import Struct
from msgspec.structs import replace

from hil_bridge.errors.causes import Cause, Reason

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


class FeedSettings(Protocol):
    """Settings of a step for its speed along the path, as in `Track`."""

    @property
    def feed_error_n(self) -> float | None: ...
    @property
    def lateral_limit_n(self) -> float | None: ...
    @property
    def at_wall(self) -> str: ...


class TrackMemory(Struct, frozen=True):
    """Memory of a step along a path."""

    across: Any = None
    """State of the controller across the path; None before it has pressed there."""
    stuck: float = 0.0
    """Time since the tool last made progress along its path, s."""
    passed: float = 0.0
    """Length along the path at that time, m."""


def feed_of(step: FeedSettings, error: float, lateral: float, local: float) -> tuple[float, Reason | None]:
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


def watch_progress(memory: TrackMemory, speed_mm_s: float, dt: float, local: float) -> TrackMemory:
    """Return the memory with the time for which the tool has made no progress. `local` is the length so far, m."""
    if local - memory.passed >= _PROGRESS * speed_mm_s * 1e-3 * STUCK_S:
        return replace(memory, stuck=0.0, passed=local)
    return replace(memory, stuck=memory.stuck + dt)
