"""Limits of speed, acceleration and jerk, and set points of the joints that keep them.

A controller before V9.40P/77 stops with an alarm if the differences of the set points exceed its limits; a newer one
smooths them. `JointLimiter` follows set points exactly while they keep the limits. Otherwise it moves each joint so
that it can always stop at the newest set point, and never beyond it: in each cycle it chooses the largest jerk after
which the shortest stop ends there. Moving set points are then followed with a delay that grows with the square root of
the speed.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from hil_fanuc.packets import THRESHOLDS, Limit, Threshold

_HALVINGS = 40
"""Number of halvings in the search for the jerk. Chosen: the position is then exact to far below a step."""
_ROUNDING = 1e-9


class AxisLimits(NamedTuple):
    """Limits of one joint, degrees and seconds."""

    speed: float
    acceleration: float
    jerk: float

    def scaled(self, share: float) -> "AxisLimits":
        """Return a share of the limits."""
        return AxisLimits(self.speed * share, self.acceleration * share, self.jerk * share)


class AxisState(NamedTuple):
    """Newest set point of one joint, degrees, with its differences per s and s²."""

    position: float
    speed: float = 0.0
    acceleration: float = 0.0

    def after(self, position: float, cycle: float) -> "AxisState":
        """Return the state with the next set point."""
        speed = (position - self.position) / cycle
        return AxisState(position, speed, (speed - self.speed) / cycle)


class Breach(NamedTuple):
    """Limit that a set point exceeds."""

    axis: int
    """Number of the joint, from 1."""
    limit: Limit
    share: float
    """Ratio of the difference to the limit."""


def find_breach(
    states: Sequence[AxisState], after: Sequence[AxisState], limits: Sequence[AxisLimits], cycle: float
) -> Breach | None:
    """Return the limit that the next set points exceed most, in the order speed, acceleration, jerk."""
    for kind in Limit:
        worst = max(
            (
                Breach(axis, kind, _difference(kind, before, state, cycle) / limit[kind])
                for axis, (before, state, limit) in enumerate(zip(states, after, limits, strict=True), 1)
            ),
            key=lambda breach: breach.share,
        )
        if worst.share > 1.0 + _ROUNDING:
            return worst
    return None


def _difference(kind: Limit, before: AxisState, after: AxisState, cycle: float) -> float:
    if kind is Limit.SPEED:
        return abs(after.speed)
    if kind is Limit.ACCELERATION:
        return abs(after.acceleration)
    return abs(after.acceleration - before.acceleration) / cycle


class JointLimiter:
    """Set points of all joints that keep the limits."""

    def __init__(self, joints: Sequence[float], cycle: float) -> None:
        """Start stationary. `cycle` is the time between two set points, s."""
        self._cycle = cycle
        self.rest(joints)

    def rest(self, joints: Sequence[float]) -> None:
        """Restart stationary at these joints."""
        self.states = tuple(AxisState(joint) for joint in joints)

    @property
    def joints(self) -> tuple[float, ...]:
        """Newest set points, degrees."""
        return tuple(state.position for state in self.states)

    def accept(self, joints: Sequence[float]) -> None:
        """Take these set points as they are."""
        self.states = self._following(joints)

    def breach(self, joints: Sequence[float], limits: Sequence[AxisLimits]) -> Breach | None:
        """Return the limit that these set points would exceed."""
        return find_breach(self.states, self._following(joints), limits, self._cycle)

    def step(
        self, goal: Sequence[float], limits: Sequence[AxisLimits], exact: bool = False
    ) -> tuple[float, ...]:
        """Move towards a goal by one cycle and return the set points. With `exact`, a goal that keeps the limits is
        followed at once, even if the joints could not stop there.
        """
        if exact and self.breach(goal, limits) is None:
            self.accept(goal)
        else:
            self.states = tuple(
                next_state(state, at, limit, self._cycle)
                for state, at, limit in zip(self.states, goal, limits, strict=True)
            )
        return self.joints

    def _following(self, joints: Sequence[float]) -> tuple[AxisState, ...]:
        return tuple(
            state.after(joint, self._cycle) for state, joint in zip(self.states, joints, strict=True)
        )


def next_state(state: AxisState, goal: float, limits: AxisLimits, cycle: float) -> AxisState:
    """Return the state one cycle later, from which the joint can stop at the goal."""
    if goal == state.position and not state.speed and not state.acceleration:
        return state
    if _can_end(state, goal, limits, cycle):
        return state.after(goal, cycle)
    lowest = max(-limits.jerk, (-limits.acceleration - state.acceleration) / cycle)
    highest = min(limits.jerk, (limits.acceleration - state.acceleration) / cycle)
    lowest, highest = min(lowest, highest), max(lowest, highest)

    def moved(jerk: float) -> AxisState:
        acceleration = state.acceleration + jerk * cycle
        speed = state.speed + acceleration * cycle
        return AxisState(state.position + speed * cycle, speed, acceleration)

    low, high = lowest, highest
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        after = moved(middle)
        peak = after.speed + after.acceleration * abs(after.acceleration) / (2.0 * limits.jerk)
        if peak > limits.speed or (peak >= -limits.speed and _stop(after, limits) > goal):
            high = middle
        else:
            low = middle
    return moved(0.5 * (low + high))


def _can_end(state: AxisState, goal: float, limits: AxisLimits, cycle: float) -> bool:
    """Return whether the joint can reach the goal in this cycle and then stay there."""
    before, at = state.acceleration, state.after(goal, cycle)
    braked = -at.speed / cycle
    accelerations = before, at.acceleration, braked, 0.0
    jerks = (abs(b - a) / cycle for a, b in itertools.pairwise(accelerations))
    return (
        abs(at.speed) <= limits.speed
        and max(map(abs, accelerations[1:])) <= limits.acceleration
        and max(jerks) <= limits.jerk
    )


def _stop(state: AxisState, limits: AxisLimits) -> float:
    """Return the position at which the shortest stop ends that keeps acceleration and jerk."""
    position, speed, acceleration = state
    jerk, most = limits.jerk, limits.acceleration
    side = math.copysign(1.0, speed + acceleration * abs(acceleration) / (2.0 * jerk))
    speed, acceleration = side * speed, side * acceleration
    peak = min(math.sqrt(max(jerk * speed + acceleration * acceleration / 2.0, 0.0)), most)
    begin = (acceleration + peak) / jerk
    distance = begin * (speed + begin * (acceleration / 2.0 - jerk * begin / 6.0))
    speed += begin * (acceleration - jerk * begin / 2.0)
    hold = max(speed / most - peak / (2.0 * jerk) * peak / most, 0.0) if peak == most else 0.0
    distance += hold * (speed - most * hold / 2.0)
    speed -= most * hold
    end = peak / jerk
    distance += end * (speed - end * (peak / 2.0 - jerk * end / 6.0))
    return position + side * distance


def interpolate(table: Threshold, speed_m_s: float, load: float) -> float:
    """Return the limit of an axis at a speed of the tool, and at a share of the largest load, 0 to 1."""
    share = min(max(speed_m_s * 1e3 / table.speed_mm_s, 0.0), 1.0) if table.speed_mm_s else 1.0
    at = max(share * THRESHOLDS - 1.0, 0.0)
    below = min(int(at), THRESHOLDS - 2)
    part = at - below
    light, heavy = (
        values[below] + part * (values[below + 1] - values[below])
        for values in (table.no_load, table.full_load)
    )
    return light + min(max(load, 0.0), 1.0) * (heavy - light)


class LimitTable:
    """Limits of the joints that a controller reports."""

    def __init__(self, tables: Mapping[tuple[int, int], Threshold]) -> None:
        """`tables` maps axis and kind of the limit to the thresholds."""
        self._tables = tables

    def at(self, speed_m_s: float, load: float, axes: int = 6) -> tuple[AxisLimits, ...]:
        """Return the limits at a speed of the tool, m/s, and a share of the largest load."""
        return tuple(
            AxisLimits(*(interpolate(self._tables[axis, kind], speed_m_s, load) for kind in Limit))
            for axis in range(1, axes + 1)
        )
