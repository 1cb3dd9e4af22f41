"""Interpolator and servo of the S3: from queued points to the true path of the tool centre point.

Source: project specification of the computer link, section 6; the dead band is the paper's discussion of
position resolution.

Time runs on two shifted grids. At interpolation tick k (`powered_at + k * T`) the interpolator puts out a set
point on the resolution grid; one transport delay later the position loop takes it. Between two such moments
the loop's input is constant, so its state has a closed form: ticks are computed one by one, samples between
them as arrays.

The loop turns itself off inside the dead band: where the set point equals the reported position when the loop
takes it, the loop holds the place where the axis is at that moment, and keeps holding it until the set point
changes or the axis leaves the band.

Set points, the loops' state and reported steps are in the controller's own measure; the true path is less by
what its encoders are off.

The servo acts on the Cartesian axes of the base frame. Orientation has no servo of its own: it follows the
interpolator's slerp after the transport delay, in steps of one tick. A line that comes with the joints along
it is walked more slowly wherever a joint could not follow.
"""

import math
from bisect import bisect_right
from collections import deque
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from emulators.robot.kinematics import Joints, Route
from emulators.robot.quaternions import angle_between, normalised, slerp
from protocol.arap import Quaternion, Vector
from protocol.marks import Mark, check_settings, setting
from protocol.values import dataclass

Floats = NDArray[np.float64]

_HISTORY_S = 10.0
"""Chosen: longer than any stall of a process after which its run is still of use."""
_ROUNDING_S = 1e-9
"""A point left for less than this is reached: the sum of ticks carries rounding errors."""
_BEGINS = 256
"""Chosen: begins of motion that are kept, more than points that anybody waits for."""
_REST_M = 1e-10
"""An axis nearer than this to where it is pulled, and slower than this in a time constant, is at rest."""


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


