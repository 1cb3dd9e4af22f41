"""Emulated arm that executes a queue of waypoints: an interpolator for straight lines, followed by position loops.

Source: project specification of the computer link, section 6.

At each tick, the interpolator issues a set point on the resolution grid; see `emulators.arm.loops`. The servo acts
on the Cartesian axes of the base frame. Orientation has no separate servo: it follows the interpolator's slerp
after the transport delay, in steps of one tick. A line that has joint angles along it is executed more slowly
wherever a joint could not follow.
"""

import math
from bisect import bisect_right
from dataclasses import dataclass

from emulators.arm.history import ROUNDING_S, History
from emulators.arm.loops import NOTHING, Loops, Mechanics, ServoProfile
from protocol.geometry import Pose, Quaternion, Vector, angle_between, normalise, slerp
from protocol.kinematics import Joints, Route


@dataclass(frozen=True, slots=True)
class Waypoint:
    """Target point of a straight line."""

    position: Vector
    """Position of the tool centre point in the base frame, m; rounded to the resolution grid."""
    quaternion: Quaternion
    """Tool frame in the base frame, w x y z. It need not be normalised but must not be zero."""
    speed: float
    """Speed along the line, m/s; must be positive."""
    route: Route | None = None
    """Joint angles along the line; None leaves the joints unchanged and their speed unlimited."""


@dataclass(frozen=True, slots=True)
class _Leg:
    """Straight line that the interpolator currently follows."""

    start: Vector
    start_quaternion: Quaternion
    end: Vector
    end_quaternion: Quaternion
    duration: float
    route: Route | None
    times: tuple[float, ...]
    """Times at which the points of the route are passed, s after the start; empty at constant speed."""

    def part(self, elapsed: float) -> float:
        """Return the share of the line (0 … 1) that is covered after `elapsed`, s.

        `elapsed` must be less than `duration`.
        """
        if self.route is None or not self.times:
            return elapsed / self.duration
        k = bisect_right(self.times, elapsed) - 1
        share = (elapsed - self.times[k]) / (self.times[k + 1] - self.times[k])
        return self.route.parts[k] + (self.route.parts[k + 1] - self.route.parts[k]) * share


class _WaypointServo:
    """Interpolator and position loops at one tick; a `Servo` of `emulators.arm.history`."""

    def __init__(self, mechanics: Mechanics, start: Pose, joints: Joints) -> None:
        """Start with a stationary interpolator that has no target."""
        self.mechanics = mechanics
        self.tick = 0
        self.queue: tuple[Waypoint, ...] = ()
        self.frozen_until = -math.inf
        """Time before which no new set point is issued, s."""
        self._leg: _Leg | None = None
        self._leg_elapsed = 0.0
        self.begins: tuple[float, ...] = ()
        self.at: Vector = start.position
        self.turned = normalise(start.quaternion)
        self.joints = joints
        self.loops = Loops(mechanics, start.position)
        self.encoder_jump = NOTHING
        """Jump of the measured position when the loops receive the next set point, m."""

    @property
    def idle(self) -> bool:
        """Whether the arm is stationary and no point is waiting."""
        return self.loops.resting and not self.queue and self.encoder_jump == NOTHING

    def copy(self) -> "_WaypointServo":
        """Return a copy that may be modified."""
        clone = _WaypointServo.__new__(_WaypointServo)
        clone.__dict__.update(self.__dict__)
        return clone

    def after_tick(self) -> "_WaypointServo":
        """Interpolate to the next tick, then advance the loops to the time at which they receive its set point."""
        after = self.copy()
        after.tick += 1
        after.begins = ()
        if not self.idle:
            ticks = self.mechanics.ticks
            if ticks.powered_at + after.tick * ticks.period >= self.frozen_until:
                after._interpolate(ticks.period)
            after.loops = self.loops.after_tick(after.at, self.encoder_jump)
            after.encoder_jump = NOTHING
        return after

    def factors(self) -> tuple[float, ...]:
        """Return the factors of the loops; see `PositionLoop.factors`."""
        return self.loops.factors()

    def clear(self) -> None:
        """Drop all points and stay at the present set point."""
        self.queue, self._leg = (), None

    def _interpolate(self, budget: float) -> None:
        """Follow the queued lines for `budget` seconds. Time that is left at a point is used for the next line."""
        ticks = self.mechanics.ticks
        while self.queue:
            if self._leg is None:
                self._leg = self._leg_to(self.queue[0])
                self._leg_elapsed = 0.0
                # If no time is left in this tick, the first set point of the line is issued at the next tick.
                tick = self.tick + (budget <= ROUNDING_S)
                self.begins += (ticks.powered_at + tick * ticks.period + ticks.delay,)
            leg = self._leg
            left = leg.duration - self._leg_elapsed
            if left > budget + ROUNDING_S:
                self._leg_elapsed += budget
                part = leg.part(self._leg_elapsed)
                x, y, z = (
                    start + (end - start) * part for start, end in zip(leg.start, leg.end, strict=True)
                )
                self.at = x, y, z
                self.turned = slerp(leg.start_quaternion, leg.end_quaternion, part)
                if leg.route is not None:
                    self.joints = leg.route.at(part)
                return
            budget = max(budget - left, 0.0)
            self.at, self.turned = leg.end, leg.end_quaternion
            if leg.route is not None:
                self.joints = leg.route.joints[-1]
            self.queue = self.queue[1:]
            self._leg = None

    def _leg_to(self, waypoint: Waypoint) -> _Leg:
        end = normalise(waypoint.quaternion)
        travel = math.dist(self.at, waypoint.position) / waypoint.speed
        turn = angle_between(self.turned, end) / self.mechanics.turn_rate
        duration = max(travel, turn)
        times = waypoint.route.slowed(duration) if waypoint.route is not None else ()
        if times:
            duration = times[-1]
        return _Leg(self.at, self.turned, waypoint.position, end, duration, waypoint.route, times)


