"""Distance of a retraction from a surface that presses the tool beyond the limit. Pure."""

import math

from hil_bridge.control.types import Measurement

_ESCAPE_M = 2e-3
"""Longest retraction in one sample from a force beyond the limit, m. Chosen: an obstacle behind the tool, at 50
kN/m, is pressed with 100 N more before the next sample reports it.
"""


def escape_distance(measurement: Measurement, limit: float, stiffness: float, speed_mm_s: float) -> float:
    """Return the distance to retract in one sample from a surface that presses beyond the limit, m; 0 if no surface
    does.

    `limit` is in N and `stiffness` in N/m. Derived: a stationary surface has released the tool after force /
    stiffness. So the order goes no farther than this distance from the reported position. A surface that follows
    the tool raises the force, and so the distance.
    """
    force = abs(measurement.force) if measurement.saturated else measurement.force
    left = force / stiffness - max(measurement.position - measurement.commanded, 0.0)
    if not (force > limit and math.isfinite(left)):
        return 0.0
    return max(min(left, speed_mm_s * 1e-3 * measurement.dt, _ESCAPE_M), 0.0)
