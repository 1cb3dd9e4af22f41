"""Forces across the approach that the force axes may not show, judged by the moments that they make. Pure.

The tool's weight verifies the axes on which it lies. With an upright tool these are not the axes across the approach.
One that is dead, mirrored or scaled wrongly contradicts the moment: a force F at the tool's end makes l × F about the
sensor. A sensor that is mounted at another angle turns force and moment alike. Then only the length of the force across
the approach is right, and its direction is not.
"""

import math
from typing import NamedTuple

from protocol.geometry import Vector

_SLACK_N = 1.0
"""Chosen: force that noise and drift of the moments may make at a common tool, N."""
_SLACK_SHARE = 0.1
"""Chosen: share of the contact force that may come out as a force across the approach, for the tool's end is not known
to the millimetre and its axis not to the degree.
"""
HIDDEN_N = 10.0
"""Chosen: force that the moments show and the force axes do not, from which an axis counts as dead, N: half of
`limits.against_travel_n`, and 2 N·m at a tool of 0.2 m, more than the moments of a peg in its hole.
"""
SHOWS_N = 0.5
"""Chosen: force across the approach from which the moments can confirm it, N: five times the noise."""
_CONFIRMED_SHARE = 0.5
"""Chosen: part of it that they must show. A tool that touches nearer to the sensor makes a smaller moment."""


class Lever(NamedTuple):
    """Place of the contact, as far as it is known."""

    reach: Vector
    """From the sensor's origin to the middle of the tool's end, along the tool frame's axes, m."""
    position: Vector
    """Sensor's origin in the tool frame, m: contact moments are told about that frame's origin."""
    radius: float = 0.0
    """Radius of the tool's end, m."""

    @property
    def length(self) -> float:
        """m"""
        return math.hypot(*self.reach)


class Sideways(NamedTuple):
    """Force across the approach of one sample, compared with the moments."""

    hidden: float = 0.0
    """Force that the moments show and the force axes do not, N."""
    confirmed: bool = False
    """Force axes and moments show the same force across the approach."""


def compare_moment(lever: Lever, wrench: tuple[float, ...], approach: Vector, force: float) -> Sideways:
    """Compare the force across the approach with the moment about the sensor.

    `wrench` (6,) is the contact wrench about the tool frame's origin, N and N·m, `approach` a unit vector, both along
    the tool frame's axes. `force` is the contact force along the approach, N, positive while pressing.
    """
    (x, y, z, u, v, w), (a, b, c), (r, s, t), (p, q, o) = wrench, approach, lever.reach, lever.position
    # about the sensor, without the moment of the force along the approach
    u = u - (q * z - o * y) + force * (s * c - t * b)
    v = v - (o * x - p * z) + force * (t * a - r * c)
    w = w - (p * y - q * x) + force * (r * b - s * a)
    square = r * r + s * s + t * t
    # the force perpendicular to the lever that makes this moment
    i, j, k = (v * t - w * s) / square, (w * r - u * t) / square, (u * s - v * r) / square
    implied = math.sqrt(i * i + j * j + k * k)
    x, y, z = x + force * a, y + force * b, z + force * c
    shown = (x * i + y * j + z * k) / implied if implied > 0.0 else 0.0
    slack = _SLACK_N + (_SLACK_SHARE + lever.radius / math.sqrt(square)) * abs(force)
    hidden = max(implied - shown - slack, 0.0)
    across = math.sqrt(x * x + y * y + z * z)
    return Sideways(hidden, across >= SHOWS_N and not hidden and shown >= _CONFIRMED_SHARE * across)


def is_vouched(lever: Lever | None, direction: Vector) -> bool:
    """Whether a force in this direction, a unit vector along the tool frame's axes, shows in the moments."""
    if lever is None or not lever.length:
        return False
    (a, b, c), (r, s, t) = direction, lever.reach
    moment = math.hypot(s * c - t * b, t * a - r * c, r * b - s * a)
    return moment >= _CONFIRMED_SHARE * lever.length
