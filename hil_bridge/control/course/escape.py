"""How fast a tool goes back from a surface that presses it beyond the limit. Pure."""

import math

from hil_bridge.control.types import Measurement

_ESCAPE_M = 2e-3
"""Longest way of one sample back from a force beyond the limit, m. Chosen: something behind the tool is met with 100 N
more on 50 kN/m before the next sample tells it.
"""


def escape_way(measurement: Measurement, limit: float, stiffness: float, speed_mm_s: float) -> float:
    """Way back in one sample from a surface that presses beyond the limit, N, in m; 0 where none does.

    Derived: a surface that stands has let the tool go after force / stiffness, N/m. So the order is no farther from the
    reported position than that. One that follows the tool raises the force, and with it the way.
    """
    force = abs(measurement.force) if measurement.saturated else measurement.force
    left = force / stiffness - max(measurement.position - measurement.commanded, 0.0)
    if not (force > limit and math.isfinite(left)):
        return 0.0
    return max(min(left, speed_mm_s * 1e-3 * measurement.dt, _ESCAPE_M), 0.0)
