"""Which poses and which straight lines the arm can follow, inside its joints' ranges and without a jump."""

import math

from protocol.arm_size import ArmSize
from protocol.geometry import Quaternion, Vector, angle_between, slerp
from protocol.kinematics import Arm, Joints, Route

_SPACING_M = 0.02
"""Chosen, as the angle below: places on a line are at most this far apart."""
_SPACING_RAD = math.radians(5.0)
_SMOOTH_RAD = math.radians(3.0)
"""Where a joint turns further than this from place to place, places are put closer together, …"""
_HALVINGS = 4
"""… by halves, this often: down to 1.25 mm or 0.3°. Assumed: between places that near, a flip of the wrist is no
jump, the controller lets the orientation give way by as little.
"""
_JUMP_RAD = math.radians(100.0)
"""More than any joint turns between the nearest places: leaving a straight wrist sideways takes a quarter turn."""


class OutsideWorkArea(ValueError):
    """No posture, or no continuous line of postures, inside the joints' ranges."""


class WorkArea:
    """Reach of the arm with a tool of some length, m. Poses are in the base frame, m, unit quaternions."""

    def __init__(self, profile: ArmSize, tool_length: float) -> None:
        self._arm = Arm(profile, tool_length)
        self.pose = self._arm.pose
        """Pose of the tool at joint angles, rad."""

    def joints(self, position: Vector, quaternion: Quaternion, near: Joints | None = None) -> Joints:
        """Return the posture nearest to `near`, by default to the middle of the ranges. Raises OutsideWorkArea."""
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
        """Return the joints along the line between two poses, from the posture of its start nearest to `near`.

        Raises OutsideWorkArea where the line leaves the ranges or would need a jump to another posture.
        """
        angle = angle_between(start_quaternion, end_quaternion)
        count = max(1, math.ceil(math.dist(start, end) / _SPACING_M), math.ceil(angle / _SPACING_RAD))
        parts, joints = [0.0], [self.joints(start, start_quaternion, near)]
        to_reach = [(k / count, _HALVINGS) for k in range(count, 0, -1)]
        """Parts of the line, the next one last, each with how often the way to it may be halved."""
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
