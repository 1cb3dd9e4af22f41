"""Joints and poses of arms with a spherical wrist: forward kinematics, every inverse solution, and routes along a line.

Lengths, ranges and speeds: project specification of the computer link, section 6. Angles in rad, lengths in m.

Assumed, because zero positions and signs are not public. With all axes at zero the arm points along base x and the
upper arm stands upright. The forearm lies level with its own axis above axis 3, the wrist is straight, and the tool's x
axis points up. So a tool pointing down in front of the base has axes 4 and 6 near zero. Axis 1 turns about base z,
which axis 2 crosses. Axes 2, 3 and 5 turn about y at zero (positive: down and forward). Axes 4 and 6 turn about the
forearm's axis. All turn by the right hand.

Axis 3 is read against the horizon or against the upper arm, see `ArmSize.axis_3_against`. The wrist is spherical.
"""

import math
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate
from typing import TypeAlias

from protocol.arm_size import ArmSize
from protocol.geometry import Pose, Quaternion, Vector, inverse, product, tool_axis

Joints: TypeAlias = tuple[float, float, float, float, float, float]
"""Angles of axes 1 to 6, rad."""

_HALF = math.sqrt(0.5)
_TOOL_AT_ZERO: Quaternion = (0.0, _HALF, 0.0, _HALF)
"""Tool frame in the base frame with all joints at zero: z forward, x up."""
_TURN = 2.0 * math.pi
_ROUNDING = 1e-9
"""Angle by which a posture may lie beyond the end of a range, rad, and still count as inside."""
_ON_AXIS_1_M = 1e-6
"""A wrist nearer than this to axis 1 leaves its angle open."""
_STRAIGHT = 1e-4
"""Derived: half of the angle of axis 5, rad, below which the words of a quaternion, 1/16384, do not tell where
axis 4 stands.
"""


@dataclass(frozen=True, slots=True)
class Route:
    """The joints along a straight line, at places close enough together to go straight between them."""

    parts: tuple[float, ...]
    """Share of the line behind each place, ascending from 0 to 1."""
    joints: tuple[Joints, ...]
    """The joints at each place."""
    least_times: tuple[float, ...]
    """The least time from each place to the next that the joints' speeds allow, s; one fewer than places."""

    def at(self, part: float) -> Joints:
        """Return the joints after this part (0 … 1) of the line."""
        last = len(self.parts) - 1
        if part >= 1.0 or last == 0:
            return self.joints[last]
        k = bisect_right(self.parts, part) - 1
        share = (part - self.parts[k]) / (self.parts[k + 1] - self.parts[k])
        a, b, c, d, e, f = (
            p + (q - p) * share for p, q in zip(self.joints[k], self.joints[k + 1], strict=True)
        )
        return a, b, c, d, e, f

    def slowed(self, duration: float) -> tuple[float, ...]:
        """Return the times at which each place is passed, s after the first, in a motion of `duration`.

        The motion has constant speed, but slows down wherever a joint cannot follow; empty where all can.
        """
        stretches = [(b - a) * duration for a, b in zip(self.parts, self.parts[1:], strict=False)]
        if all(least <= even for least, even in zip(self.least_times, stretches, strict=True)):
            return ()
        return tuple(accumulate(map(max, self.least_times, stretches), initial=0.0))


