"""A wall in the way of a plain run: how it shows in the force, and how far back the tool yields. Pure."""

from hil_bridge.control.types import Measurement

YIELD_M = 10e-3
"""Chosen: farthest that a tool goes back along its way while it retracts, m."""
_PUSHED_N = 5.0
"""Chosen: force against the travel, beyond friction, from which a tool that retracts yields, N."""
_RELEASED_N = 1.0
"""Chosen: force against the travel down to which it goes on yielding, N."""


def beyond_friction(against: float, pressed: float, friction_share: float) -> float:
    """Part of a force against the travel, N, that friction at this contact force, N, does not explain."""
    return against - friction_share * max(pressed, 0.0)


def way_back(measurement: Measurement, yielded: float, way: float, friction_share: float) -> float:
    """Way back along the travel in one sample of a retraction, m; `way` is that of its speed, m.

    The tool came from there. Pulled straight out, one that presses against a wall would scrape along it.
    """
    against = measurement.against
    pushed = (
        against > _RELEASED_N
        if yielded
        else beyond_friction(against, measurement.force, friction_share) > _PUSHED_N
    )
    return min(way, YIELD_M - yielded) if pushed else 0.0
