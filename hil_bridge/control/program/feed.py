"""How fast the tool goes along its path: slower where the force is off, or where something pushes against it. Pure."""

from hil_bridge.control.program.steps import Track

STUCK_S = 2.0
"""Chosen: time for which the feed may stand still until the step fails."""
_LEAST = 0.1
"""Chosen: share of the speed that the error of the force leaves, so that every path comes to its end."""
_FROM = 0.5
"""Chosen: share of the lateral limit from which the feed becomes slower."""
_BACK = -0.5
"""Chosen: share of the speed at which the tool backs away from a lateral force beyond its limit."""


def feed_of(step: Track, error: float, lateral: float, local: float) -> tuple[float, str]:
    """Share of the speed, and why the step must fail; empty while it need not.

    `error` is the force beyond the wanted one, N, `lateral` the force along the surface, N, `local` the way so far, m.
    """
    feed = 1.0
    if step.feed_error_n is not None:
        feed = max(1.0 - (1.0 - _LEAST) * abs(error) / step.feed_error_n, _LEAST)
    limit = step.lateral_limit_n
    if limit is None:
        return feed, ""
    if step.at_wall == "stop" and lateral >= limit:
        return 0.0, (
            f"the lateral force of {lateral:.1f} N is beyond {limit:g} N, {local * 1e3:.1f} mm along the path: "
            "something stands in the way"
        )
    left = (limit - lateral) / (limit * (1.0 - _FROM))
    return min(feed, max(left, _BACK)), ""
