"""Kinematics of arms with a spherical wrist: forward kinematics, all inverse solutions, and straight-line routes.

Lengths, ranges and speeds: project specification of the computer link, section 6. Angles are in rad, lengths in m.

Assumed, because zero positions and signs are not public: with all axes at zero, the arm points along base x and the
upper arm is upright. The forearm is level, with its own axis above axis 3, the wrist is straight, and the tool's x
axis points up. A tool that points down in front of the base therefore has axes 4 and 6 near zero. Axis 1 turns
about base z, which axis 2 crosses. Axes 2, 3 and 5 turn about y at zero (positive: down and forward). Axes 4 and 6
turn about the forearm's axis. All axes follow the right-hand rule.

Axis 3 is measured against the horizontal or against the upper arm; see `ArmSize.axis_3_against`. The wrist is
spherical.
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
"""Angle by which a posture may exceed the end of a range and still count as inside, rad."""
_ON_AXIS_1_M = 1e-6
"""Distance of the wrist from axis 1 below which the angle of axis 1 is undetermined, m."""
_STRAIGHT = 1e-4
"""Half the angle of axis 5 below which quaternion words of 1/16384 do not determine axis 4, rad. Derived."""


@dataclass(frozen=True, slots=True)
class Route:
    """Joint angles along a straight line, sampled densely enough for linear interpolation between the samples."""

    parts: tuple[float, ...]
    """Position of each sample as a fraction of the line, ascending from 0 to 1."""
    joints: tuple[Joints, ...]
    """Joint angles at each sample."""
    least_times: tuple[float, ...]
    """Shortest time from each sample to the next that the joint speeds allow, s. There is one time fewer than there
    are samples.
    """

    def at(self, part: float) -> Joints:
        """Return the joint angles at a fraction (0 … 1) of the line."""
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
        """Return the time of each sample, s after the first, in a motion with a duration of `duration`, s, or
        longer.

        The motion has constant speed, but slows down where a joint cannot follow. The result is empty if every
        joint can follow throughout.
        """
        stretches = [(b - a) * duration for a, b in zip(self.parts, self.parts[1:], strict=False)]
        if all(least <= even for least, even in zip(self.least_times, stretches, strict=True)):
            return ()
        return tuple(accumulate(map(max, self.least_times, stretches), initial=0.0))


class Arm:
    """An arm with a tool that extends `tool_length`, m, from the flange to the tool centre point along the flange's
    axis.
    """

    def __init__(self, profile: ArmSize, tool_length: float, axis_2_ahead: float = 0.0) -> None:
        """Create an arm. `axis_2_ahead` is the distance of axis 2 in front of axis 1 with all axes at zero, m."""
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
        """Middle of the range of each axis, rad."""
        self._speeds = [math.radians(speed) for speed in profile.axis_speeds_deg_s]
        self._fastest = max(self._speeds)
        self._ranges = [
            (middle - math.radians(reach) - _ROUNDING, middle + math.radians(reach) + _ROUNDING)
            for middle, reach in zip(self.middles, profile.axis_ranges_deg, strict=True)
        ]

    def pose(self, joints: Joints) -> Pose:
        """Return the pose of the tool at these joint angles."""
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
        """Return every posture within the ranges that holds the tool in a pose (m, unit quaternion).

        There are up to eight postures: arm turned to the front or to the back, elbow up or down, wrist flipped or
        not. The configuration of `near` comes first. Of angles that differ by full turns, the one closest to `near`
        is used. An angle that a singularity leaves undetermined, axis 1 or axis 4, remains as in `near`.
        """
        along = tool_axis(quaternion)
        (x, y, z), (u, v, w), reach = position, along, self._wrist_to_tip
        x, y, z = x - reach * u, y - reach * v, z - reach * w
        radius, height = math.hypot(x, y), z - self._axis_2_height
        upper, fore = self._upper_arm, self._forearm
        front = near[0] if radius < _ON_AXIS_1_M else math.atan2(y, x)
        tool = product(quaternion, _TO_ZERO)
        solutions = (front, radius - self._axis_2_ahead), (front + math.pi, -radius - self._axis_2_ahead)
        for turned, forward in solutions if math.cos(near[0] - front) >= 0.0 else solutions[::-1]:
            turn = self._unwrap(0, turned, near)
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
                lean = self._unwrap(1, leaning, near)
                if lean is None:
                    continue
                rise = math.atan2(height - upper * math.cos(lean), forward - upper * math.sin(lean))
                pitch = self._offset - rise
                third = self._unwrap(2, pitch - lean if self._rides else pitch, near)
                if third is None:
                    continue
                wrist = product(inverse(_forearm_frame(turn, pitch)), tool)
                for a4, a5, a6 in _wrist_angles(wrist, near[3]):
                    a, b, c = self._unwrap(3, a4, near), self._unwrap(4, a5, near), self._unwrap(5, a6, near)
                    if a is not None and b is not None and c is not None:
                        yield turn, lean, third, a, b, c

    def nearest(self, position: Vector, quaternion: Quaternion, near: Joints) -> Joints | None:
        """Return the posture that holds the tool in the pose with the least motion from `near`; None if no posture
        does.
        """
        nearest, least = None, math.inf
        for joints in self.postures(position, quaternion, near):
            effort = self._effort(near, joints)
            if effort < least:
                nearest, least = joints, effort
            if effort < self._nearest_effort(joints):
                break
        return nearest

    def _nearest_effort(self, joints: Joints) -> float:
        """Return a bound for the effort of a motion to these joint angles. Below it, no other posture of the same
        pose is nearer.

        Derived: any other configuration turns axis 1 or 4 by half a turn, or mirrors the bend by axes 2 and 3. The
        other posture is therefore at least as far from this one as the bend, or the difference between the bend and
        half a turn, at the speed of the fastest axis. Within half of that distance, no other posture is nearer.
        """
        bend = abs(self.bend(joints))
        return (min(bend, math.pi - bend) / 2.0 / self._fastest) ** 2

    def least_time(self, before: Joints, after: Joints) -> float:
        """Return the time that the slowest joint needs from one posture to another, s."""
        return max(abs(q - p) / speed for p, q, speed in zip(before, after, self._speeds, strict=True))

    def bend(self, joints: Joints) -> float:
        """Return the angle between the forearm and the straight arm, rad, -π … π. It is positive with the elbow up."""
        return math.remainder(math.pi / 2.0 - joints[1] - self._offset + self._pitch(joints), _TURN)

    def _pitch(self, joints: Joints) -> float:
        """Return the angle of the forearm below the horizontal, rad."""
        return joints[2] + joints[1] if self._rides else joints[2]

    def _unwrap(self, axis: int, angle: float, near: Joints) -> float | None:
        """Return the equivalent of `angle` that is inside the range and closest to `near`, rad; None if there is
        none.
        """
        low, high = self._ranges[axis]
        turns = (near[axis] - angle) / _TURN
        if not -0.5 <= turns <= 0.5:
            angle += _TURN * round(turns)
        if angle > high:
            angle -= _TURN
        elif angle < low:
            angle += _TURN
        return angle if low <= angle <= high else None

    def _effort(self, before: Joints, after: Joints) -> float:
        """Return the effort of a motion: the sum of the squared times of all joints, s². The time of the slowest
        joint alone would allow the other joints unnecessarily long motions.
        """
        effort = 0.0
        for p, q, speed in zip(before, after, self._speeds, strict=True):
            effort += ((q - p) / speed) ** 2
        return effort


def _wrist_angles(wrist: Quaternion, axis_4: float) -> tuple[tuple[float, float, float], ...]:
    """Return axes 4, 5 and 6 for the rotation of the flange relative to the forearm, rad, without full turns.

    The solution nearest to `axis_4` comes first. If the rotation leaves axis 4 undetermined, axis 4 remains at
    `axis_4`.
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
    solutions = (a, b, c), (a + math.pi, -b, c - math.pi)
    return solutions if math.cos(axis_4 - a) >= 0.0 else solutions[::-1]


def _forearm_frame(turn: float, pitch: float) -> Quaternion:
    """Return the rotation of the forearm from its zero position: `turn` about base z after `pitch` about y."""
    c, s = math.cos(turn / 2.0), math.sin(turn / 2.0)
    p, r = math.cos(pitch / 2.0), math.sin(pitch / 2.0)
    return c * p, -s * r, c * r, s * p


_TO_ZERO = inverse(_TOOL_AT_ZERO)
