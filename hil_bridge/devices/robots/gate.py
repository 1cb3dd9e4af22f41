"""Last gate: an independent check of each pose before it is sent to a robot.

The gate runs after all decisions. It imports neither the code of the decisions nor their arithmetic; an import
contract ensures this. The gate therefore stops poses that a bug in that code lets through. It stops nothing else,
because its bounds are slightly wider than the limits of an order. A pose that the gate stops is not sent.

Distances are charged to a credit. The credit grows with time at the maximum speed, up to the amount for a fixed
time. The duration of a decision varies from cycle to cycle, so two orders may follow each other faster than was
decided.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, TypeAlias

Vector: TypeAlias = tuple[float, float, float]
Quaternion: TypeAlias = tuple[float, float, float, float]


class Pose(Protocol):
    """Pose of a tool: position in the base frame, m, and orientation as a quaternion w x y z."""

    @property
    def position(self) -> Vector: ...
    @property
    def quaternion(self) -> Quaternion: ...


class _Place(NamedTuple):
    position: Vector
    quaternion: Quaternion


REPORT = "this is a bug of the program: report it with the recording"
"""Text at the end of each message of the gate."""
FARTHEST_M = 100.0
"""Largest plausible coordinate of a position, m. Chosen: ten times the reach of the largest arms."""
UNIT = 0.02
"""Largest deviation of an orientation's norm from 1. Chosen: twice the deviation that is accepted in a robot's
reports.
"""
TURN_SLACK_RAD = math.radians(0.2)
"""Tolerance of a rotation and of a tilt, rad. Chosen: a few units of 1/16384."""
SLACK_M = 1e-6
"""Tolerance of a distance and of a position, in addition to the robot's resolution, m. Chosen: far above the error
of the arithmetic.
"""
CONTRADICTION_M = 1e-4
"""Largest difference between the decided depth and the depth of the pose, m. Chosen: below one step of a coarse
robot, and ten times the tolerance of the guard.
"""

POSITION_ERROR_M = 1e-4
"""Largest depth below the bounds at which a tool may be and may be ordered to stay, m. Chosen: five times the
position noise of a Universal Robot, 0.02 mm, and a tenth of the guard's tolerance of a reported position.
"""

OUTSIDE_M = 1e-3
"""Largest distance outside the box at which a tool may be and may be ordered to stay, m. Chosen: the guard's
tolerance of a reported position.
"""

ANY = 1e9
"""Speed that limits nothing, m/s or rad/s. Chosen: finite, because infinity times zero would be NaN."""
_ORIGIN = _Place((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))


@dataclass(frozen=True, slots=True)
class Bounds:
    """Bounds of the orders of one movement. With the defaults, only invalid poses are stopped."""

    start: Pose = _ORIGIN
    """Pose from which depth and tilt are measured."""
    approach: Vector = (0.0, 0.0, 1.0)
    """Unit vector into the surface, in the base frame."""
    deepest: float = math.inf
    """Largest depth below the start along the approach, m."""
    low: Vector = (-FARTHEST_M,) * 3
    """Lower corner of the box that contains the orders, base frame, m."""
    high: Vector = (FARTHEST_M,) * 3
    """Upper corner of the box that contains the orders, base frame, m."""
    tilt: float = math.inf
    """Largest angle between the tool axis and the tool axis of the start, rad."""
    deeper: float = ANY
    """Largest speed into the surface, m/s."""
    across: float = ANY
    """Largest speed across the approach, m/s."""
    away: float = ANY
    """Largest speed against the approach, m/s."""
    turn: float = ANY
    """Largest rotational speed, rad/s."""
    time: float = 1.0
    """Time for which a distance credit accumulates, s."""
    slack: float = SLACK_M
    """Tolerance of a position, m: the rounding error of the robot's protocol."""


