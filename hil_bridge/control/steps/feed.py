"""Speed along the path, which is reduced while the force is off or while the tool is pushed back. Pure."""

from typing import Any, Protocol

from msgspec import Struct
from msgspec.structs import replace

from hil_bridge.errors.causes import Cause, Reason

STUCK_S = 2.0
"""Time without progress along the path after which the step fails, s. Chosen."""
_PROGRESS = 0.05
"""Share of the distance at the step's speed in `STUCK_S` that counts as progress. Chosen."""
_LEAST = 0.1
"""Smallest share of the speed for a force error, so that every path ends. Chosen."""
_FROM = 0.5
"""Share of the lateral limit above which the feed is reduced. Chosen."""
_BACK = -0.5
"""Share of the speed at which the tool backs away from a lateral force beyond its limit. Chosen."""


class FeedSettings(Protocol):
    """Settings of a step for its speed along the path. `Track` defines them."""

    @property
    def feed_error_n(self) -> float | None: ...
    @property
    def lateral_limit_n(self) -> float | None: ...
    @property
    def at_wall(self) -> str: ...


class TrackMemory(Struct, frozen=True):
    """Memory of a step that follows a path."""

    across: Any = None
    """State of the controller across the path; None until the tool has pressed across it."""
    stuck: float = 0.0
    """Time since the tool last made progress along its path, s."""
    passed: float = 0.0
    """Path length at the last progress, m."""


def feed_of(step: FeedSettings, error: float, lateral: float, local: float) -> tuple[float, Reason | None]:
    """Return the share of the speed, and the reason why the step must fail (None if it may continue).

    `error` is the excess over the desired force, N; `lateral` the force along the surface, N; `local` the path
    length so far, m.
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
            "there is an obstacle"
        )
        return 0.0, Reason(Cause.STEP_WALL, text)
    left = (limit - lateral) / (limit * (1.0 - _FROM))
    return min(feed, max(left, _BACK)), None


def watch_progress(memory: TrackMemory, speed_mm_s: float, dt: float, local: float) -> TrackMemory:
    """Return the memory with the updated time without progress. `local` is the path length so far, m."""
    if local - memory.passed >= _PROGRESS * speed_mm_s * 1e-3 * STUCK_S:
        return replace(memory, stuck=0.0, passed=local)
    return replace(memory, stuck=memory.stuck + dt)