class Arm:
    """The arm with a tool of some length, m, from the flange along the flange's axis to the tool centre point."""

    def __init__(self, profile: ArmSize, tool_length: float, axis_2_ahead: float = 0.0) -> None:
        """`axis_2_ahead` is the distance of axis 2 from axis 1, m: ahead of it with all axes at zero."""
        self._axis_2_height = profile.axis_2_height_mm / 1000.0
        self._axis_2_ahead = axis_2_ahead
        self._upper_arm = profile.upper_arm_mm / 1000.0
        self._forearm = math.hypot(profile.elbow_offset_mm, profile.forearm_mm) / 1000.0
        # From the line between axis 3 and the wrist down to the forearm's axis.
        self._offset = math.atan2(profile.elbow_offset_mm, profile.forearm_mm)
        self._wrist_to_tip = profile.wrist_to_flange_mm / 1000.0 + tool_length
        self._rides = profile.axis_3_against == "upper_arm"
        a, b, c, d, e, f = map(math.radians, profile.axis_middles_deg)
        self.middles: Joints = a, b, c, d, e, f
        """The middle of each range."""
        self._speeds = [math.radians(speed) for speed in profile.axis_speeds_deg_s]
        self._fastest = max(self._speeds)
        self._ranges = [
            (middle - math.radians(reach) - _ROUNDING, middle + math.radians(reach) + _ROUNDING)
            for middle, reach in zip(self.middles, profile.axis_ranges_deg, strict=True)
        ]

    def pose(self, joints: Joints) -> Pose:
        """Return the pose of the tool at these joints."""
        turn, lean, _, *wrist_angles = joints
        pitch = self._pitch(joints)
        radius = self._upper_arm * math.sin(lean) + self._forearm * math.cos(self._offset - pitch)
        radius += self._axis_2_ahead
        height = self._upper_arm * math.cos(lean) + self._forearm * math.sin(self._offset - pitch)
        a, b, c = (angle / 2.0 for angle in wrist_angles)
        wrist = (
            math.cos(b) * math.cos(a + c),
            math.cos(b) * math.sin(a + c),
            math.sin(b) * math.cos(a - c),
            math.sin(b) * math.sin(a - c),
        )
        quaternion = product(product(_forearm_frame(turn, pitch), wrist), _TOOL_AT_ZERO)
        along = tool_axis(quaternion)
        x, y, z = radius * math.cos(turn), radius * math.sin(turn), self._axis_2_height + height
        reach = self._wrist_to_tip
        return Pose((x + reach * along[0], y + reach * along[1], z + reach * along[2]), quaternion)

    def postures(self, position: Vector, quaternion: Quaternion, near: Joints) -> Iterator[Joints]:
        """Every way inside the ranges to hold the tool in a pose (m, unit quaternion). There are up to eight: arm
        turned to the front or to the back, elbow up or down, wrist flipped or not. The ways of `near` come first.

        Of angles a whole turn apart, the one next to `near` is taken. An angle that a singularity leaves open, axis 1
        or axis 4, stays as in `near`.
        """
        along = tool_axis(quaternion)
        (x, y, z), (u, v, w), reach = position, along, self._wrist_to_tip
        x, y, z = x - reach * u, y - reach * v, z - reach * w
        radius, height = math.hypot(x, y), z - self._axis_2_height
        upper, fore = self._upper_arm, self._forearm
        front = near[0] if radius < _ON_AXIS_1_M else math.atan2(y, x)
        tool = product(quaternion, _TO_ZERO)
        ways = (front, radius - self._axis_2_ahead), (front + math.pi, -radius - self._axis_2_ahead)
        for turned, forward in ways if math.cos(near[0] - front) >= 0.0 else ways[::-1]:
            turn = self._wound(0, turned, near)
            if turn is None:
                continue
            square = forward * forward + height * height
            distance = math.sqrt(square)
            if not abs(upper - fore) <= distance <= upper + fore or distance == 0.0:
                continue
            cosine = (upper * upper + square - fore * fore) / (2.0 * upper * distance)
            opening = math.acos(max(-1.0, min(1.0, cosine)))
            elevation = math.atan2(height, forward)
            for elbow in (opening, -opening) if self.bend(near) >= 0.0 else (-opening, opening):
                leaning = math.pi / 2.0 - elevation - elbow
                lean = self._wound(1, leaning, near)
                if lean is None:
                    continue
                rise = math.atan2(height - upper * math.cos(lean), forward - upper * math.sin(lean))
                pitch = self._offset - rise
                third = self._wound(2, pitch - lean if self._rides else pitch, near)
                if third is None:
                    continue
                wrist = product(inverse(_forearm_frame(turn, pitch)), tool)
                for a4, a5, a6 in _wrist_angles(wrist, near[3]):
                    a, b, c = self._wound(3, a4, near), self._wound(4, a5, near), self._wound(5, a6, near)
                    if a is not None and b is not None and c is not None:
                        yield turn, lean, third, a, b, c

    def nearest(self, position: Vector, quaternion: Quaternion, near: Joints) -> Joints | None:
        """Return the posture that holds the pose with the least motion from `near`, or None if none does."""
        nearest, least = None, math.inf
        for joints in self.postures(position, quaternion, near):
            effort = self._effort(near, joints)
            if effort < least:
                nearest, least = joints, effort
            if effort < self._surely_nearest(joints):
                break
        return nearest

    def _surely_nearest(self, joints: Joints) -> float:
        """Effort of a motion to these joints for which no other posture of the same pose takes less.

        Derived: another way turns axis 1 or 4 by half a turn, or mirrors the bend by axes 2 and 3. So it lies farther
        than the bend and its rest to half a turn, at the fastest axis's speed. Within half of that nothing is nearer.
        """
        bend = abs(self.bend(joints))
        return (min(bend, math.pi - bend) / 2.0 / self._fastest) ** 2

    def least_time(self, before: Joints, after: Joints) -> float:
        """Time of the slowest joint from one posture to another, s."""
        return max(abs(q - p) / speed for p, q, speed in zip(before, after, self._speeds, strict=True))

    def bend(self, joints: Joints) -> float:
        """Angle of the forearm from the straight arm, rad, -π … π: positive with the elbow up."""
        return math.remainder(math.pi / 2.0 - joints[1] - self._offset + self._pitch(joints), _TURN)

    def _pitch(self, joints: Joints) -> float:
        """Return the forearm's angle below the horizon."""
        return joints[2] + joints[1] if self._rides else joints[2]

    def _wound(self, axis: int, angle: float, near: Joints) -> float | None:
        """Return the angle, up to whole turns, inside the range and next to `near`; None if there is none."""
        low, high = self._ranges[axis]
        angle += _TURN * round((near[axis] - angle) / _TURN)
        if angle > high:
            angle -= _TURN
        elif angle < low:
            angle += _TURN
        return angle if low <= angle <= high else None

    def _effort(self, before: Joints, after: Joints) -> float:
        """Squares, because the slowest joint alone would leave the other ones free to go the long way round."""
        effort = 0.0
        for p, q, speed in zip(before, after, self._speeds, strict=True):
            effort += ((q - p) / speed) ** 2
        return effort


