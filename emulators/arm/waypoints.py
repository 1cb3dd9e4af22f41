"""An arm that is given points: a queue of straight lines, walked by an interpolator, followed by position loops.

Source: project specification of the computer link, section 6.

At each tick the interpolator puts out a set point on the resolution grid, see `emulators.arm.loops`. The servo acts
on the Cartesian axes of the base frame. Orientation has no servo of its own: it follows the interpolator's slerp
after the transport delay, in steps of one tick. A line that comes with the joints along it is walked more slowly
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
    """A point to move to in a straight line."""

    position: Vector
    """Tool centre point in the base frame, m; rounded to the resolution grid."""
    quaternion: Quaternion
    """Tool frame in the base frame, w x y z; need not be normalised but must not be zero."""
    speed: float
    """Along the line, m/s, above 0."""
    route: Route | None = None
    """The joints along the line; None leaves them as they were, and their speed unlimited."""


@dataclass(frozen=True, slots=True)
class _Leg:
    """The straight line that the interpolator is on."""

    start: Vector
    start_quaternion: Quaternion
    end: Vector
    end_quaternion: Quaternion
    duration: float
    route: Route | None
    times: tuple[float, ...]
    """When the places of the route are passed, s after the start; empty at even speed."""

    def part(self, elapsed: float) -> float:
        """How much of the line (0 … 1) is done before `duration` is over."""
        if self.route is None or not self.times:
            return elapsed / self.duration
        k = bisect_right(self.times, elapsed) - 1
        share = (elapsed - self.times[k]) / (self.times[k + 1] - self.times[k])
        return self.route.parts[k] + (self.route.parts[k + 1] - self.route.parts[k]) * share


class _WaypointServo:
    """Interpolator and position loops as of one tick: a `Servo` of `emulators.arm.history`."""

    def __init__(self, mechanics: Mechanics, start: Pose, joints: Joints) -> None:
        """Start with a stationary interpolator without a target."""
        self.mechanics = mechanics
        self.tick = 0
        self.queue: tuple[Waypoint, ...] = ()
        self.frozen_until = -math.inf
        """No new set point comes before this time, s."""
        self._leg: _Leg | None = None
        self._leg_elapsed = 0.0
        self.begins: tuple[float, ...] = ()
        self.at: Vector = start.position
        self.turned = normalise(start.quaternion)
        self.joints = joints
        self.loops = Loops(mechanics, start.position)
        self.encoder_jump = NOTHING
        """Comes over the measured position when the loops take the next set point, m."""

    @property
    def idle(self) -> bool:
        """Whether nothing moves and nothing is to be done."""
        return self.loops.resting and not self.queue and self.encoder_jump == NOTHING

    def copy(self) -> "_WaypointServo":
        """Another one like it, to be changed."""
        twin = _WaypointServo.__new__(_WaypointServo)
        twin.__dict__.update(self.__dict__)
        return twin

    def after_tick(self) -> "_WaypointServo":
        """Interpolate to the next tick, then carry the loops to the moment they take its set point."""
        after = self.copy()
        after.tick += 1
        after.begins = ()
        if not self.idle:
            ticks = self.mechanics.ticks
            if ticks.powered_at + after.tick * ticks.period >= self.frozen_until:
                after._interpolate(ticks.period)
            after.loops = self.loops.taking(after.at, self.encoder_jump)
            after.encoder_jump = NOTHING
        return after

    def factors(self) -> tuple[float, ...]:
        """Factors of the loops."""
        return self.loops.factors()

    def clear(self) -> None:
        """Forget all points and stay at the present set point."""
        self.queue, self._leg = (), None

    def _interpolate(self, budget: float) -> None:
        """Walk along the queued lines for `budget` seconds; a point reached early passes the rest on."""
        ticks = self.mechanics.ticks
        while self.queue:
            if self._leg is None:
                self._leg = self._leg_to(self.queue[0])
                self._leg_elapsed = 0.0
                # Reached with nothing left of this tick, its first set point is that of the next.
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
    """The arm in time: points to move to, and the path that it takes.

    Set points, the loops' state and reported steps are in the controller's own measure; the true path is less by
    the offset of its encoders.
    """

    def __init__(
        self,
        profile: ServoProfile,
        start: Pose,
        powered_at: float,
        joints: Joints = (0.0,) * 6,
        look_ahead: float = 0.0,
    ) -> None:
        """At rest at `start`, with its `joints`, rad. `look_ahead` is that of its path, s."""
        self._mechanics = mechanics = Mechanics(profile, powered_at)
        servo = _WaypointServo(mechanics, start, joints)
        self.path: History[_WaypointServo] = History(servo, mechanics.ticks, mechanics.loop, look_ahead)
        """Where the arm was, is, and will be unless it is told more."""

    # --- orders

    def enqueue(self, waypoint: Waypoint, now: float) -> None:
        """Add a point behind those waiting; the first tick after `now` sees it."""
        if not waypoint.speed > 0.0:
            raise ValueError(f"the speed of a move must be more than 0, got {waypoint.speed:g} m/s")
        servo = self.path.changing(now)
        servo.queue += (waypoint,)
        self.path.accepted += 1

    def halt(self, now: float) -> None:
        """Forget all points and stay at the set point of the last tick."""
        self.path.changing(now).clear()
        self.path.give_up()

    def freeze(self, now: float, until: float) -> None:
        """Put out no new set point before `until`, s; points are queued as ever."""
        self.path.changing(now).frozen_until = until

    def offset_encoders(self, offset: Vector, now: float) -> None:
        """Let the measured position be off by so much more than now, base frame, m; the loops drive it back."""
        servo = self.path.changing(now)
        x, y, z = (before + by for before, by in zip(servo.encoder_jump, offset, strict=True))
        servo.encoder_jump = x, y, z

    # --- how it stands

    @property
    def encoder_offset(self) -> Vector:
        """By how much the measured position is off, or will be from the next tick on, m."""
        servo = self.path.servo
        x, y, z = (now + then for now, then in zip(servo.loops.offset, servo.encoder_jump, strict=True))
        return x, y, z

    def waiting(self, now: float) -> int:
        """Return the number of points not reached by the interpolator, including the one it is moving to."""
        return len(self.path.at_tick(now).queue)

    def goal(self, now: float) -> tuple[Vector, Quaternion, Joints]:
        """Target of the last waiting point, else the place of the interpolator: m, w x y z, and its joints."""
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
        """Whether every point was interpolated and the reported position equals the last of them."""
        return self.waiting(now) == 0 and self._reported_steps(now) == self.path.servo.loops.set_point

    def reported(self, now: float) -> Vector:
        """Position that the controller knows at `now`: on the resolution grid, base frame, m."""
        x, y, z = (step * self._mechanics.step for step in self._reported_steps(now))
        return x, y, z

    def _reported_steps(self, now: float) -> list[int]:
        self.path.advance(now - self._mechanics.ticks.delay)
        servo, since = self.path.at(now)
        return servo.loops.reports(since)

    def joints(self, now: float) -> Joints:
        """Joints at the set point that the loops have at `now`, by interpolation between the places of a route."""
        return self.path.at(now)[0].joints

    def next_tick(self) -> float:
        """When the interpolator next acts, s."""
        return self.path.next_tick()