class WaypointArm:
    """Arm that moves through queued waypoints, with its path over time.

    Set points, the state of the loops and reported steps are values that the controller measures. The true path is
    the measured path minus the encoder offset.
    """

    def __init__(
        self,
        profile: ServoProfile,
        start: Pose,
        powered_at: float,
        joints: Joints = (0.0,) * 6,
        look_ahead: float = 0.0,
    ) -> None:
        """Start stationary at `start` with its `joints`, rad. `look_ahead`, s, is passed to the path of the arm."""
        self._mechanics = mechanics = Mechanics(profile, powered_at)
        servo = _WaypointServo(mechanics, start, joints)
        self.path: History[_WaypointServo] = History(servo, mechanics.ticks, mechanics.loop, look_ahead)
        """Past path of the arm, and its future path under the assumption that no further order arrives."""

    # --- orders

    def enqueue(self, waypoint: Waypoint, now: float) -> None:
        """Append a point to the queue, which takes effect at the first tick after `now`."""
        if not waypoint.speed > 0.0:
            raise ValueError(f"the speed of a move must be more than 0, got {waypoint.speed:g} m/s")
        servo = self.path.modifiable_servo(now)
        servo.queue += (waypoint,)
        self.path.targets.accept(now)

    def halt(self, now: float) -> None:
        """Drop all points and stay at the set point of the last tick."""
        self.path.modifiable_servo(now).clear()
        self.path.targets.drop()

    def freeze(self, now: float, until: float) -> None:
        """Issue no new set point before `until`, s. Points are still added to the queue."""
        self.path.modifiable_servo(now).frozen_until = until

    def offset_encoders(self, offset: Vector, now: float) -> None:
        """Add `offset`, base frame, m, to the error of the measured position. The loops then correct for it."""
        servo = self.path.modifiable_servo(now)
        x, y, z = (before + by for before, by in zip(servo.encoder_jump, offset, strict=True))
        servo.encoder_jump = x, y, z

    # --- state

    @property
    def encoder_offset(self) -> Vector:
        """Error of the measured position, including a jump that takes effect at the next tick, m."""
        servo = self.path.servo
        x, y, z = (now + then for now, then in zip(servo.loops.offset, servo.encoder_jump, strict=True))
        return x, y, z

    def waiting(self, now: float) -> int:
        """Return the number of points that the interpolator has not reached.

        This includes the point that it is moving to.
        """
        return len(self.path.at_tick(now).queue)

    def goal(self, now: float) -> tuple[Vector, Quaternion, Joints]:
        """Return position, m, quaternion, w x y z, and joints of the last waiting point.

        If no point is waiting, return those of the interpolator.
        """
        servo = self.path.at_tick(now)
        if not servo.queue:
            return servo.at, servo.turned, servo.joints
        last = servo.queue[-1]
        return (
            last.position,
            normalise(last.quaternion),
            last.route.joints[-1] if last.route else servo.joints,
        )

    def settled(self, now: float) -> bool:
        """Return whether all points are interpolated and the reported position equals the last point."""
        return self.waiting(now) == 0 and self._round_to_steps(now) == self.path.servo.loops.set_point

    def reported(self, now: float) -> Vector:
        """Return the reported position at `now`, on the resolution grid, base frame, m."""
        x, y, z = (step * self._mechanics.step for step in self._round_to_steps(now))
        return x, y, z

    def _round_to_steps(self, now: float) -> list[int]:
        self.path.advance(now - self._mechanics.ticks.delay)
        servo, since = self.path.at(now)
        return servo.loops.reports(since)

    def joints(self, now: float) -> Joints:
        """Return the joint angles at the set point of the loops at `now`.

        They are interpolated between the points of a route.
        """
        return self.path.at(now)[0].joints

    def next_tick(self) -> float:
        """Return the time of the interpolator's next tick, s."""
        return self.path.next_tick()
