"""The moving robot: what it is told, where it was, and where it will be unless it is told more.

Source: project specification of the computer link, section 6.

Time runs on two shifted grids: the interpolator's ticks, and one transport delay later the moments at which the
position loops take their set points. Ticks are computed one by one, samples between them as arrays.

Whoever reads the path may look ahead of what is certain, as if nothing more were ordered: ticks are computed once,
those ahead as well, and those that an order overtakes are computed anew.

Set points, the loops' state and reported steps are in the controller's own measure; the true path is less by
what its encoders are off.
"""

import math
from collections import deque
from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from emulators.arm.kinematics import Joints
from emulators.arm.quaternions import normalised
from emulators.arm.servo import ROUNDING_S, Floats, Mechanics, Servo, ServoProfile, Waypoint
from protocol.geometry import Quaternion, Vector

_HISTORY_S = 10.0
"""Chosen: longer than any stall of a process after which its run is still of use."""
_FORESIGHT_S = 0.14
"""Chosen: from one move order to the next on a link of 9600 baud, less the transport delay, for so much of the path
is certain anyway; what is computed beyond an order is in vain.
"""
_BEGINS = 256
"""Chosen: begins of motion that are kept, more than points that anybody waits for."""
_Record: TypeAlias = tuple[list[int], Quaternion, Joints, Vector]


def _nobody(certain_until: float) -> None:
    """Nobody has looked ahead."""