def _wrist_angles(wrist: Quaternion, axis_4: float) -> tuple[tuple[float, float, float], ...]:
    """Axes 4, 5 and 6, not wound, for the flange's turn against the forearm; the way next to `axis_4` comes first, and
    stands where the turn leaves it open.
    """
    # With half angles a, b, c: w = cos b cos(a + c), x = cos b sin(a + c), y = sin b cos(a - c), z = sin b sin(a - c).
    w, x, y, z = wrist
    aside = math.hypot(y, z)
    total = 2.0 * math.atan2(x, w)
    if aside < _STRAIGHT:
        return ((axis_4, 0.0, total - axis_4),)
    half_difference = math.atan2(z, y)
    a, c = total / 2.0 + half_difference, total / 2.0 - half_difference
    b = 2.0 * math.atan2(aside, math.hypot(w, x))
    ways = (a, b, c), (a + math.pi, -b, c - math.pi)
    return ways if math.cos(axis_4 - a) >= 0.0 else ways[::-1]


def _forearm_frame(turn: float, pitch: float) -> Quaternion:
    """Return the rotation of the forearm from its zero position: `turn` about base z after `pitch` about y."""
    c, s = math.cos(turn / 2.0), math.sin(turn / 2.0)
    p, r = math.cos(pitch / 2.0), math.sin(pitch / 2.0)
    return c * p, -s * r, c * r, s * p


_TO_ZERO = inverse(_TOOL_AT_ZERO)
