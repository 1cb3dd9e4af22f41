"""Work area of an arm: the poses and straight lines that it can reach within its joint ranges and without a jump."""

import math

from protocol.arm_size import ArmSize
from protocol.geometry import Quaternion, Vector, angle_between, slerp
from protocol.kinematics import Arm, Joints, Route

_SPACING_M = 0.02
"""Largest spacing of the points on a line, m. Chosen, as is the angle below."""
_SPACING_RAD = math.radians(5.0)
_SMOOTH_RAD = math.radians(3.0)
"""Largest rotation of a joint between two points, rad. Where a joint rotates further, the spacing is halved."""
_HALVINGS = 4
"""Maximum number of halvings of the spacing, which is then 1.25 mm or 0.3°.

Assumed: between points this close, a flip of the wrist is not a jump, because the controller lets the orientation
deviate by such an amount.
"""
_JUMP_RAD = math.radians(100.0)
"""Rotation of a joint between the closest points above which the posture jumps, rad. It is larger than any regular
rotation: leaving a straight wrist sideways takes a quarter turn.
"""


class OutsideWorkArea(ValueError):
    """No posture, or no continuous sequence of postures, lies within the joint ranges."""


class WorkArea:
    """Reach of the arm with a tool of a given length, m. Poses are in the base frame, m, with unit quaternions."""

    def __init__(self, profile: ArmSize, tool_length: float) -> None:
        self._arm = Arm(profile, tool_length)
        self.pose = self._arm.pose
        """Function that returns the pose of the tool at joint angles, rad."""

    def joints(self, position: Vector, quaternion: Quaternion, near: Joints | None = None) -> Joints:
        """Return the joint angles for a pose that are nearest to `near`.

        The default of `near` is the middle of the joint ranges. Raises OutsideWorkArea if no joint angles within
        the ranges reach the pose.
        """
        joints = self._arm.nearest(position, quaternion, near or self._arm.middles)
        if joints is None:
            raise OutsideWorkArea("no joint angles within axis_ranges_deg reach the pose")
        return joints

    def route(
        self,
        start: Vector,
        start_quaternion: Quaternion,
        near: Joints,
        end: Vector,
        end_quaternion: Quaternion,
    ) -> Route:
        """Return the joint angles along the line between two poses, starting with the posture nearest to `near`.

        Raises OutsideWorkArea if the line leaves the ranges or needs a jump to another posture.
        """
        angle = angle_between(start_quaternion, end_quaternion)
        count = max(1, math.ceil(math.dist(start, end) / _SPACING_M), math.ceil(angle / _SPACING_RAD))
        parts, joints = [0.0], [self.joints(start, start_quaternion, near)]
        to_reach = [(k / count, _HALVINGS) for k in range(count, 0, -1)]
        """Points that remain to be reached, as shares of the line, the next point last, each with the number of
        halvings still allowed.
        """
        while to_reach:
            part, halvings = to_reach.pop()
            x, y, z = (a + (b - a) * part for a, b in zip(start, end, strict=True))
            before = joints[-1]
            after = self.joints((x, y, z), slerp(start_quaternion, end_quaternion, part), before)
            turn = max(abs(q - p) for p, q in zip(before, after, strict=True))
            if halvings and turn > _SMOOTH_RAD:
                to_reach += (part, halvings - 1), ((parts[-1] + part) / 2.0, halvings - 1)
                continue
            if turn > _JUMP_RAD or self._arm.bend(before) * self._arm.bend(after) < 0.0:
                raise OutsideWorkArea("the line needs a jump to another posture")
            parts.append(part)
            joints.append(after)
        least_times = map(self._arm.least_time, joints, joints[1:])
        return Route(tuple(parts), tuple(joints), tuple(least_times))
