"""The pace of a set point on its way: it begins and ends without a step in velocity. Pure.

The set point always moves on the straight way to its goal, and never beyond. So a goal that turns back is followed at
once: what was left of the speed in another direction is dropped, for a tool that is to leave must not continue first.
Only gaining speed is bounded, and coming to rest at a goal that is known.
"""

import math
from dataclasses import dataclass

from protocol.geometry import Pose, Quaternion, Vector, rotation_vector, towards, turn_between

GAP_CYCLES = 2.5
"""Chosen: after as many cycles without a step the robot has stood, so that the way restarts."""
_NOTHING: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Pace:
    """Bounds of a step."""

    speed: float
    """m/s"""
    turn_speed: float
    """rad/s"""
    acceleration: float
    """m/s²"""
    turn_acceleration: float
    """rad/s²"""


class Ramp:
    """The velocity of one set point, from step to step."""

    def __init__(self, cycle: float) -> None:
        """`cycle` is the time between two steps, s."""
        self._cycle = cycle
        self._velocity = self._turning = _NOTHING
        """Of the last step: m/s and rad/s, base frame."""

    def rest(self) -> None:
        """The set point stands."""
        self._velocity = self._turning = _NOTHING

    def step(self, setpoint: Pose, goal: Pose, pace: Pace, passed: float) -> Pose:
        """The next set point, `passed`, s, after the step before. Of a longer time than a cycle only a cycle counts."""
        if passed > GAP_CYCLES * self._cycle:
            self.rest()
        time = min(passed, self._cycle)
        if time <= 0.0:
            return setpoint
        way, turn = _way(setpoint, goal), _turn(setpoint.quaternion, goal.quaternion)
        distance = time * self._speed(self._velocity, way, pace.speed, pace.acceleration, time)
        angle = time * self._speed(self._turning, turn, pace.turn_speed, pace.turn_acceleration, time)
        after = towards(setpoint, goal, distance, angle)
        self._velocity = _per(_way(setpoint, after), time)
        self._turning = _per(_turn(setpoint.quaternion, after.quaternion), time)
        return after

    def _speed(self, before: Vector, way: Vector, most: float, gain: float, time: float) -> float:
        """The speed of a step on its way: gained by no more than `gain`, and such that steps of as much less end it."""
        (u, v, w), (x, y, z) = before, way
        length = math.hypot(x, y, z)
        if not length:
            return most
        along = (u * x + v * y + w * z) / length
        change, cycle = gain * self._cycle, self._cycle
        steps = max(1, math.ceil((math.sqrt(1.0 + 8.0 * length / (change * cycle)) - 1.0) / 2.0))
        ending = length / (steps * cycle) + (steps - 1) / 2.0 * change if steps > 1 else length / time
        return min(most, max(along, 0.0) + gain * time, ending)


def _way(start: Pose, goal: Pose) -> Vector:
    (x, y, z), (u, v, w) = start.position, goal.position
    return u - x, v - y, w - z


def _per(way: Vector, time: float) -> Vector:
    x, y, z = way
    return x / time, y / time, z / time


def _turn(start: Quaternion, goal: Quaternion) -> Vector:
    """The shorter turn from one orientation to another, as axis times angle, rad, base frame."""
    return _NOTHING if start == goal else rotation_vector(turn_between(start, goal))
