"""Path of an arm over time: past path, present tick, and future path under the assumption that no further order
arrives.

Time has two shifted grids: the ticks of a servo, and the times at which the position loops receive the set points
of these ticks. The second grid is later by one transport delay. Ticks are computed one by one; samples between
ticks are computed as arrays.

The path may be read beyond its committed end, under the assumption that no further order arrives. Each tick is
computed once, including future ticks. Future ticks that an order invalidates are computed again.
"""

import math
from collections import deque
from collections.abc import Callable
from typing import Generic, Protocol, Self, TypeVar

import numpy as np

from emulators.arm.loops import Floats, PositionLoop, Ticks
from emulators.target_times import TargetTimes
from protocol.geometry import Pose, Quaternion

ROUNDING_S = 1e-9
"""Largest difference between two times that count as equal, s: the sum of ticks carries rounding errors."""
_PAST_S = 10.0
"""Length of the past path that is kept, s. Chosen: longer than any stall of a process after which its run is still
useful.
"""


class Servo(Protocol):
    """State of an arm's servo, which advances from one tick to the next.

    A history keeps many servos, so a servo changes only before it is stored; `after_tick` and `copy` return new
    objects.
    """

    tick: int
    """Number of the servo's tick."""
    turned: Quaternion
    """Tool frame in the base frame, w x y z, from the time at which the loops receive this tick's set point."""
    begins: tuple[float, ...]
    """Time at which the loops receive the first set point of the motion to each target begun in this tick, s; NaN
    for a superseded target.
    """

    @property
    def idle(self) -> bool:
        """Whether the arm is stationary and no order is waiting."""

    def after_tick(self) -> Self:
        """Return the servo at the next tick."""

    def copy(self) -> Self:
        """Return a copy that may be modified."""

    def factors(self) -> tuple[float, ...]:
        """Return the factors of `PositionLoop.factors` from the time at which the loops receive this set point."""


S = TypeVar("S", bound=Servo)


def _unread(committed_until: float) -> None:
    """Do nothing, because no reader has read ahead."""