class Motion:
    """The moving robot: queue of points, interpolator, three position loops, some seconds of history."""

    def __init__(
        self,
        profile: ServoProfile,
        position: Vector,
        quaternion: Quaternion,
        powered_at: float,
        joints: Joints = (0.0,) * 6,
    ) -> None:
        self._period = profile.interpolation_ms / 1000.0
        self._delay = profile.transport_delay_ms / 1000.0
        self._step = profile.resolution_mm / 1000.0
        self._band = profile.dead_band_steps
        self._turn_rate = math.radians(profile.reorientation_deg_s)
        self._loop = PositionLoop(profile.natural_frequency_rad_s, profile.damping_ratio)
        self._rest_speed = _REST_M * profile.natural_frequency_rad_s
        a, b = (float(v[0]) for v in self._loop.response(np.array([self._period])))
        self._over_a_tick = a, b, -self._loop.stiffness * b, a - self._loop.drag * b

        self._powered_at = powered_at
        self._tick = 0
        self._queue: deque[Waypoint] = deque()
        self._leg: _Leg | None = None
        self._leg_elapsed = 0.0
        self.accepted = 0
        """Points taken so far; the first has the number 1."""
        self._begun = 0
        """How many of them are no longer waiting: the interpolator has come to them, or they were forgotten."""
        self._begins: deque[float] = deque(maxlen=_BEGINS)
        self._at: Vector = position
        self._turned = normalised(quaternion)
        self._joints = joints

        reported = [round(p / self._step) for p in position]
        self._set_point = list(reported)
        self._reported = reported
        self._input = list(position)
        self._error = [0.0, 0.0, 0.0]
        self._velocity = [0.0, 0.0, 0.0]
        self._resting = True
        self._frozen_until = -math.inf
        self._encoder_jump = [0.0, 0.0, 0.0]
        """Comes over the measured position when the loops take the next set point, m."""
        self._encoder_offset = [0.0, 0.0, 0.0]

        # Item k % n describes the loops from the moment they take set point k: the factors of 1, a and b in
        # the positions and the velocities of the axes (6, 3), and the reported steps.
        self._size = math.ceil((_HISTORY_S + self._delay) / self._period) + 2
        self._history = np.empty((self._size, 6, 3))
        self._history[:] = self._factors()
        self._reports = [tuple(reported)] * self._size
        self._quaternions = [self._turned] * self._size
        self._postures = [joints] * self._size
        self._offsets = [tuple(self._encoder_offset)] * self._size

    def enqueue(self, waypoint: Waypoint, now: float) -> None:
        """Add a point behind those waiting; the first tick after `now` sees it."""
        if not waypoint.speed > 0.0:
            raise ValueError(f"the speed of a move must be more than 0, got {waypoint.speed:g} m/s")
        self.advance(now)
        self._queue.append(waypoint)
        self.accepted += 1

    def halt(self, now: float) -> None:
        """Forget all points and stay at the set point of the last tick."""
        self.advance(now)
        self._queue.clear()
        self._leg = None
        while self._begun < self.accepted:
            self._begin(math.nan)

    def begun_at(self, number: int) -> float | None:
        """When the position loops took, or will take, the first set point on the way to the point of this number,
        s; None before that is known, NaN for a point that was forgotten.
        """
        if number > self._begun:
            return None
        kept = self._begun - len(self._begins)
        return self._begins[number - kept - 1] if number > kept else math.nan

    def _begin(self, at: float) -> None:
        self._begun += 1
        self._begins.append(at)

    def freeze(self, now: float, until: float) -> None:
        """Put out no new set point before `until`, s; points are queued as ever."""
        self.advance(now)
        self._frozen_until = until

    def offset_encoders(self, offset: Vector, now: float) -> None:
        """Let the measured position be off by so much more than now, base frame, m; the loops drive it back."""
        self.advance(now)
        self._encoder_jump = [before + by for before, by in zip(self._encoder_jump, offset, strict=True)]

    @property
    def encoder_offset(self) -> Vector:
        """By how much the measured position is off, or will be from the next tick on, m."""
        x, y, z = (now + then for now, then in zip(self._encoder_offset, self._encoder_jump, strict=True))
        return x, y, z

    def waiting(self, now: float) -> int:
        """Number of points not reached by the interpolator, the one it is moving to included."""
        self.advance(now)
        return len(self._queue)

    def goal(self, now: float) -> tuple[Vector, Quaternion, Joints]:
        """Where the last point waiting leads to, else where the interpolator stands: m, w x y z, and its joints."""
        self.advance(now)
        if not self._queue:
            return self._at, self._turned, self._joints
        last = self._queue[-1]
        return (
            last.position,
            normalised(last.quaternion),
            last.route.joints[-1] if last.route else self._joints,
        )

    def settled(self, now: float) -> bool:
        """Whether every point was interpolated and the reported position equals the last of them."""
        return self.waiting(now) == 0 and self._reported_steps(now) == self._set_point

    def reported(self, now: float) -> Vector:
        """Position that the controller knows at `now`: on the resolution grid, base frame, m."""
        x, y, z = (step * self._step for step in self._reported_steps(now))
        return x, y, z

    def orientation(self, now: float) -> Quaternion:
        """Tool frame in the base frame at `now`, w x y z."""
        return self.orientations(np.array([now]))[0][1]

    def joints(self, now: float) -> Joints:
        """Joints at the set point that the loops have at `now`, by interpolation between the places of a route."""
        return self._postures[self._locate(np.array([now]))[0] % self._size]

    def next_tick(self) -> float:
        """When the interpolator next acts, s."""
        return self._powered_at + (self._tick + 1) * self._period

    def advance(self, now: float) -> None:
        """Compute every tick up to and including `now`; harmless when there is none."""
        while self.next_tick() <= now:
            if self._resting and not self._queue and now - self.next_tick() > self._size * self._period:
                self._skip_rest(now)
            self._do_tick()

    def certain_until(self, now: float) -> float:
        """Up to when the true path is settled whatever is ordered from `now` on, s, that moment excluded."""
        self.advance(now)
        return self.next_tick() + self._delay - _ROUNDING_S

    def trajectory(self, times: Floats) -> tuple[Floats, Floats]:
        """True positions (n, 3), m, and velocities (n, 3), m/s, base frame, at ascending `times` (n,).

        Times before the history, which holds the last ten seconds, answer as its first moment.
        """
        path = np.empty((6, len(times)))
        first, last, tau = self._locate(times)
        stretches = self._stretches(first, last, tau)
        for tick, part in stretches:
            tau[part] -= tick * self._period
        basis = np.empty((3, len(times)))
        basis[0] = 1.0
        basis[1:] = self._loop.response(np.maximum(tau, 0.0, out=tau))
        for tick, part in stretches:
            np.matmul(self._history[tick % self._size], basis[:, part], out=path[:, part])
        return path[:3].T, path[3:].T

    def orientations(self, times: Floats) -> list[tuple[slice, Quaternion]]:
        """Tool frame in the base frame, w x y z, at ascending `times` (n,): which of them have which, in
        order; history as above.
        """
        first, last, since = self._locate(times)
        quaternions = [self._quaternions[tick % self._size] for tick in range(first, last + 1)]
        if quaternions.count(quaternions[0]) == len(quaternions):
            return [(slice(0, len(times)), quaternions[0])]
        return [
            (part, self._quaternions[tick % self._size]) for tick, part in self._stretches(first, last, since)
        ]

    def _locate(self, times: Floats) -> tuple[int, int, Floats]:
        """Ticks whose set points the loops have at the first and the last of `times`, and the times (n,)
        since they took that of tick 0, s.
        """
        # Later ticks have no say yet: they wait, so that a look ahead never takes a point before its time.
        self.advance(float(times[-1]) - self._delay)
        since = times - (self._powered_at + self._delay)
        oldest = max(self._tick - self._size + 1, 0)
        first, last = (math.floor(float(end) / self._period) for end in (since[0], since[-1]))
        return min(max(first, oldest), self._tick), min(max(last, oldest), self._tick), since

    def _stretches(self, first: int, last: int, since: Floats) -> list[tuple[int, slice]]:
        """The ticks from `first` to `last`, each with the part of `since` that it holds for."""
        if first == last:
            return [(first, slice(0, len(since)))]
        ticks = range(first, last + 1)
        edges = np.searchsorted(np.floor(since / self._period), ticks[1:]).tolist()
        return [
            (tick, slice(begin, end))
            for tick, begin, end in zip(ticks, (0, *edges), (*edges, len(since)), strict=True)
            if begin < end
        ]

    def _skip_rest(self, now: float) -> None:
        """Jump over ticks in which nothing moves and which no one can ask about any more."""
        self._history[:] = self._history[self._tick % self._size]
        self._reports = [tuple(self._reported)] * self._size
        self._quaternions = [self._turned] * self._size
        self._postures = [self._joints] * self._size
        self._offsets = [tuple(self._encoder_offset)] * self._size
        self._tick = math.floor((now - self._powered_at) / self._period) - 1

    def _do_tick(self) -> None:
        """Interpolate to the next tick, then carry the loops to the moment they take its set point."""
        self._tick += 1
        row = self._tick % self._size
        jump = any(self._encoder_jump)
        if self._resting and not self._queue and not jump:
            self._history[row] = self._history[row - 1]
            self._reports[row] = self._reports[row - 1]
            self._quaternions[row] = self._turned
            self._postures[row] = self._joints
            self._offsets[row] = self._offsets[row - 1]
            return
        if self._powered_at + self._tick * self._period >= self._frozen_until:
            self._interpolate(self._period)
        resting = True
        for axis in range(3):
            set_point = round(self._at[axis] / self._step)
            resting &= self._carry(axis, set_point)
        self._resting = resting
        if jump:
            self._encoder_offset = [
                offset + by for offset, by in zip(self._encoder_offset, self._encoder_jump, strict=True)
            ]
            self._encoder_jump = [0.0, 0.0, 0.0]
        self._offsets[row] = tuple(self._encoder_offset)
        self._history[row] = self._factors()
        self._reports[row] = tuple(self._reported)
        self._quaternions[row] = self._turned
        self._postures[row] = self._joints

    def _factors(self) -> list[tuple[float, float, float]]:
        """Factors of 1, a and b in the three true positions and velocities, see `PositionLoop`."""
        stiffness, drag = self._loop.stiffness, self._loop.drag
        true_input = (pull - offset for pull, offset in zip(self._input, self._encoder_offset, strict=True))
        return [
            *zip(true_input, self._error, self._velocity, strict=True),
            *((0.0, v, -stiffness * e - drag * v) for e, v in zip(self._error, self._velocity, strict=True)),
        ]

    def _carry(self, axis: int, set_point: int) -> bool:
        """One axis over one tick to its new set point; whether it is at rest afterwards."""
        a, b, c, d = self._over_a_tick
        error, velocity = self._error[axis], self._velocity[axis]
        position = self._input[axis] + a * error + b * velocity + self._encoder_jump[axis]
        velocity = c * error + d * velocity
        held = self._set_point[axis] == set_point == self._reported[axis]
        reported = self._report(position, self._reported[axis])
        if reported != set_point:
            pull = set_point * self._step
        elif held:
            pull = self._input[axis]
        else:
            pull = position
        error = position - pull
        resting = abs(error) < _REST_M and abs(velocity) < self._rest_speed
        if resting:
            pull, error, velocity = position, 0.0, 0.0
        self._set_point[axis] = set_point
        self._reported[axis] = reported
        self._input[axis], self._error[axis], self._velocity[axis] = pull, error, velocity
        return resting and reported == set_point

    def _report(self, position: float, before: int) -> int:
        """Resolution step reported for a true position, given the one reported before."""
        steps = position / self._step
        return before if abs(steps - before) <= self._band else round(steps)

    def _reported_steps(self, now: float) -> list[int]:
        times = np.array([now])
        positions, _ = self.trajectory(times)
        row = self._locate(times)[0] % self._size
        return [
            self._report(position + offset, step)
            for position, offset, step in zip(
                positions[0].tolist(), self._offsets[row], self._reports[row], strict=True
            )
        ]

    def _interpolate(self, budget: float) -> None:
        """Walk along the queued lines for `budget` seconds; a point reached early passes the rest on."""
        while self._queue:
            if self._leg is None:
                self._leg = self._leg_to(self._queue[0])
                self._leg_elapsed = 0.0
                # Reached with nothing left of this tick, its first set point is that of the next.
                tick = self._tick + (budget <= _ROUNDING_S)
                self._begin(self._powered_at + tick * self._period + self._delay)
            leg = self._leg
            left = leg.duration - self._leg_elapsed
            if left > budget + _ROUNDING_S:
                self._leg_elapsed += budget
                part = leg.part(self._leg_elapsed)
                x, y, z = (
                    start + (end - start) * part for start, end in zip(leg.start, leg.end, strict=True)
                )
                self._at = x, y, z
                self._turned = slerp(leg.start_quaternion, leg.end_quaternion, part)
                if leg.route is not None:
                    self._joints = leg.route.at(part)
                return
            budget = max(budget - left, 0.0)
            self._at, self._turned = leg.end, leg.end_quaternion
            if leg.route is not None:
                self._joints = leg.route.joints[-1]
            self._queue.popleft()
            self._leg = None

    def _leg_to(self, waypoint: Waypoint) -> _Leg:
        end = normalised(waypoint.quaternion)
        travel = math.dist(self._at, waypoint.position) / waypoint.speed
        turn = angle_between(self._turned, end) / self._turn_rate
        duration = max(travel, turn)
        times = waypoint.route.slowed(duration) if waypoint.route is not None else ()
        if times:
            duration = times[-1]
        return _Leg(self._at, self._turned, waypoint.position, end, duration, waypoint.route, times)
