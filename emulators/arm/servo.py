"""The robot between two ticks: interpolator and position loops, without a past.

Source: project specification of the computer link, section 6; the dead band is the paper's discussion of
position resolution.

At interpolation tick k (`powered_at + k * T`) the interpolator puts out a set point on the resolution grid; one
transport delay later the position loop takes it. Between two such moments the loop's input is constant, so its
state has a closed form.

The loop turns itself off inside the dead band: where the set point equals the reported position when the loop
takes it, the loop holds the place where the axis is at that moment, and keeps holding it until the set point
changes or the axis leaves the band.

The servo acts on the Cartesian axes of the base frame. Orientation has no servo of its own: it follows the
interpolator's slerp after the transport delay, in steps of one tick. A line that comes with the joints along
it is walked more slowly wherever a joint could not follow.
"""

import math
from bisect import bisect_right
from dataclasses import dataclass
from typing import Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from emulators.arm.kinematics import Joints, Route
from emulators.arm.quaternions import angle_between, normalised, slerp
from protocol.geometry import Quaternion, Vector
from protocol.marks import Mark, check_settings, setting

Floats: TypeAlias = NDArray[np.float64]

ROUNDING_S = 1e-9
"""A point left for less than this is reached: the sum of ticks carries rounding errors."""
_REST_M = 1e-10
"""An axis nearer than this to where it is pulled, and slower than this in a time constant, is at rest."""
_NOTHING: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class ServoProfile:
    """What is not public about the S3's interpolation and position loops."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    interpolation_ms: float = setting(
        20.0, Mark.ASSUMED, "time between two set points of the interpolator", unit="ms", minimum=1.0
    )
    transport_delay_ms: float = setting(
        20.0,
        Mark.ASSUMED,
        "from interpolator to position loop",
        unit="ms",
        minimum=0.0,
        maximum=1000.0,
    )
    natural_frequency_rad_s: float = setting(
        40.0, Mark.ASSUMED, "natural frequency of the closed position loop", unit="rad/s", above=0.0
    )
    damping_ratio: float = setting(1.0, Mark.ASSUMED, "damping of the closed position loop", above=0.0)
    resolution_mm: float = setting(
        0.125, Mark.OBSERVED, "position resolution of the controller", unit="mm", above=0.0
    )
    dead_band_steps: float = setting(
        0.5,
        Mark.OBSERVED,
        "how far the true position may leave the reported one without being noticed",
        unit="resolution steps",
        minimum=0.5,
    )
    reorientation_deg_s: float = setting(
        90.0, Mark.ASSUMED, "fastest change of orientation along a move", unit="°/s", above=0.0
    )

    def __post_init__(self) -> None:
        check_settings(self)


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


class PositionLoop:
    """Closed second-order position loop of one axis with constant input, in closed form.

    With error e (position less input) the state after `tau` is
    e = a·e0 + b·v0 and v = -ωn²·b·e0 + (a - 2ζωn·b)·v0.
    """

    def __init__(self, natural_frequency: float, damping_ratio: float) -> None:
        self.stiffness = natural_frequency**2
        self.drag = 2.0 * damping_ratio * natural_frequency
        self._frequency = natural_frequency
        self._damping_ratio = damping_ratio

    def response(self, tau: Floats) -> tuple[Floats, Floats]:
        """a and b of the class docstring at times `tau` (n,) in s."""
        decay_rate = self.drag / 2.0
        split = self._frequency * math.sqrt(abs(1.0 - self._damping_ratio**2))
        if split == 0.0:
            even = np.exp(-decay_rate * tau)
            b = tau * even
        elif self._damping_ratio < 1.0:
            decay = np.exp(-decay_rate * tau)
            even = decay * np.cos(split * tau)
            b = decay * np.sin(split * tau) / split
        else:
            slow = np.exp((split - decay_rate) * tau)
            fast = np.exp(-(split + decay_rate) * tau)
            even = (slow + fast) / 2.0
            b = (slow - fast) / (2.0 * split)
        return even + decay_rate * b, b


class Mechanics:
    """What stays the same as long as the robot is powered: its times, its grid, its loops."""

    def __init__(self, profile: ServoProfile, powered_at: float) -> None:
        self.powered_at = powered_at
        self.period = profile.interpolation_ms / 1000.0
        self.delay = profile.transport_delay_ms / 1000.0
        self.step = profile.resolution_mm / 1000.0
        self.turn_rate = math.radians(profile.reorientation_deg_s)
        self.rest_speed = _REST_M * profile.natural_frequency_rad_s
        self.loop = PositionLoop(profile.natural_frequency_rad_s, profile.damping_ratio)
        self._band = profile.dead_band_steps
        stiffness, drag = self.loop.stiffness, self.loop.drag
        a, b = (float(v[0]) for v in self.loop.response(np.array([self.period])))
        self.over_a_tick = a, b, -stiffness * b, a - drag * b

    def report(self, position: float, before: int) -> int:
        """Resolution step reported for a measured position, given the one reported before."""
        steps = position / self.step
        return before if abs(steps - before) <= self._band else round(steps)


class Servo:
    """Interpolator and position loops from one tick to the next.

    Nothing in it changes but by the methods of `Motion`; `after_tick` makes another one, so that what lies ahead can be
    computed, and forgotten when it comes otherwise.
    """

    def __init__(
        self, mechanics: Mechanics, position: Vector, quaternion: Quaternion, joints: Joints
    ) -> None:
        """At rest, and nothing to do."""
        self.mechanics = mechanics
        self.tick = 0
        """Number of the tick that it stands at."""
        self.queue: tuple[Waypoint, ...] = ()
        self.frozen_until = -math.inf
        self._leg: _Leg | None = None
        self._leg_elapsed = 0.0
        self.begins: tuple[float, ...] = ()
        """When the loops take the first set point on the way to each point that was come to in this tick, s."""
        self.at: Vector = position
        self.turned = normalised(quaternion)
        self.joints = joints
        self.set_point = [round(p / mechanics.step) for p in position]
        self.reported = self.set_point
        self._input = list(position)
        self._error = [0.0, 0.0, 0.0]
        self._velocity = [0.0, 0.0, 0.0]
        self.resting = True
        self.encoder_jump = _NOTHING
        """Comes over the measured position when the loops take the next set point, m."""
        self.encoder_offset = _NOTHING

    @property
    def idle(self) -> bool:
        """Whether nothing moves and nothing is to be done."""
        return self.resting and not self.queue and self.encoder_jump == _NOTHING

    def next_tick(self) -> float:
        """When the interpolator next acts, s."""
        return self.mechanics.powered_at + (self.tick + 1) * self.mechanics.period

    def copy(self) -> "Servo":
        """Another one like it."""
        twin = Servo.__new__(Servo)
        twin.__dict__.update(self.__dict__)
        return twin

    def after_tick(self) -> "Servo":
        """Interpolate to the next tick, then carry the loops to the moment they take its set point."""
        after = self.copy()
        after.tick += 1
        after.begins = ()
        if not self.idle:
            if self.next_tick() >= self.frozen_until:
                after._interpolate(self.mechanics.period)
            after._carry()
        return after

    def clear(self) -> None:
        """Forget all points and stay at the present set point."""
        self.queue, self._leg = (), None

    def factors(self) -> tuple[float, ...]:
        """Factors of 1, a and b in the three true positions, then in the three velocities, see `PositionLoop`."""
        stiffness, drag = self.mechanics.loop.stiffness, self.mechanics.loop.drag
        px, py, pz = self._input
        ex, ey, ez = self._error
        vx, vy, vz = self._velocity
        ox, oy, oz = self.encoder_offset
        # fmt: off
        return (
            px - ox, ex, vx,
            py - oy, ey, vy,
            pz - oz, ez, vz,
            0.0, vx, -stiffness * ex - drag * vx,
            0.0, vy, -stiffness * ey - drag * vy,
            0.0, vz, -stiffness * ez - drag * vz,
        )
        # fmt: on

    def _carry(self) -> None:
        """The three axes over one tick to their new set points."""
        mechanics = self.mechanics
        a, b, c, d = mechanics.over_a_tick
        before = zip(
            self.at,
            self.set_point,
            self.reported,
            self._input,
            self._error,
            self._velocity,
            self.encoder_jump,
            strict=True,
        )
        self.set_point, self.reported = [], []
        self._input, self._error, self._velocity = [], [], []
        self.resting = True
        for at, old, reported_before, pulled_to, error, velocity, jump in before:
            set_point = round(at / mechanics.step)
            if set_point == old == reported_before and error == velocity == jump == 0.0:
                # It rests there, and goes on resting.
                position = pull = pulled_to
                reported = set_point
            else:
                position = pulled_to + a * error + b * velocity + jump
                velocity = c * error + d * velocity
                reported = mechanics.report(position, reported_before)
                if reported != set_point:
                    pull = set_point * mechanics.step
                elif old == set_point == reported_before:
                    pull = pulled_to
                else:
                    pull = position
                error = position - pull
            if abs(error) < _REST_M and abs(velocity) < mechanics.rest_speed:
                pull, error, velocity = position, 0.0, 0.0
                self.resting &= reported == set_point
            else:
                self.resting = False
            self.set_point.append(set_point)
            self.reported.append(reported)
            self._input.append(pull)
            self._error.append(error)
            self._velocity.append(velocity)
        if self.encoder_jump != _NOTHING:
            x, y, z = (offset + by for offset, by in zip(self.encoder_offset, self.encoder_jump, strict=True))
            self.encoder_offset, self.encoder_jump = (x, y, z), _NOTHING

    def _interpolate(self, budget: float) -> None:
        """Walk along the queued lines for `budget` seconds; a point reached early passes the rest on."""
        mechanics = self.mechanics
        while self.queue:
            if self._leg is None:
                self._leg = self._leg_to(self.queue[0])
                self._leg_elapsed = 0.0
                # Reached with nothing left of this tick, its first set point is that of the next.
                tick = self.tick + (budget <= ROUNDING_S)
                self.begins += (mechanics.powered_at + tick * mechanics.period + mechanics.delay,)
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
        end = normalised(waypoint.quaternion)
        travel = math.dist(self.at, waypoint.position) / waypoint.speed
        turn = angle_between(self.turned, end) / self.mechanics.turn_rate
        duration = max(travel, turn)
        times = waypoint.route.slowed(duration) if waypoint.route is not None else ()
        if times:
            duration = times[-1]
        return _Leg(self.at, self.turned, waypoint.position, end, duration, waypoint.route, times)
