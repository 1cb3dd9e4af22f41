"""The last gate: what is looked at once more on the very pose that goes to a robot, by arithmetic of its own.

It stands behind all that decides, and shares no code with it. So it stops what a bug there lets through, and nothing
else: its bounds are a little wider than what may be ordered. A pose that it stops is not sent.

Ways are counted against a credit. The credit grows with the time by the largest speed, and holds no more than some time
of it. Deciding takes another time in every cycle, so two orders may come sooner one after the other than was decided.
"""

import math
from dataclasses import dataclass

from protocol.geometry import Pose, Quaternion, Vector

REPORT = "this is a bug of the program: report it with the recording"
"""Words at the end of each sentence of the gate."""
FARTHEST_M = 100.0
"""Coordinates beyond are none of an arm. Chosen: ten times the reach of the largest arms."""
UNIT = 0.02
"""Chosen: how far the norm of an orientation may be from 1; twice what a robot's words are taken with."""
TURN_SLACK_RAD = math.radians(0.2)
"""Chosen: slack of a turn and of a tilt; some words of 1/16384."""
SLACK_M = 1e-6
"""Slack of a way and of a place beside the robot's words, m. Chosen: far above the error of the arithmetic."""
CONTRADICTION_M = 1e-4
"""Largest distance between the depth that was decided and that of the pose, m. Chosen: below one step of a coarse
robot, and ten times what the guard allows.
"""

_ORIGIN = Pose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))


@dataclass(frozen=True, slots=True)
class Bounds:
    """Bounds of what may be ordered in one movement; without any given, only what is no pose is stopped."""

    start: Pose = _ORIGIN
    """Depth and tilt count from here."""
    approach: Vector = (0.0, 0.0, 1.0)
    """Unit vector into the surface, base frame."""
    deepest: float = math.inf
    """Farthest from the start along the approach, m."""
    low: Vector = (-FARTHEST_M,) * 3
    """Lowest corner of the box of the orders, base frame, m."""
    high: Vector = (FARTHEST_M,) * 3
    """Its highest corner."""
    tilt: float = math.inf
    """Largest angle of the tool's axis with that of the start, rad."""
    deeper: float = math.inf
    """Largest speed into the surface, m/s."""
    across: float = math.inf
    """Largest speed across the approach, m/s."""
    away: float = math.inf
    """Largest speed against the approach, m/s."""
    turn: float = math.inf
    """Largest speed of turning, rad/s."""
    time: float = 1.0
    """Time for which a credit of way is kept, s."""
    slack: float = SLACK_M
    """Slack of a place, m: what the robot's words round."""


