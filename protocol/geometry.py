"""Positions, orientations and wrenches as plain values: the one place for all devices, emulators and the bridge.

SI units inside: m, N, N·m. The base frame is the robot's own. The tool frame lies in the tool centre point.
"""

import math
from typing import NamedTuple, TypeAlias

Vector: TypeAlias = tuple[float, float, float]
"""x y z. Field and argument say the frame and the unit; a position without a word is the tool in the base frame, m."""
Quaternion: TypeAlias = tuple[float, float, float, float]
"""w x y z. It turns vectors of the tool frame into vectors of the base frame unless its field says otherwise."""
Wrench: TypeAlias = tuple[float, float, float, float, float, float]
"""fx fy fz mx my mz, N and N·m, about the origin of the frame that its field names."""


class Pose(NamedTuple):
    """Where the tool is and how it stands."""

    position: Vector
    """Tool centre point in the base frame, m."""
    quaternion: Quaternion
    """Tool frame in the base frame, w x y z."""


def _sine(start: Quaternion, goal: Quaternion) -> float:
    """Sine of half the turn from one orientation to another, of the lengths of both."""
    w, x, y, z = start
    a, b, c, d = goal
    return math.hypot(
        b * w - a * x - c * z + d * y, c * w - a * y - d * x + b * z, d * w - a * z - b * y + c * x
    )


def towards(start: Pose, goal: Pose, distance: float, angle: float) -> Pose:
    """The next pose on the straight way from `start` to `goal`; the goal itself when it is near enough.

    It is at most `distance`, m, and `angle`, rad, away from the start. Way and turn end together; the turn is the
    shorter one. Both orientations have unit length within rounding.
    """
    apart = math.dist(start.position, goal.position)
    (a, b, c, d), (e, f, g, h) = start.quaternion, goal.quaternion
    cosine = a * e + b * f + c * g + d * h
    half = math.atan2(
        _sine(start.quaternion, goal.quaternion), abs(cosine)
    )  # exact for the smallest turn too
    share = min(distance / apart if apart else 1.0, angle / (2.0 * half) if half else 1.0)
    if share >= 1.0 - 1e-9:  # what rounding leaves of a way
        return goal
    here, there = 1.0 - share, math.copysign(share, cosine)
    if half > 1e-6:  # below, the chord is the arc
        here, there = (math.copysign(math.sin(abs(part) * half), part) for part in (here, there))
    w, i, j, k = here * a + there * e, here * b + there * f, here * c + there * g, here * d + there * h
    norm = math.hypot(w, i, j, k)
    (x, y, z), (u, v, t) = start.position, goal.position
    return Pose(
        (x + (u - x) * share, y + (v - y) * share, z + (t - z) * share),
        (w / norm, i / norm, j / norm, k / norm),
    )
