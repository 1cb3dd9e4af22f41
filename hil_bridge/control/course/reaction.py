"""The bound of the true force: the times until a force is answered, and the way of the tool meanwhile. Pure.

A force is told late, a decision comes at the end of a cycle, and a robot takes time to do what it is ordered. Until
then the tool continues at the speed that it was ordered to have. None of these times shrinks with the cycle of the run.
So the bound counts seconds and not cycles.
"""

import math
from typing import NamedTuple


class Reaction(NamedTuple):
    """Times that add up between a force beyond its limit and a tool that goes no deeper, s."""

    age_s: float
    """From the force to a frame that tells of it: filter, time between two frames, wire."""
    wait_s: float
    """From that frame to the decision: one cycle."""
    order_s: float
    """From the decision to the order that the robot has."""
    motion_s: float
    """From that order to a tool that goes no deeper: interpolator, way to the loops, servo."""

    @property
    def total_s(self) -> float:
        """All of them."""
        return self.age_s + self.wait_s + self.order_s + self.motion_s


def servo_lag(natural_frequency_rad_s: float, damping_ratio: float) -> float:
    """Time by which a tool at constant speed trails its set point, with the overshoot when that stops, s.

    Derived: a loop of second order trails a ramp by 2ζ/ωn. Below ζ = 1 it passes the end of the ramp by
    v/ωn · exp(-ζ(π - θ)/sin θ) with ζ = cos θ.
    """
    lag = 2.0 * damping_ratio / natural_frequency_rad_s
    if damping_ratio >= 1.0:
        return lag
    angle = math.acos(damping_ratio)
    return lag + math.exp(-damping_ratio * (math.pi - angle) / math.sin(angle)) / natural_frequency_rad_s


def bound_n(
    limit_n: float, stiffness_n_m: float, speed_m_s: float, reaction_s: float, step_m: float = 0.0
) -> float:
    """Largest true force of a tool that alone moves, N. It passes the limit at this speed and is answered in this time.

    `step_m` is the resolution of the robot's position: the tool may be deeper by as much than it is ordered and told.
    """
    way = speed_m_s * reaction_s if speed_m_s else 0.0
    return limit_n + stiffness_n_m * (way + step_m)