class Gate:
    """Judges the poses of one movement, one after the other."""

    def __init__(self, bounds: Bounds, now: float, pose: Pose | None = None) -> None:
        """`pose` is where the tool stands, by default the start of the bounds; `now` is the time, s."""
        self.bounds = bounds
        self._last, self._at = pose or bounds.start, now
        self._spent = [0.0] * 4
        """Of each credit, what has been used and has not grown again: deeper, across, away, turned."""

    def judge(self, pose: Pose, now: float, deepest: float = math.inf) -> str:
        """Why this pose must not go to the robot, in words; empty where it may, and counts as ordered.

        `deepest` is one more bound of the depth, m.
        """
        bounds = self.bounds
        if wrong := _no_pose(pose):
            return f"the last gate stopped an order to {wrong}; {REPORT}"
        depth, limit = depth_of(pose.position, bounds), min(bounds.deepest, deepest)
        beyond, unit = 0.0, "mm"
        words = ""
        if depth > limit + bounds.slack:
            beyond, words = (depth - limit) * 1e3, "deeper than the deepest that may be ordered"
        for low, place, high in zip(bounds.low, pose.position, bounds.high, strict=True):
            outside = max(low - place, place - high)
            if outside > bounds.slack and not words:
                beyond, words = outside * 1e3, "outside the workspace"
        if not words and math.isfinite(bounds.tilt):
            over = _tilt(bounds.start.quaternion, pose.quaternion) - bounds.tilt
            if over > TURN_SLACK_RAD:
                beyond, unit, words = math.degrees(over), "°", "tilted more than may be ordered"
        if not words:
            beyond, unit, words = self._pay(pose, depth, now)
        return (
            f"the last gate stopped an order that is {beyond:.1f} {unit} {words}; {REPORT}" if words else ""
        )

    def _pay(self, pose: Pose, depth: float, now: float) -> tuple[float, str, str]:
        """Take the way to this pose off the credits. Where they do not last: by how much, its unit, and words."""
        bounds, last = self.bounds, self._last
        passed, along = max(now - self._at, 0.0), depth - depth_of(last.position, bounds)
        length = math.dist(pose.position, last.position)
        ways = (
            (max(along, 0.0), bounds.deeper, bounds.slack, "into the surface faster than may be ordered"),
            (
                math.sqrt(max(length * length - along * along, 0.0)),
                bounds.across,
                bounds.slack,
                "across the approach faster than may be ordered",
            ),
            (max(-along, 0.0), bounds.away, bounds.slack, "off the surface faster than may be ordered"),
            (
                0.0 if pose.quaternion == last.quaternion else turn_between(last.quaternion, pose.quaternion),
                bounds.turn,
                TURN_SLACK_RAD,
                "turned faster than may be ordered",
            ),
        )
        spent = []
        for before, (way, speed, slack, words) in zip(self._spent, ways, strict=True):
            if speed == math.inf:
                spent.append(0.0)
                continue
            used = max(before - speed * passed, 0.0) + way
            over = used - (speed * bounds.time + slack)
            if over > 0.0:
                turned = slack is TURN_SLACK_RAD
                return (math.degrees(over), "°", words) if turned else (over * 1e3, "mm", words)
            spent.append(used)
        self._last, self._at, self._spent = pose, now, spent
        return 0.0, "", ""


def depth_of(position: Vector, bounds: Bounds) -> float:
    """Depth of a place below the start, m."""
    (x, y, z), (u, v, w), (a, b, c) = position, bounds.start.position, bounds.approach
    return a * (x - u) + b * (y - v) + c * (z - w)


def contradiction(position: Vector, origin: Vector, approach: Vector, depth: float) -> str:
    """Why a place, m, cannot have the depth below an origin that was decided, m; empty where it has."""
    (x, y, z), (u, v, w), (a, b, c) = position, origin, approach
    apart = abs(a * (x - u) + b * (y - v) + c * (z - w) - depth)
    if apart <= CONTRADICTION_M:  # false for what is no number
        return ""
    return f"the last gate stopped an order that is {apart * 1e3:.1f} mm from the depth that was decided; {REPORT}"


def _no_pose(pose: Pose) -> str:
    if not all(abs(part) <= FARTHEST_M for part in pose.position):
        return f"the position {pose.position}, which is none of an arm"
    if not abs(math.hypot(*pose.quaternion) - 1.0) <= UNIT:
        return f"the orientation {pose.quaternion}, which is none"
    return ""


def turn_between(start: Quaternion, goal: Quaternion) -> float:
    """The shorter turn between two orientations, rad."""
    (w, x, y, z), (a, b, c, d) = start, goal
    cosine = w * a + x * b + y * c + z * d
    sine = math.hypot(
        w * b - x * a - y * d + z * c, w * c + x * d - y * a - z * b, w * d - x * c + y * b - z * a
    )
    return 2.0 * math.atan2(sine, abs(cosine))


def _tilt(start: Quaternion, goal: Quaternion) -> float:
    """Angle between the tool's axes of two orientations, rad."""
    (a, b, c), (u, v, w) = _axis(start), _axis(goal)
    return math.atan2(math.hypot(b * w - c * v, c * u - a * w, a * v - b * u), a * u + b * v + c * w)


def _axis(q: Quaternion) -> Vector:
    """The tool's axis, base frame, as long as the square of the orientation's norm."""
    w, x, y, z = q
    return 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), w * w - x * x - y * y + z * z
