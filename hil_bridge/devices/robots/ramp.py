"""Speed profile of a set point along its path, without a velocity step at the beginning or the end. Pure.

The set point always moves on the straight line to its goal, and never beyond it. If the goal reverses, the set
point follows at once: the remaining velocity in another direction is dropped, because a tool that is to retract
must not first continue forward. Only the acceleration, and the deceleration at a known goal, are limited.
"""

import math
from dataclasses import dataclass

from protocol.geometry import Pose, Quaternion, Vector, rotation_vector, towards, turn_between

GAP_CYCLES = 2.5
"""Number of cycles without a step after which the robot is assumed to be stationary, so that the ramp starts from
zero. Chosen.
"""
_NOTHING: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Pace:
    """Limits of a step."""

    speed: float
    """Largest speed, m/s."""
    turn_speed: float
    """Largest rotational speed, rad/s."""
    acceleration: float
    """Largest acceleration, m/s²."""
    turn_acceleration: float
    """Largest rotational acceleration, rad/s²."""


class Ramp:
    """Velocity of one set point, updated at each step."""

    def __init__(self, cycle: float) -> None:
        """Create a ramp with zero velocity. `cycle` is the time between two steps, s."""
        self._cycle = cycle
        self._velocity = self._turning = _NOTHING
        """Linear and rotational velocity of the last step, m/s and rad/s, base frame."""

    def rest(self) -> None:
        """Reset the velocity to zero."""
        self._velocity = self._turning = _NOTHING

    def step(self, setpoint: Pose, goal: Pose, pace: Pace, passed: float) -> Pose:
        """Return the next set point. `passed` is the time since the last step, s; at most one cycle of it counts."""
        if passed > GAP_CYCLES * self._cycle:
            self.rest()
        time = min(passed, self._cycle)
        if time <= 0.0:
            return setpoint
        path, turn = _path(setpoint, goal), _turn(setpoint.quaternion, goal.quaternion)
        distance = time * self._speed(self._velocity, path, pace.speed, pace.acceleration, time)
        angle = time * self._speed(self._turning, turn, pace.turn_speed, pace.turn_acceleration, time)
        after = towards(setpoint, goal, distance, angle)
        self._velocity = _per(_path(setpoint, after), time)
        self._turning = _per(_turn(setpoint.quaternion, after.quaternion), time)
        return after

    def _speed(self, before: Vector, path: Vector, most: float, gain: float, time: float) -> float:
        """Return the speed of a step along its path. The speed increases by at most `gain`, and only so far that
        steps which decrease at the same rate can end the path.
        """
        (u, v, w), (x, y, z) = before, path
        length = math.hypot(x, y, z)
        if not length:
            return most
        along = (u * x + v * y + w * z) / length
        change, cycle = gain * self._cycle, self._cycle
        steps = max(1, math.ceil((math.sqrt(1.0 + 8.0 * length / (change * cycle)) - 1.0) / 2.0))
        ending = length / (steps * cycle) + (steps - 1) / 2.0 * change if steps > 1 else length / time
        return min(most, max(along, 0.0) + gain * time, ending)


def _path(start: Pose, goal: Pose) -> Vector:
    (x, y, z), (u, v, w) = start.position, goal.position
    return u - x, v - y, w - z


def _per(path: Vector, time: float) -> Vector:
    x, y, z = path
    return x / time, y / time, z / time


def _turn(start: Quaternion, goal: Quaternion) -> Vector:
    """Return the shorter rotation between two orientations as a rotation vector, rad, base frame."""
    return _NOTHING if start == goal else rotation_vector(turn_between(start, goal))
