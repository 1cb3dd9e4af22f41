"""Set points of the emulated controller in each cycle: from the buffer, smoothed or refused, and what it does when they
are missing.
"""

import math
from collections.abc import Sequence

from hil_fanuc import alarms
from hil_fanuc.arms import Joints
from hil_fanuc.limits import AxisLimits, LimitTable
from hil_fanuc.motion import Motion
from hil_fanuc.packets import CARTESIAN, Command, Limit, Threshold, ThresholdRequest, is_finite
from hil_fanuc.profile import FanucProfile
from hil_fanuc.program import Program
from hil_fanuc.stream_server import StreamServer
from protocol.geometry import Pose, from_angles, towards

SLOW_DEG_S, FAST_DEG_S = 15.3, 49.9
"""Speeds at which the reaction to silence was observed, degrees/s."""
_AHEAD = 25, 5, 1
"""Cycles by which the goal of a motion to a distant pose is ahead of the arm, so that the joints reach their speeds.
Assumed: the first that can be reached.
"""
_TURN_RAD_S = math.pi
"""Largest rotational speed of a motion by poses, rad/s. Assumed."""


class SetPoints:
    """Set points of one controller."""

    def __init__(self, profile: FanucProfile, program: Program, server: StreamServer) -> None:
        self._profile, self._program, self._server = profile, program, server
        self.motion: Motion
        """Arm; set once it is powered up."""
        tables: dict[tuple[int, int], Threshold] = {
            (axis, kind): server.threshold(ThresholdRequest(profile.version, axis, kind))
            for axis in range(1, 7)
            for kind in Limit
        }
        self._table = LimitTable(tables)
        self.load = 0.0
        """Load of the arm as a share of the largest load."""
        self.expects = False
        """Whether a report was sent since the last cycle, which a command should answer."""
        self._missing = 0
        """Number of cycles in a row without a set point."""
        self._silent_since: float | None = None
        self._silent_speed = 0.0
        """Speed of the fastest joint when set points began to be missing, degrees/s."""
        self.is_jerky = False
        """Whether a set point was so jerky that the contact stop trips."""
        self._begun = False
        """Whether the movement has begun: `start_move` set points were buffered."""
        self._goal: Joints | None = None
        """Newest joints that are smoothed."""

    def begin(self) -> None:
        """Begin a session, or continue after a stop."""
        self._missing, self._silent_since, self._begun, self._goal = 0, None, False, None

    @property
    def limits(self) -> tuple[AxisLimits, ...]:
        """Limits of the joints at present."""
        return self._table.at(0.0, self.load)

    def decide(self, at: float) -> Joints:
        """Return the set points for the cycle that begins at a time, s."""
        motion, program = self.motion, self._program
        if program.may_move and program.starved:
            self._go_on(at)
            return motion.set_point
        if not (program.may_move and program.is_ready(at)):
            motion.brake(at)
            self._server.buffer.clear()
            self.begin()
            return motion.set_point
        command = self._next_command()
        if command is None:
            return self._without(at)
        motion.release()
        self._missing, self._silent_since = 0, None
        return self._with(command, at)

    def _next_command(self) -> Command | None:
        """Take a set point from the buffer, once enough are buffered. While they do not move the arm, surplus ones are
        dropped.
        """
        server, buffer = self._server, self._server.buffer
        if not buffer or (not self._begun and len(buffer) <= server.start_move):
            return None
        self._begun = True
        command = buffer.popleft()
        while len(buffer) > server.start_move and buffer[0].position == command.position:
            command = buffer.popleft()
        return command

    # --- without a set point

    def _without(self, at: float) -> Joints:
        """Handle a cycle without a set point."""
        motion, profile = self.motion, self._profile
        self._missing += self.expects
        if not self._begun or not self._missing:
            return motion.set_point
        if self._server.has_last:
            if self._goal is not None and self._goal != motion.set_point:
                self._smooth(self._goal)
            elif motion.has_arrived and motion.fastest_deg_s <= profile.in_motion_deg_s:
                self._program.finish()
            return motion.set_point
        if profile.smooths:
            self._go_on(at)
        elif self._missing > profile.packet_stack:
            return self._refuse(alarms.COMMAND_MISSING, at)
        return motion.set_point

    def _go_on(self, at: float) -> None:
        """Let the arm go on at the last speed, then stop it at once. It reports that it is not ready before that."""
        motion, profile, cycle = self.motion, self._profile, self._profile.cycle_s
        if self._silent_since is None:
            self._silent_since, self._silent_speed = at - cycle, motion.set_speed
        silent, speed = at - self._silent_since + 1e-9, self._silent_speed
        if silent >= _by_speed(speed, profile.silent_slow_ms, profile.silent_fast_ms):
            self._program.starved = True
        if self._program.starved and (
            not speed or silent >= _by_speed(speed, profile.coast_slow_ms, profile.coast_fast_ms)
        ):
            motion.lock()
            return
        if speed:
            motion.limiter.accept([one.position + one.speed * cycle for one in motion.limiter.states])

    # --- with a set point

    def _with(self, command: Command, at: float) -> Joints:
        """Return the set points for a command."""
        motion = self.motion
        six = command.position[:6]
        if not is_finite(six):
            return self._refuse(alarms.ABNORMAL, at)
        if command.data_style == CARTESIAN:
            return self._by_pose(six, at)
        if max(abs(to - q) for to, q in zip(six, motion.set_point, strict=True)) > self._profile.abnormal_deg:
            return self._refuse(alarms.ABNORMAL, at)
        return self._by_joints(six, alarms.JOINT_LIMITS, at)

    def _by_joints(self, goal: Sequence[float], texts: dict[Limit, str], at: float) -> Joints:
        """Follow joints within the limits, or refuse those beyond them."""
        motion, limits = self.motion, self.limits
        a, b, c, d, e, f = goal
        if not motion.arm.allows((a, b, c, d, e, f)):
            return self._refuse(alarms.NOT_REACHABLE, at)
        if self._profile.smooths:
            self._goal = a, b, c, d, e, f
            self._smooth(self._goal)
            return motion.set_point
        if breach := motion.limiter.breach(goal, limits):
            return self._refuse(f"{texts[breach.limit]} (G:1, A:{breach.axis})", at)
        if self._tool_step((a, b, c, d, e, f)) > 1.0:
            return self._refuse(alarms.TOO_FAST, at)
        motion.limiter.accept(goal)
        return motion.set_point

    def _tool_step(self, goal: Joints) -> float:
        """Return the step of the tool as a share of the largest in collaborative mode; 0 without such a limit."""
        most = self._profile.collaborative_mm_s / 1e3 * self._profile.cycle_s
        if not most or goal == self.motion.set_point:
            return 0.0
        here, there = (self.motion.arm.pose(joints).position for joints in (self.motion.set_point, goal))
        return math.dist(here, there) / most

    def _smooth(self, goal: Joints) -> None:
        """Move the set points towards a goal within the limits, also that of the tool in collaborative mode."""
        limiter, before = self.motion.limiter, self.motion.limiter.states
        trip = self._profile.contact_jerk
        if trip and (breach := limiter.breach(goal, self.limits)) and breach.limit is Limit.JERK:
            self.is_jerky = breach.share > trip
        limiter.step(goal, self.limits, exact=True)
        a, b, c, d, e, f = after = limiter.joints
        limiter.states = before
        if (step := self._tool_step((a, b, c, d, e, f))) > 1.0:
            after = tuple(q.position + (to - q.position) / step for q, to in zip(before, after, strict=True))
        limiter.accept(after)

    def _by_pose(self, six: Sequence[float], at: float) -> Joints:
        """Move towards a pose of the reported point, X Y Z in mm and W P R in degrees."""
        motion, profile = self.motion, self._profile
        x, y, z, w, p, r = six
        goal = motion.arm.in_base(Pose((x / 1e3, y / 1e3, z / 1e3), from_angles(r, p, w)))
        if not self._server.reports_tcp:
            goal = motion.arm.tip_of(goal)
        before = motion.arm.pose(motion.set_point)
        step = profile.max_speed_mm_s / 1e3 * profile.cycle_s
        is_near = math.dist(before.position, goal.position) <= step
        if not profile.smooths and not is_near:
            return self._refuse(alarms.CARTESIAN_LIMITS[Limit.SPEED], at)
        for ahead in (1,) if is_near else _AHEAD:
            after = towards(before, goal, ahead * step, ahead * _TURN_RAD_S * profile.cycle_s)
            joints = motion.arm.nearest(after, motion.set_point)
            if joints is not None:
                return self._by_joints(joints, alarms.CARTESIAN_LIMITS, at)
        return self._refuse(alarms.NOT_REACHABLE, at)

    def _refuse(self, alarm: str, at: float) -> Joints:
        self._program.alarms.raise_(alarm, at)
        self.motion.brake(at)
        return self.motion.set_point


def _by_speed(speed_deg_s: float, slow_ms: float, fast_ms: float) -> float:
    """Interpolate a time between those at the two observed speeds, s."""
    share = min(max((speed_deg_s - SLOW_DEG_S) / (FAST_DEG_S - SLOW_DEG_S), 0.0), 1.0)
    return (slow_ms + share * (fast_ms - slow_ms)) / 1e3
