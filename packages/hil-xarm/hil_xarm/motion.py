"""Arm of the emulated control box: set points of the joints, their delay, position loops, and the path of the tool.

Each target is run to at once, as fast as the joints allow: there is no buffer and no interpolation between targets.
Angles are in degrees.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

from emulators.arm.chain import Chain, straight_tool
from emulators.arm.cycled import CycledPath
from emulators.arm.joint_loops import STILL, JointLoops, six
from emulators.arm.loops import PositionLoop
from emulators.seams import StartPose
from hil_xarm.arms import XARM_6, holding
from hil_xarm.profile import XarmProfile
from protocol.arm_size import PerAxis
from protocol.geometry import Pose, normalise, towards

_TURN_RAD_S = 1.0
"""Largest rotational speed of a straight motion, rad/s. Assumed."""


class Pace(NamedTuple):
    """Limits of a motion."""

    speed: float
    acceleration: float


class Line(NamedTuple):
    """Straight path of the tool in progress."""

    goal: Pose
    pace: Pace
    """Speed and acceleration along the path, m/s and m/s²."""


class Motion:
    """Joints of the arm, cycle by cycle."""

    def __init__(
        self, profile: XarmProfile, start: StartPose, now: float, decide: Callable[[float], object]
    ) -> None:
        """Power up stationary. `decide` is called with the begin of each cycle, s, and may set targets. Raises
        ValueError for a start pose that the arm cannot hold.
        """
        self._cycle, self._decide = profile.cycle_s, decide
        self.chain = Chain(XARM_6, straight_tool(start.tool_length))
        pose = Pose(start.position, normalise(start.quaternion))
        joints = holding(self.chain, pose)
        if joints is None:
            raise ValueError(
                "no joints of an xArm 6 hold the start pose; change start_position_mm or start_quaternion "
                f"(tool at {', '.join(f'{p * 1e3:g}' for p in start.position)} mm)"
            )
        self._fastest = Pace(profile.joint_speed_deg_s, profile.joint_acceleration_deg_s2)
        self.set_point = self.joints = joints
        """Set points, and joints at the begin of the current cycle."""
        self.set_speeds: PerAxis = STILL
        """Speeds of the set points, degrees/s."""
        self.tool_speed = 0.0
        """Speed of the tool's set point, m/s."""
        self._set_pose = pose
        self._goal: PerAxis = joints
        self._paces: tuple[Pace, ...] = (self._fastest,) * 6
        self._line: Line | None = None
        self._line_speed = 0.0
        loop = PositionLoop(profile.natural_frequency_rad_s, profile.damping_ratio)
        self.loops = JointLoops(joints, loop, profile.transport_delay_ms / 1e3, self._cycle)
        self.path = CycledPath(pose, now, self._cycle, self._step)

    @property
    def is_done(self) -> bool:
        """Whether the set points have reached the newest target."""
        return self._line is None and self.set_point == self._goal and self.set_speeds == STILL

    def aim(self, joints: PerAxis) -> None:
        """Run to these joints as fast as each of them can."""
        self._line, self._goal, self._paces = None, joints, (self._fastest,) * 6

    def move_joints(self, joints: PerAxis, pace: Pace) -> None:
        """Move to these joints together, the one with the longest path at this pace."""
        distances = [abs(to - at) for to, at in zip(joints, self.set_point, strict=True)]
        most = max(*distances, 1e-9)
        self._line, self._goal = None, joints
        shares = [distance / most for distance in distances]
        self._paces = tuple(Pace(*(max(part * share, 1e-6) for part in pace)) for share in shares)

    def move_line(self, goal: Pose, pace: Pace) -> None:
        """Move the tool straight to a pose."""
        self._line, self._line_speed = Line(goal, pace), 0.0

    def halt(self) -> None:
        """Brake at the largest deceleration."""
        self._line = None
        stop = self._fastest.acceleration
        self._goal = six(
            [q + v * abs(v) / (2.0 * stop) for q, v in zip(self.set_point, self.set_speeds, strict=True)]
        )
        self._paces = (self._fastest,) * 6

    def lock(self) -> None:
        """Stop at once where the arm is."""
        self._line, self._line_speed = None, 0.0
        self.set_point = self._goal = self.loops.joints
        self.set_speeds = STILL
        self.loops.rest(self.loops.joints)

    def _step(self, at: float) -> Pose:
        """Run the cycle that begins at a time, and return the pose of the tool at its end."""
        self.joints = self.loops.joints
        self._decide(at)
        before = self.set_point
        if self._line is not None:
            self._step_line(self._line)
        elif not self.is_done:
            self._step_joints()
        if self.set_point != before:
            pose = self.chain.pose(self.set_point)
            self.tool_speed = math.dist(pose.position, self._set_pose.position) / self._cycle
            self._set_pose = pose
        else:
            self.tool_speed = 0.0
        after = self.loops.follow(self.set_point, self.is_done)
        return self.path.pose if after == self.joints else self.chain.pose(after)

    def _step_joints(self) -> None:
        axes = zip(self.set_point, self.set_speeds, self._goal, self._paces, strict=True)
        moved = [_towards(at, speed, goal, pace, self._cycle) for at, speed, goal, pace in axes]
        self.set_point, self.set_speeds = six([q for q, _ in moved]), six([v for _, v in moved])

    def _step_line(self, line: Line) -> None:
        """Move the set points along a straight path; where no joints hold the tool, the motion ends."""
        here, cycle = self._set_pose, self._cycle
        length = math.dist(here.position, line.goal.position)
        ending = math.sqrt(2.0 * line.pace.acceleration * max(length, 1e-6))
        self._line_speed = min(self._line_speed + line.pace.acceleration * cycle, line.pace.speed, ending)
        step = self._line_speed * cycle
        after = towards(here, line.goal, step, _TURN_RAD_S * cycle)
        joints = self.chain.nearest(after, self.set_point)
        if joints is None or after == line.goal or after == here:
            self._line, self._goal = None, joints or self.set_point
            self._paces = (self._fastest,) * 6
        if joints is not None:
            before = self.set_point
            self.set_point = joints
            self.set_speeds = six([(b - a) / cycle for a, b in zip(before, joints, strict=True)])


def _towards(at: float, speed: float, goal: float, pace: Pace, cycle: float) -> tuple[float, float]:
    """Return position and speed one cycle later, from which a joint can stop at its goal."""
    distance, change = goal - at, pace.acceleration * cycle
    if abs(distance) <= change * cycle and abs(speed) <= 2.0 * change:
        return goal, 0.0
    ending = math.sqrt(change * change / 4.0 + 2.0 * pace.acceleration * abs(distance)) - change / 2.0
    wish = math.copysign(min(pace.speed, ending), distance)
    speed = max(speed - change, min(speed + change, wish))
    return at + speed * cycle, speed