class Motion:
    """The robot's servo in time: points to move to, what is computed ahead, some seconds of history."""

    def __init__(
        self,
        profile: ServoProfile,
        position: Vector,
        quaternion: Quaternion,
        powered_at: float,
        joints: Joints = (0.0,) * 6,
    ) -> None:
        self._mechanics = mechanics = Mechanics(profile, powered_at)
        self._period, self._delay = mechanics.period, mechanics.delay
        self._powered_at = powered_at
        self._servo = servo = Servo(mechanics, position, quaternion, joints)
        """As of the last tick that is over."""
        self._ahead: deque[Servo] = deque()
        """After the ticks behind it, as if nothing were ordered meanwhile."""
        self.on_change: Callable[[float], object] = _nobody
        """Told up to when the path stays as it could be read before, s, when an order changes what was ahead."""
        self.accepted = 0
        """Points taken so far; the first has the number 1."""
        self._begun = 0
        """How many of them are no longer waiting: the interpolator has come to them, or they were forgotten."""
        self._begins: deque[float] = deque(maxlen=_BEGINS)

        # Item k % n describes the loops from the moment they take set point k: the factors of 1, a and b in
        # the positions and the velocities of the axes (6, 3), and the reported steps.
        self._kept = math.ceil((_HISTORY_S + self._delay) / self._period) + 2
        self._size = self._kept + math.ceil((_FORESIGHT_S + self._delay) / self._period) + 2
        self._newest = 0
        """The highest tick that was ever noted."""
        self._history = np.empty((self._size, 6, 3))
        self._rows = self._history.reshape(self._size, 18)
        self._records = [self._record(servo)] * self._size
        """Reported steps, orientation, joints and encoder offset from then on."""
        self._rows[:] = servo.factors()

    # --- what is ordered

    def enqueue(self, waypoint: Waypoint, now: float) -> None:
        """Add a point behind those waiting; the first tick after `now` sees it."""
        if not waypoint.speed > 0.0:
            raise ValueError(f"the speed of a move must be more than 0, got {waypoint.speed:g} m/s")
        servo = self._changing(now)
        servo.queue += (waypoint,)
        self.accepted += 1

    def halt(self, now: float) -> None:
        """Forget all points and stay at the set point of the last tick."""
        self._changing(now).clear()
        while self._begun < self.accepted:
            self._begin(math.nan)

    def freeze(self, now: float, until: float) -> None:
        """Put out no new set point before `until`, s; points are queued as ever."""
        self._changing(now).frozen_until = until

    def offset_encoders(self, offset: Vector, now: float) -> None:
        """Let the measured position be off by so much more than now, base frame, m; the loops drive it back."""
        servo = self._changing(now)
        x, y, z = (before + by for before, by in zip(servo.encoder_jump, offset, strict=True))
        servo.encoder_jump = x, y, z

    def _changing(self, now: float) -> Servo:
        """What is to be changed at `now`; nothing that was computed behind it holds any more."""
        self.advance(now)
        if self._ahead:
            self._ahead.clear()
            self.on_change(self.certain_until(now))
        self._servo = self._servo.copy()
        return self._servo

    # --- how it stands

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

    @property
    def encoder_offset(self) -> Vector:
        """By how much the measured position is off, or will be from the next tick on, m."""
        servo = self._servo
        x, y, z = (now + then for now, then in zip(servo.encoder_offset, servo.encoder_jump, strict=True))
        return x, y, z

    def waiting(self, now: float) -> int:
        """Number of points not reached by the interpolator, the one it is moving to included."""
        self.advance(now)
        return len(self._servo.queue)

    def goal(self, now: float) -> tuple[Vector, Quaternion, Joints]:
        """Where the last point waiting leads to, else where the interpolator stands: m, w x y z, and its joints."""
        self.advance(now)
        servo = self._servo
        if not servo.queue:
            return servo.at, servo.turned, servo.joints
        last = servo.queue[-1]
        return (
            last.position,
            normalised(last.quaternion),
            last.route.joints[-1] if last.route else servo.joints,
        )

    def settled(self, now: float) -> bool:
        """Whether every point was interpolated and the reported position equals the last of them."""
        return self.waiting(now) == 0 and self._reported_steps(now) == self._servo.set_point

    def reported(self, now: float) -> Vector:
        """Position that the controller knows at `now`: on the resolution grid, base frame, m."""
        x, y, z = (step * self._mechanics.step for step in self._reported_steps(now))
        return x, y, z

    def _reported_steps(self, now: float) -> list[int]:
        self.advance(now - self._delay)
        row, tau = self._row_at(now)
        (a,), (b,) = (part.tolist() for part in self._mechanics.loop.response(np.array([tau])))
        steps, _, _, offsets = self._records[row]
        return [
            self._mechanics.report(still + a * error + b * velocity + offset, step)
            for (still, error, velocity), offset, step in zip(
                self._history[row, :3].tolist(), offsets, steps, strict=True
            )
        ]

    def orientation(self, now: float) -> Quaternion:
        """Tool frame in the base frame at `now`, w x y z."""
        return self._records[self._row_at(now)[0]][1]

    def joints(self, now: float) -> Joints:
        """Joints at the set point that the loops have at `now`, by interpolation between the places of a route."""
        return self._records[self._row_at(now)[0]][2]

    def _row_at(self, now: float) -> tuple[int, float]:
        """The place in the history that tells of `now`, and the time since the loops took its set point, s."""
        newest = self._look_to(now - self._delay)
        since = now - (self._powered_at + self._delay)
        tick = min(max(math.floor(since / self._period), self._oldest()), newest)
        return tick % self._size, max(since - tick * self._period, 0.0)

    def next_tick(self) -> float:
        """When the interpolator next acts, s."""
        return self._servo.next_tick()

    # --- its path

    def certain_until(self, now: float) -> float:
        """Up to when the true path is settled whatever is ordered from `now` on, s, that moment excluded."""
        self.advance(now)
        return self.next_tick() + self._delay - ROUNDING_S

    def foreseen_until(self, now: float) -> float:
        """Up to when the true path may be read at `now`, s, by whoever minds `on_change`."""
        return self.certain_until(now) + _FORESIGHT_S

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
        basis[1], basis[2] = self._mechanics.loop.response(np.maximum(tau, 0.0, out=tau))
        for tick, part in stretches:
            np.matmul(self._history[tick % self._size], basis[:, part], out=path[:, part])
        return path[:3].T, path[3:].T

    def orientations(self, times: Floats) -> list[tuple[slice, Quaternion]]:
        """Tool frame in the base frame, w x y z, at ascending `times` (n,): which of them have which, in
        order; history as above.
        """
        first, last, since = self._locate(times)
        quaternions = [self._records[tick % self._size][1] for tick in range(first, last + 1)]
        if quaternions.count(quaternions[0]) == len(quaternions):
            return [(slice(0, len(times)), quaternions[0])]
        return [
            (part, self._records[tick % self._size][1]) for tick, part in self._stretches(first, last, since)
        ]

    def _locate(self, times: Floats) -> tuple[int, int, Floats]:
        """Ticks whose set points the loops have at the first and the last of `times`, and the times (n,)
        since they took that of tick 0, s.
        """
        # Later ticks have no say yet.
        newest = self._look_to(float(times[-1]) - self._delay)
        since = times - (self._powered_at + self._delay)
        oldest = self._oldest()
        first, last = (math.floor(float(end) / self._period) for end in (since[0], since[-1]))
        return min(max(first, oldest), newest), min(max(last, oldest), newest), since

    def _oldest(self) -> int:
        """The first tick that the history still holds."""
        return max(self._servo.tick - self._kept + 1, self._newest - self._size + 1, 0)

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

    # --- ticks

    def advance(self, now: float) -> None:
        """Let every tick up to and including `now` be over; harmless when there is none."""
        while (at := self._servo.next_tick()) <= now:
            if self._servo.idle and now - at > self._size * self._period:
                self._skip_rest(now)
            self._servo = self._ahead.popleft() if self._ahead else self._noted(self._servo.after_tick())
            for begun_at in self._servo.begins:
                self._begin(begun_at)

    def _look_to(self, then: float) -> int:
        """Have every tick up to and including `then` computed; the number of the last of them."""
        newest = self._ahead[-1] if self._ahead else self._servo
        if newest.next_tick() <= then:
            if then - newest.next_tick() > _FORESIGHT_S + self._delay:
                # Nobody who minds changes looks that far.
                self.advance(then)
                return self._servo.tick
            while newest.next_tick() <= then:
                newest = self._noted(newest.after_tick())
                self._ahead.append(newest)
            return newest.tick
        tick = min(newest.tick, math.floor((then - self._powered_at) / self._period) + 1)
        while tick > 0 and self._powered_at + tick * self._period > then:
            tick -= 1
        return tick

    def _noted(self, servo: Servo) -> Servo:
        """Let others read what the loops do from this tick's set point on."""
        row = servo.tick % self._size
        self._rows[row] = servo.factors()
        self._records[row] = self._record(servo)
        self._newest = max(self._newest, servo.tick)
        return servo

    @staticmethod
    def _record(servo: Servo) -> _Record:
        return servo.reported, servo.turned, servo.joints, servo.encoder_offset

    def _skip_rest(self, now: float) -> None:
        """Jump over ticks in which nothing moves and which no one can ask about any more."""
        self._ahead.clear()
        self._rows[:] = self._servo.factors()
        self._records = [self._record(self._servo)] * self._size
        self._servo = self._servo.copy()
        self._servo.tick = self._newest = math.floor((now - self._powered_at) / self._period) - 1
        self._servo.begins = ()
