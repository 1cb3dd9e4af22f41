"""Detection of forces across the approach that the force axes may miss, from the moments that they cause. Pure.

The tool's weight verifies the axes on which it acts. With an upright tool, the axes across the approach are not
verified. An axis that is dead, mirrored or wrongly scaled contradicts the moment: a force F at the tool's end
causes the moment l × F about the sensor. A sensor that is mounted at another angle rotates force and moment alike.
Then only the magnitude of the force across the approach is right, and its direction is wrong.
"""

import math
from typing import NamedTuple

from protocol.geometry import Vector

_SLACK_N = 1.0
"""Apparent force that noise and drift of the moments may cause with a common tool, N. Chosen."""
_SLACK_SHARE = 0.1
"""Share of the contact force that may appear as a force across the approach. Chosen: the position of the tool's end
is not known to the millimetre, nor is the tool's axis to the degree.
"""
HIDDEN_N = 10.0
"""Smallest force that the moments show and the force axes do not for which an axis counts as dead, N. Chosen: half
of `limits.against_travel_n`, and 2 N·m with a tool of 0.2 m, more than the moments of a peg in its hole.
"""
SHOWS_N = 0.5
"""Smallest force across the approach that the moments can confirm, N. Chosen: five times the noise."""
_CONFIRMED_SHARE = 0.5
"""Share of the force that the moments must show. Chosen: a contact nearer to the sensor causes a smaller moment."""


class Lever(NamedTuple):
    """Lever arm of the contact force, as far as the position of the contact is known."""

    reach: Vector
    """Vector from the sensor's origin to the centre of the tool's end, along the axes of the tool frame, m."""
    position: Vector
    """Origin of the sensor in the tool frame, m. Contact moments are about the origin of the tool frame."""
    radius: float = 0.0
    """Radius of the tool's end, m."""

    @property
    def length(self) -> float:
        """Length of the lever arm, m."""
        return math.hypot(*self.reach)


class Sideways(NamedTuple):
    """Force across the approach in one sample, compared with the moments."""

    hidden: float = 0.0
    """Force that the moments show and the force axes do not, N."""
    confirmed: bool = False
    """Whether force axes and moments show the same force across the approach."""


def compare_moment(lever: Lever, wrench: tuple[float, ...], approach: Vector, force: float) -> Sideways:
    """Compare the force across the approach with the moment about the sensor.

    `wrench`, shape (6,), is the contact wrench about the origin of the tool frame, N and N·m. `approach` is a unit
    vector. Both are along the axes of the tool frame. `force` is the contact force along the approach, N, positive
    while pressing.
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
    implied_force = (x * i + y * j + z * k) / implied if implied > 0.0 else 0.0
    slack = _SLACK_N + (_SLACK_SHARE + lever.radius / math.sqrt(square)) * abs(force)
    hidden = max(implied - implied_force - slack, 0.0)
    across = math.sqrt(x * x + y * y + z * z)
    return Sideways(hidden, across >= SHOWS_N and not hidden and implied_force >= _CONFIRMED_SHARE * across)


def is_confirmed_by_moments(lever: Lever | None, direction: Vector) -> bool:
    """Return whether the moments show a force in the given direction, a unit vector along the axes of the tool
    frame.
    """
    if lever is None or not lever.length:
        return False
    (a, b, c), (r, s, t) = direction, lever.reach
    moment = math.hypot(s * c - t * b, t * a - r * c, r * b - s * a)
    return moment >= _CONFIRMED_SHARE * lever.length
