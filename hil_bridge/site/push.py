"""Mounting of a force sensor, derived from pushes by hand. Pure functions.

A push by hand along a tool axis is a force of the environment on the tool along that axis. The change of the sensor
reading identifies the responding sensor axis and its sign. Three such pushes determine the mounting.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hil_bridge.control import Wrist, quaternion_of
from protocol.geometry import Quaternion
from protocol.wrench import AXES

LEAST_N = 5.0
"""Smallest force that counts as a push, N. Chosen: a light push, far above the weight of a resting hand."""
NOISE_FACTOR = 10.0
"""Smallest ratio of a push to the noise of the force. Chosen."""
SURE_SHARE = 0.87
"""Share of the force on one axis above which that axis is identified. Chosen: the push is within 30° of the axis."""
RIGHT_ANGLE_DEG = 20.0
"""Largest deviation of a push from a multiple of a right angle, °. Chosen: pushes by hand are not more precise."""

_FORCES = 3
_SQUARE = 90.0


@dataclass(frozen=True, slots=True)
class PushResponse:
    """Response of the sensor to a push."""

    axis: str
    """Sensor axis with the largest change: fx, fy or fz."""
    sign: int
    force_n: float
    """Magnitude of the change in force, N."""
    share: float
    """Cosine of the angle between the push and the responding axis, 0 … 1."""
    direction: tuple[float, ...]
    """Direction of the change in force, as a unit vector in the sensor frame."""

    @property
    def sure(self) -> bool:
        """Whether a single axis responded."""
        return self.share >= SURE_SHARE

    @property
    def text(self) -> str:
        """Description of the response."""
        named = f"{'+' if self.sign > 0 else '−'}{self.axis.capitalize()}"
        if self.sure:
            return f"{named} responds: {self.force_n:.1f} N, {self.share:.0%} of it on this axis"
        return f"not sure: {named} has {self.share:.0%} of {self.force_n:.1f} N; push straight along the axis"


@dataclass(frozen=True, slots=True)
class Mounting:
    """Mounting settings derived from the pushes."""

    flip_fx_mx: bool
    mounting_deg: float
    quaternion: Quaternion
    """Rotation from sensor frame to tool frame, w x y z, in addition to `mounting_deg`."""
    off_deg: float
    """Largest deviation of a push, °."""

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
    """Return the smallest magnitude of a push for this noise, N. `noise` is the rms of each axis, N."""
    return max(LEAST_N, NOISE_FACTOR * math.hypot(*noise[:_FORCES]))


def judge_push(
    before: Sequence[float], during: Sequence[float], noise: Sequence[float]
) -> PushResponse | None:
    """Return the response of the mean wrench to a push, sensor frame, N and N·m, or None if the push is too weak to
    judge.
    """
    change = [during[k] - before[k] for k in range(_FORCES)]
    length = math.hypot(*change)
    if not length >= push_threshold(noise):
        return None
    direction = tuple(part / length for part in change)
    k = max(range(_FORCES), key=lambda k: abs(direction[k]))
    return PushResponse(AXES[k], 1 if direction[k] > 0.0 else -1, length, abs(direction[k]), direction)


def expect_push(wrist: Wrist, axis: int) -> PushResponse:
    """Return the expected response, for this mounting, to a push of 1 N along a tool axis: 0 x, 1 y, 2 z."""
    expected = wrist.alignment()[axis].tolist()
    answer = judge_push((0.0,) * _FORCES, [LEAST_N * part for part in expected], (0.0,) * _FORCES)
    assert answer is not None
    return answer


def angle_deg(a: Sequence[float], b: Sequence[float]) -> float:
    """Return the angle between two unit vectors, °."""
    return math.degrees(math.acos(max(-1.0, min(1.0, sum(x * y for x, y in zip(a, b, strict=True))))))


def mounting_of(pushes: Mapping[int, PushResponse]) -> Mounting | None:
    """Return the mounting that results from a push along each tool axis: 0 x, 1 y, 2 z.

    Return None while a push is missing, or if two pushes have the same responding axis. Right angles are assumed if
    every push is within `RIGHT_ANGLE_DEG` of one.
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