class History(Generic[S]):
    """Path of an arm over the last ten seconds; an `emulators.seams.ArmPath`."""

    def __init__(self, servo: S, ticks: Ticks, loop: PositionLoop, look_ahead: float) -> None:
        """`look_ahead` is the time by which the path may be read beyond its committed end, s."""
        self._loop = loop
        self._look_ahead = look_ahead
        self._powered_at, self._period, self._delay = ticks.powered_at, ticks.period, ticks.delay
        self._servo = servo
        """State at the last completed tick."""
        self._ahead: deque[S] = deque()
        """States at the following ticks, under the assumption that no further order arrives."""
        self.on_change: Callable[[float], object] = _unread
        """Callback for the time up to which the path read so far remains valid, s, when an order changes future
        ticks.
        """
        self.targets = TargetTimes()
        """Times of the targets. A motion begins when the position loops receive the first set point towards it."""

        # Item k % n describes the loops from the time when they receive set point k. It holds the factors of 1, a
        # and b in the positions and the velocities of the axes (6, 3), and the servo itself.
        self._kept = math.ceil((_PAST_S + self._delay) / self._period) + 2
        self._size = self._kept + math.ceil((look_ahead + self._delay) / self._period) + 2
        self._newest = 0
        """Number of the newest tick stored so far."""
        self._factors = np.empty((self._size, 6, 3))
        self._rows = self._factors.reshape(self._size, 18)
        self._rows[:] = servo.factors()
        self._servos = [servo] * self._size

    # --- orders

    def at_tick(self, now: float) -> S:
        """Return the servo at the last tick up to `now`; do not modify it."""
        self.advance(now)
        return self._servo

    def modifiable_servo(self, now: float) -> S:
        """Return a servo that may be modified at `now`, and drop all future ticks."""
        self.advance(now)
        if self._ahead:
            self._ahead.clear()
            self.on_change(self.committed_until(now))
        self._servo = self._servo.copy()
        return self._servo

    # --- the path

    @property
    def servo(self) -> S:
        """Servo at the last completed tick; do not modify it."""
        return self._servo

    def next_tick(self) -> float:
        """Return the time of the servo's next tick, s."""
        return self._powered_at + (self._servo.tick + 1) * self._period

    def committed_until(self, now: float) -> float:
        """Return the time before which no order from `now` on can change the path, s."""
        self.advance(now)
        return self.next_tick() + self._delay - ROUNDING_S

    def predicted_until(self, now: float) -> float:
        """Return the time up to which a reader that handles `on_change` may read the path at `now`, s."""
        return self.committed_until(now) + self._look_ahead

    def at(self, now: float) -> tuple[S, float]:
        """Return the servo whose set point the loops follow at `now`, and the time since they received it, s."""
        tick, since = self._tick_at(now)
        return self._servos[tick % self._size], since

    def _tick_at(self, now: float) -> tuple[int, float]:
        """Return the tick whose set point the loops follow at `now`, and the time since they received it, s."""
        newest = self._compute_to(now - self._delay)
        since = now - (self._powered_at + self._delay)
        tick = math.floor(since / self._period)
        if tick < (oldest := self._oldest()):
            tick = oldest
        if tick > newest:
            tick = newest
        tau = since - tick * self._period
        return tick, tau if tau > 0.0 else 0.0

    def orientation(self, now: float) -> Quaternion:
        """Return the tool frame in the base frame at `now`, w x y z."""
        return self.at(now)[0].turned

    def pose(self, now: float) -> Pose:
        """Return the true tool pose at `now`.

        It equals the result of `trajectory` and `orientations` for this time alone.
        """
        tick, since = self._tick_at(now)
        row = tick % self._size
        # numpy's exponential and product, as for arrays: the results of `math` differ in the last digit
        x, y, z = (self._factors[row, :3] @ np.array((1.0, *self._loop.response(since)))).tolist()
        return Pose((x, y, z), self._servos[row].turned)

    def trajectory(self, times: Floats) -> tuple[Floats, Floats]:
        """Return true positions (n, 3), m, and velocities (n, 3), m/s, base frame.

        `times` (n,) are in ascending order, s. Times before the history yield its first state.
        """
        path = np.empty((6, len(times)))
        first, last = self._ends(times)
        tau = times - (self._powered_at + self._delay)
        stretches = self._stretches(first, last, tau)
        for tick, part in stretches:
            tau[part] -= tick * self._period
        basis = np.empty((3, len(times)))
        basis[0] = 1.0
        basis[1], basis[2] = self._loop.response(np.maximum(tau, 0.0, out=tau))
        for tick, part in stretches:
            np.matmul(self._factors[tick % self._size], basis[:, part], out=path[:, part])
        return path[:3].T, path[3:].T

    def orientations(self, times: Floats) -> list[tuple[slice, Quaternion]]:
        """Return the tool frame in the base frame, w x y z, for consecutive slices of `times` (n,), which ascend.

        Times before the history yield its first orientation.
        """
        first, last = self._ends(times)
        quaternions = [self._servos[tick % self._size].turned for tick in range(first, last + 1)]
        if quaternions.count(quaternions[0]) == len(quaternions):
            return [(slice(0, len(times)), quaternions[0])]
        since = times - (self._powered_at + self._delay)
        return [
            (part, self._servos[tick % self._size].turned)
            for tick, part in self._stretches(first, last, since)
        ]

    def _ends(self, times: Floats) -> tuple[int, int]:
        """Return the ticks whose set points the loops follow at the first and at the last of `times`."""
        begin, end, period = float(times[0]), float(times[-1]), self._period
        # Later ticks have no effect yet.
        newest, oldest = self._compute_to(end - self._delay), self._oldest()
        origin = self._powered_at + self._delay
        first, last = math.floor((begin - origin) / period), math.floor((end - origin) / period)
        return min(max(first, oldest), newest), min(max(last, oldest), newest)

    def _oldest(self) -> int:
        """Return the oldest tick that the history still holds."""
        return max(self._servo.tick - self._kept + 1, self._newest - self._size + 1, 0)

    def _stretches(self, first: int, last: int, since: Floats) -> list[tuple[int, slice]]:
        """Return the ticks from `first` to `last`, each with the slice of `since` to which it applies."""
        if first == last:
            return [(first, slice(0, len(since)))]
        ticks = range(first, last + 1)
        edges = np.floor(since / self._period).searchsorted(tuple(ticks[1:])).tolist()
        return [
            (tick, slice(begin, end))
            for tick, begin, end in zip(ticks, (0, *edges), (*edges, len(since)), strict=True)
            if begin < end
        ]

    # --- ticks

    def advance(self, now: float) -> None:
        """Complete every tick up to and including `now`. Has no effect if there is no such tick."""
        while (at := self.next_tick()) <= now:
            if self._servo.idle and now - at > self._size * self._period:
                self._skip_idle_ticks(now)
            self._servo = self._ahead.popleft() if self._ahead else self._store(self._servo.after_tick())
            for begun_at in self._servo.begins:
                self.targets.begin(begun_at)

    def _after(self, servo: S) -> float:
        """Return the time of the next tick after a servo's tick, s."""
        return self._powered_at + (servo.tick + 1) * self._period

    def _compute_to(self, then: float) -> int:
        """Compute every tick up to and including `then`, and return the number of the last tick."""
        newest = self._ahead[-1] if self._ahead else self._servo
        if self._after(newest) <= then:
            if then - self._after(newest) > self._look_ahead + self._delay:
                # No reader that handles changes reads that far ahead.
                self.advance(then)
                return self._servo.tick
            while self._after(newest) <= then:
                newest = self._store(newest.after_tick())
                self._ahead.append(newest)
            return newest.tick
        tick = min(newest.tick, math.floor((then - self._powered_at) / self._period) + 1)
        while tick > 0 and self._powered_at + tick * self._period > then:
            tick -= 1
        return tick

    def _store(self, servo: S) -> S:
        """Store the state at a tick, so that the path can be read from the time when its set point applies."""
        row = servo.tick % self._size
        self._rows[row] = servo.factors()
        self._servos[row] = servo
        self._newest = max(self._newest, servo.tick)
        return servo

    def _skip_idle_ticks(self, now: float) -> None:
        """Skip ticks in which the arm is stationary and that are too old to be read."""
        self._ahead.clear()
        self._rows[:] = self._servo.factors()
        self._servos = [self._servo] * self._size
        self._servo = self._servo.copy()
        self._servo.tick = self._newest = math.floor((now - self._powered_at) / self._period) - 1
        self._servo.begins = ()