class Gate:
    """Gate that checks the poses of one movement in order."""

    def __init__(self, bounds: Bounds, now: float, pose: Pose | None = None) -> None:
        """Create a gate. `pose` is the present pose of the tool, by default the start of the bounds; `now` is the
        time, s.

        A robot whose reported position is noisy may be slightly deeper than the bounds allow. It may be ordered to
        stay there, but no deeper.
        """
        self.bounds = bounds
        self._last, self._at = pose or bounds.start, now
        stands = depth_of(self._last.position, bounds)
        self._deepest = stands if 0.0 < stands - bounds.deepest <= POSITION_ERROR_M else bounds.deepest
        self._low = _reach(bounds.low, self._last.position, min)
        self._high = _reach(bounds.high, self._last.position, max)
        self._turned_at = now
        self._deeper = self._across = self._away = self._turned = 0.0
        """Part of each credit that is used and not yet restored, m and rad."""
        self._before = (self._last, now, now, 0.0, 0.0, 0.0, 0.0)
        """State before the newest pose: previous pose, its time, the time of the last rotation, and the credits."""

    def judge(self, pose: Pose, now: float, deepest: float = math.inf) -> str:
        """Return the reason why this pose must not be sent to the robot. Return "" if it may be sent; it then
        counts as ordered.

        `deepest` is an additional limit of the depth, m. The code uses scalars because it runs in every cycle.
        """
        turned = pose.quaternion != self._last.quaternion
        return self._judge_place(pose, turned, deepest) or self._judge_step(pose, turned, now)

    def _judge_place(self, pose: Pose, turned: bool, deepest: float) -> str:
        """Return the reason why this pose is out of bounds, regardless of the previous pose, or "" if it is within
        bounds.
        """
        bounds = self.bounds
        (x, y, z), (u, v, w), (a, b, c) = pose.position, bounds.start.position, bounds.approach
        (lowest_x, lowest_y, lowest_z), (highest_x, highest_y, highest_z) = self._low, self._high
        if not (abs(x) <= FARTHEST_M and abs(y) <= FARTHEST_M and abs(z) <= FARTHEST_M):
            return _stopped(f"to the position {pose.position}, which no arm can reach")
        if turned and not abs(math.hypot(*pose.quaternion) - 1.0) <= UNIT:
            return _stopped(f"to the orientation {pose.quaternion}, which is invalid")
        depth, limit = a * (x - u) + b * (y - v) + c * (z - w), min(self._deepest, deepest)
        if depth > limit + bounds.slack:
            return _beyond((depth - limit) * 1e3, "mm deeper than allowed")
        if not (lowest_x <= x <= highest_x and lowest_y <= y <= highest_y and lowest_z <= z <= highest_z):
            outside = max(
                lowest_x - x, x - highest_x, lowest_y - y, y - highest_y, lowest_z - z, z - highest_z
            )
            if outside > bounds.slack:
                return _beyond(outside * 1e3, "mm outside the workspace")
        if turned and bounds.tilt < math.pi:
            over = _tilt(bounds.start.quaternion, pose.quaternion) - bounds.tilt
            if not over <= TURN_SLACK_RAD:  # also catches NaN
                return _beyond(math.degrees(over), "° tilted more than allowed")
        return ""

    def _judge_step(self, pose: Pose, turned: bool, now: float) -> str:
        """Return the reason why the step from the last pose is too fast. Return "" if it is not; the pose then
        counts as ordered.
        """
        bounds, last = self.bounds, self._last
        slack, time, passed, turn = bounds.slack, bounds.time, now - self._at, 0.0
        (x, y, z), (i, j, k), (a, b, c) = pose.position, last.position, bounds.approach
        x, y, z = x - i, y - j, z - k
        along = a * x + b * y + c * z
        aside = x * x + y * y + z * z - along * along
        deeper, across, away = self._deeper, self._across, self._away
        if passed > 0.0:
            deeper, across, away = (
                deeper - bounds.deeper * passed,
                across - bounds.across * passed,
                away - bounds.away * passed,
            )
        deeper = (deeper if deeper > 0.0 else 0.0) + (along if along > 0.0 else 0.0)
        if (over := deeper - bounds.deeper * time - slack) > 0.0:
            return _beyond(over * 1e3, "mm into the surface faster than allowed")
        across = (across if across > 0.0 else 0.0) + (math.sqrt(aside) if aside > 0.0 else 0.0)
        if (over := across - bounds.across * time - slack) > 0.0:
            return _beyond(over * 1e3, "mm across the approach faster than allowed")
        away = (away if away > 0.0 else 0.0) - (along if along < 0.0 else 0.0)
        if (over := away - bounds.away * time - slack) > 0.0:
            return _beyond(over * 1e3, "mm off the surface faster than allowed")
        if turned:
            turn = _turn(last.quaternion, pose.quaternion)
            turn += max(self._turned - bounds.turn * (now - self._turned_at), 0.0)
            over = turn - bounds.turn * time - TURN_SLACK_RAD
            if not over <= 0.0:  # also catches NaN
                return _beyond(math.degrees(over), "° turned faster than allowed")
        self._before = last, self._at, self._turned_at, self._deeper, self._across, self._away, self._turned
        if turned:
            self._turned, self._turned_at = turn, now
        self._last, self._at = pose, now
        self._deeper, self._across, self._away = deeper, across, away
        return ""

    def take_back(self) -> None:
        """Undo the newest pose because the robot has not accepted it. The next step is checked from the previous
        pose.
        """
        self._last, self._at, self._turned_at, *credits_used = self._before
        self._deeper, self._across, self._away, self._turned = credits_used


