"""Emulated arm that follows the newest target of a stream, at the cycle of its robot.

At each tick, the set point moves towards the newest target, no faster than the robot allows. One transport delay
later, the position loops of `emulators.arm.loops` receive it. If the stream stops, the arm stays at the last
target. There is no resolution grid and no dead band. The servo acts on the Cartesian axes of the base frame.
Orientation has no separate servo: it follows the set point after the transport delay, in steps of one tick.
"""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from emulators.arm.history import History
from emulators.arm.loops import REST_M, PositionLoop, Ticks
from protocol.geometry import Pose, angle_between, normalise, slerp
from protocol.marks import Mark, above, at_least, between, check_settings, setting


@dataclass(frozen=True, slots=True)
class FollowedProfile:
    """Motion of a streamed robot; the package of each robot supplies the values that are known."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    cycle_ms: float = setting(4.0, Mark.CHOSEN, "time between two set points", at_least(0.1), unit="ms")
    transport_delay_ms: float = setting(
        8.0, Mark.ASSUMED, "delay from set point to position loop", between(0.0, 1000.0), unit="ms"
    )
    natural_frequency_rad_s: float = setting(
        60.0, Mark.ASSUMED, "natural frequency of the closed position loop", above(0.0), unit="rad/s"
    )
    damping_ratio: float = setting(1.0, Mark.ASSUMED, "damping ratio of the closed position loop", above(0.0))
    speed_mm_s: float = setting(
        250.0, Mark.CHOSEN, "maximum speed of the set point towards a target", above(0.0), unit="mm/s"
    )
    reorientation_deg_s: float = setting(
        90.0, Mark.ASSUMED, "maximum turn rate of the set point towards a target", above(0.0), unit="°/s"
    )

    def __post_init__(self) -> None:
        check_settings(self)


class _Mechanics:
    """Constants of a powered arm."""

    def __init__(self, profile: FollowedProfile, powered_at: float) -> None:
        period = profile.cycle_ms / 1000.0
        self.ticks = Ticks(powered_at, period, profile.transport_delay_ms / 1000.0)
        self.loop = PositionLoop(profile.natural_frequency_rad_s, profile.damping_ratio)
        self.over_a_tick = self.loop.over(period)
        self.rest_speed = REST_M * profile.natural_frequency_rad_s
        self.travel = profile.speed_mm_s / 1000.0 * period
        """Maximum travel of the set point in one tick, m."""
        self.turn = math.radians(profile.reorientation_deg_s) * period
        """Maximum turn of the set point in one tick, rad."""


class _FollowedServo:
    """Set point and position loops at one tick; a `Servo` of `emulators.arm.history`."""

    def __init__(self, mechanics: _Mechanics, start: Pose) -> None:
        """Start with the arm stationary at the pose `start`."""
        self.mechanics = mechanics
        self.tick = 0
        self.begins: tuple[float, ...] = ()
        self.at = start.position
        """Position of the set point, m."""
        self.turned = start.quaternion
        self.target = start
        self.waiting = 0
        """Number of targets accepted since the last tick."""
        self.resting = True
        self._input = list(start.position)
        self._error = [0.0, 0.0, 0.0]
        self._velocity = [0.0, 0.0, 0.0]

    @property
    def idle(self) -> bool:
        """Whether the arm is stationary at its target and no target is waiting."""
        return self.resting and not self.waiting and (self.at, self.turned) == self.target

    def copy(self) -> "_FollowedServo":
        """Return a copy that may be modified."""
        twin = _FollowedServo.__new__(_FollowedServo)
        twin.__dict__.update(self.__dict__)
        return twin

    def after_tick(self) -> "_FollowedServo":
        """Move the set point, then advance the loops to the time at which they receive it."""
        after = self.copy()
        after.tick += 1
        after.begins = ()
        if not self.idle:
            after._begin_newest()
            after._approach()
            after._advance_axes()
        return after

    def factors(self) -> tuple[float, ...]:
        """Return the factors of the loops; see `PositionLoop.factors`."""
        return self.mechanics.loop.factors(self._input, self._error, self._velocity)

    def _begin_newest(self) -> None:
        """Begin the motion to the newest target with this tick's set point. It supersedes earlier waiting targets."""
        if self.waiting:
            ticks = self.mechanics.ticks
            begins = ticks.powered_at + self.tick * ticks.period + ticks.delay
            self.begins = (math.nan,) * (self.waiting - 1) + (begins,)
            self.waiting = 0

    def _approach(self) -> None:
        """Move the set point towards the target by at most the travel of one tick."""
        goal, mechanics = self.target, self.mechanics
        distance = math.dist(self.at, goal.position)
        if distance <= mechanics.travel:
            self.at = goal.position
        else:
            part = mechanics.travel / distance
            x, y, z = (p + (q - p) * part for p, q in zip(self.at, goal.position, strict=True))
            self.at = x, y, z
        if self.turned != goal.quaternion:
            angle = angle_between(self.turned, goal.quaternion)
            near = angle <= mechanics.turn
            self.turned = (
                goal.quaternion if near else slerp(self.turned, goal.quaternion, mechanics.turn / angle)
            )

    def _advance_axes(self) -> None:
        """Advance the three axes by one tick, then apply their new set points."""
        a, b, c, d = self.mechanics.over_a_tick
        before = zip(self.at, self._input, self._error, self._velocity, strict=True)
        axes = []
        self.resting = True
        for set_point, pulled_to, error, velocity in before:
            position = pulled_to + a * error + b * velocity
            velocity = c * error + d * velocity
            pull, error = set_point, position - set_point
            if abs(error) < REST_M and abs(velocity) < self.mechanics.rest_speed:
                pull, error, velocity = position, 0.0, 0.0
            else:
                self.resting = False
            axes.append((pull, error, velocity))
        self._input, self._error, self._velocity = map(list, zip(*axes, strict=True))


class FollowedArm:
    """Arm that follows a stream of targets, with its path over time."""

    def __init__(
        self, profile: FollowedProfile, start: Pose, powered_at: float, look_ahead: float = 0.0
    ) -> None:
        """Start stationary at `start`.

        `look_ahead` is the time by which the path may be read beyond its committed end, s. Reading ahead is useless
        for a stream whose next target arrives within a cycle or two.
        """
        mechanics = _Mechanics(profile, powered_at)
        servo = _FollowedServo(mechanics, Pose(start.position, normalise(start.quaternion)))
        self.path: History[_FollowedServo] = History(servo, mechanics.ticks, mechanics.loop, look_ahead)
        """Past path of the arm, and its future path under the assumption that the target does not change."""

    def follow(self, target: Pose, now: float, arrived_at: float | None = None) -> None:
        """Set a new target, which applies from the first tick after `now`. Its order arrived at `arrived_at`, s, by
        default `now`. Raises ValueError for a zero quaternion.
        """
        target = Pose(target.position, normalise(target.quaternion))
        servo = self.path.modifiable_servo(now)
        servo.target = target
        servo.waiting += 1
        self.path.targets.accept(now if arrived_at is None else arrived_at)

    def hold(self, now: float) -> None:
        """Stay at the set point of the last tick and drop all waiting targets."""
        servo = self.path.modifiable_servo(now)
        servo.target = Pose(servo.at, servo.turned)
        servo.waiting = 0
        self.path.targets.drop()

    def set_point(self, now: float) -> Pose:
        """Return the commanded tool pose at the last tick up to `now`."""
        servo = self.path.at_tick(now)
        return Pose(servo.at, servo.turned)

    def pose(self, now: float) -> Pose:
        """Return the true tool pose at `now`."""
        return self.path.pose(now)
