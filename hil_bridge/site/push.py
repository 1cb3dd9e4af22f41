"""Mounting of a force sensor from pushes by hand. Pure.

A hand that pushes along an axis of the tool is a force of the environment on the tool along that axis. The sensor's
reading less the one before it then names the axis that answers, and its sign; three such pushes name the mounting.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hil_bridge.control import Wrist, quaternion_of
from protocol.geometry import Quaternion
from protocol.wrench import AXES

LEAST_N = 5.0
"""Least force that counts as a push. Chosen: a light one, far above the weight of a resting hand."""
NOISE_FACTOR = 10.0
"""A push is at least so many times the noise of the force. Chosen."""
SURE_SHARE = 0.87
"""Share of the force on one axis above which that axis is named for sure. Chosen: within 30° of it."""
RIGHT_ANGLE_DEG = 20.0
"""How far from a multiple of a right angle a hand may be off. Chosen: an operator does not push straighter."""

_FORCES = 3
_SQUARE = 90.0


@dataclass(frozen=True, slots=True)
class Answer:
    """Answer of the sensor to a push."""

    axis: str
    """Axis of the sensor that changed most: fx, fy or fz."""
    sign: int
    force_n: float
    """Length of the change of the force."""
    share: float
    """Share of the push on that axis, 0 … 1: the cosine of the angle between them."""
    direction: tuple[float, ...]
    """Unit vector of the change along the sensor's axes."""

    @property
    def sure(self) -> bool:
        """Whether a single axis responded."""
        return self.share >= SURE_SHARE

    @property
    def text(self) -> str:
        """The answer in words."""
        named = f"{'+' if self.sign > 0 else '−'}{self.axis.capitalize()}"
        if self.sure:
            return f"{named} responds: {self.force_n:.1f} N, {self.share:.0%} of it on this axis"
        return f"not sure: {named} has {self.share:.0%} of {self.force_n:.1f} N; push straight along the axis"


@dataclass(frozen=True, slots=True)
class Mounting:
    """Mounting settings that explain the pushes."""

    flip_fx_mx: bool
    mounting_deg: float
    quaternion: Quaternion
    """Sensor frame in the tool frame, w x y z, beside `mounting_deg`."""
    off_deg: float
    """Largest deviation of a push."""

    @property
    def settings(self) -> tuple[str, ...]:
        """Lines for the section [sensor] of a configuration."""
        quaternion = ", ".join(repr(round(part, 4) + 0.0) for part in self.quaternion)
        return (
            f"flip_fx_mx = {str(self.flip_fx_mx).lower()}",
            f"mounting_deg = {self.mounting_deg!r}",
            f"quaternion = [{quaternion}]",
        )


def push_threshold(noise: Sequence[float]) -> float:
    """Least length of a push, N, where the forces are as noisy as that: rms of each axis, N."""
    return max(LEAST_N, NOISE_FACTOR * math.hypot(*noise[:_FORCES]))


def judge_push(before: Sequence[float], during: Sequence[float], noise: Sequence[float]) -> Answer | None:
    """Change of the mean wrench by a push, sensor frame, N and N·m; None where it is too weak to tell."""
    change = [during[k] - before[k] for k in range(_FORCES)]
    length = math.hypot(*change)
    if not length >= push_threshold(noise):
        return None
    direction = tuple(part / length for part in change)
    k = max(range(_FORCES), key=lambda k: abs(direction[k]))
    return Answer(AXES[k], 1 if direction[k] > 0.0 else -1, length, abs(direction[k]), direction)


def expect_push(wrist: Wrist, axis: int) -> Answer:
    """Answer of a sensor mounted as `wrist` says to a push of 1 N along an axis of the tool: 0 x, 1 y, 2 z."""
    seen = wrist.alignment()[axis].tolist()
    answer = judge_push((0.0,) * _FORCES, [LEAST_N * part for part in seen], (0.0,) * _FORCES)
    assert answer is not None
    return answer


def angle_deg(a: Sequence[float], b: Sequence[float]) -> float:
    """Between two unit vectors."""
    return math.degrees(math.acos(max(-1.0, min(1.0, sum(x * y for x, y in zip(a, b, strict=True))))))


def mounting_of(pushes: Mapping[int, Answer]) -> Mounting | None:
    """How the sensor sits, from a push along each axis of the tool: 0 x, 1 y, 2 z; None while one is missing, or where
    two of them were answered alike.

    A right angle is taken where every push is within `RIGHT_ANGLE_DEG` of one.
    """
    if set(pushes) != set(range(_FORCES)):
        return None
    measured = np.array([pushes[axis].direction for axis in range(_FORCES)])
    left, lengths, right = np.linalg.svd(measured)
    if lengths[-1] < math.sin(math.radians(RIGHT_ANGLE_DEG)):
        return None
    alignment = left @ right
    square = np.rint(alignment)
    upright = bool((np.abs(square).sum(axis=0) == 1.0).all() and (np.abs(square).sum(axis=1) == 1.0).all())
    if upright and all(angle_deg(a, b) <= RIGHT_ANGLE_DEG for a, b in zip(measured, square, strict=True)):
        alignment = square
    off = max(angle_deg(a, b) for a, b in zip(measured, alignment, strict=True))
    flip = bool(np.linalg.det(alignment) < 0.0)
    turned = alignment * ((-1.0, 1.0, 1.0) if flip else (1.0, 1.0, 1.0))
    if angle_deg(turned[:, 2], (0.0, 0.0, 1.0)) <= RIGHT_ANGLE_DEG:
        about_z = math.degrees(math.atan2(turned[1, 0], turned[0, 0]))
        return Mounting(flip, round(about_z) + 0.0, (1.0, 0.0, 0.0, 0.0), off)
    return Mounting(flip, 0.0, quaternion_of(turned), off)