def _reach(corner: Vector, position: Vector, choose: Callable[[float, float], float]) -> Vector:
    """Return a corner of the box. On each axis on which the tool is slightly outside the box, the corner is moved
    to the tool.
    """
    x, y, z = (
        choose(border, at) if abs(at - border) <= OUTSIDE_M else border
        for border, at in zip(corner, position, strict=True)
    )
    return x, y, z


def _beyond(amount: float, excess: str) -> str:
    return _stopped(f"that is {amount:.1f} {excess}")


def _stopped(description: str) -> str:
    return f"the last gate stopped an order {description}; {REPORT}"


def depth_of(position: Vector, bounds: Bounds) -> float:
    """Return the depth of a position below the start, m."""
    (x, y, z), (u, v, w), (a, b, c) = position, bounds.start.position, bounds.approach
    return a * (x - u) + b * (y - v) + c * (z - w)


def contradiction(position: Vector, origin: Vector, approach: Vector, depth: float) -> str:
    """Return the reason why a position contradicts the decided depth below an origin, or "" if it does not. All
    values are in m.
    """
    (x, y, z), (u, v, w), (a, b, c) = position, origin, approach
    apart = abs(a * (x - u) + b * (y - v) + c * (z - w) - depth)
    if apart <= CONTRADICTION_M:  # false for NaN
        return ""
    return f"the last gate stopped an order that is {apart * 1e3:.1f} mm from the depth that was decided; {REPORT}"


def _turn(start: Quaternion, goal: Quaternion) -> float:
    """Return the angle of the shorter rotation between two orientations, rad, or NaN if one of them is zero.

    The angle is computed from the lengths of sum and difference: unit quaternions at an angle α to each other
    differ by a rotation of 2α.
    """
    difference, total = _chords(start, goal)
    return 4.0 * math.atan2(min(difference, total), max(difference, total))


def _tilt(start: Quaternion, goal: Quaternion) -> float:
    """Return the angle between the tool axes of two orientations, rad, or NaN if one of them is zero."""
    difference, total = _chords(_axis(start), _axis(goal))
    return 2.0 * math.atan2(difference, total)


def _chords(a: Sequence[float], b: Sequence[float]) -> tuple[float, float]:
    """Return the lengths of the difference and the sum of two vectors, each normalized."""
    p, q = math.hypot(*a), math.hypot(*b)
    if not (p and q):
        return math.nan, math.nan
    pairs = [(x / p, y / q) for x, y in zip(a, b, strict=True)]
    return math.hypot(*(x - y for x, y in pairs)), math.hypot(*(x + y for x, y in pairs))


def _axis(q: Quaternion) -> Vector:
    """Return the tool axis in the base frame, scaled by the square of the orientation's norm."""
    w, x, y, z = q
    return 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), w * w - x * x - y * y + z * z
