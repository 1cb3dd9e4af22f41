"""Bound of the true force, from the reaction times to a force and the tool's motion during them. Pure.

A force is reported late, a decision comes at the end of a cycle, and a robot takes time to carry out an order.
Until then the tool continues at its ordered speed. None of these times shrinks with the cycle of the run. So the
bound depends on seconds, not on cycles.
"""

import math
from typing import NamedTuple


class Reaction(NamedTuple):
    """Consecutive times from a force beyond its limit to the end of the tool's motion into the surface, s."""

    age_s: float
    """Time from the force to a frame that reports it, s: filter, time between two frames and link."""
    wait_s: float
    """Time from that frame to the decision, s: one cycle."""
    order_s: float
    """Time from the decision to the arrival of the order at the robot, s."""
    motion_s: float
    """Time from that order to the end of the motion into the surface, s: interpolator, transport to the control
    loops and servo.
    """

    @property
    def total_s(self) -> float:
        """Total reaction time: sum of all four times, s."""
        return self.age_s + self.wait_s + self.order_s + self.motion_s


def servo_lag(natural_frequency_rad_s: float, damping_ratio: float) -> float:
    """Return the time by which a tool at constant speed lags its set point, including the overshoot when the set
    point stops, s.

    Derived: a second-order loop trails a ramp by 2ζ/ωn. Below ζ = 1 it overshoots the end of the ramp by v/ωn ·
    exp(-ζ(π - θ)/sin θ) with ζ = cos θ.
    """
    lag = 2.0 * damping_ratio / natural_frequency_rad_s
    if damping_ratio >= 1.0:
        return lag
    angle = math.acos(damping_ratio)
    return lag + math.exp(-damping_ratio * (math.pi - angle) / math.sin(angle)) / natural_frequency_rad_s


def bound_n(
    limit_n: float, stiffness_n_m: float, speed_m_s: float, reaction_s: float, step_m: float = 0.0
) -> float:
    """Return the largest true force if only the tool moves, N. The tool passes the limit at the given speed and
    stops after the reaction time.

    `step_m` is the resolution of the robot's position: the tool may be deeper than ordered and reported by one
    step.
    """
    distance = speed_m_s * reaction_s if speed_m_s else 0.0
    return limit_n + stiffness_n_m * (distance + step_m)
