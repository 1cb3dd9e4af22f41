"""A motion in time: its past, the present tick, and its future unless more is ordered.

Time runs on two shifted grids: the ticks of a servo, and the moments at which the position loops take their set points.
The second grid lies one transport delay later. Ticks are computed one by one, samples between them as arrays.

The path may be read beyond its committed end, as if no further order came. Ticks are computed once, those ahead as
well; ticks that an order overtakes are computed again.
"""

import math
from collections import deque
from collections.abc import Callable
from typing import Generic, Protocol, Self, TypeVar

import numpy as np

from emulators.arm.loops import Floats, PositionLoop, Ticks
from protocol.geometry import Pose, Quaternion

ROUNDING_S = 1e-9
"""A time nearer than this to another is the same: the sum of ticks carries rounding errors."""
_PAST_S = 10.0
"""Chosen: longer than any stall of a process after which its run is still of use."""
_BEGINS = 256
"""Chosen: begins of motion that are kept, more than targets that a reader asks for."""


class Servo(Protocol):
    """An arm's servo as it is from one tick to the next.

    A history keeps many of them. So a servo changes only before it is noted; `after_tick` and `copy` make another.
    """

    tick: int
    """Number of the tick that it stands at."""
    turned: Quaternion
    """Tool frame in the base frame from the moment on at which the loops take this tick's set point, w x y z."""
    begins: tuple[float, ...]
    """When the loops take the first set point on the way to each target that was come to in this tick, s; NaN for one
    that was overtaken.
    """

    @property
    def idle(self) -> bool:
        """Whether nothing moves and nothing is to be done."""

    def after_tick(self) -> Self:
        """Return the servo at the next tick."""

    def copy(self) -> Self:
        """Another one like it, to be changed."""

    def factors(self) -> tuple[float, ...]:
        """As `PositionLoop.factors`, from the moment on at which the loops take this tick's set point."""


S = TypeVar("S", bound=Servo)


def _unread(committed_until: float) -> None:
    """No reader has looked ahead."""


class History(Generic[S]):
    """The path of an arm: `emulators.seams.ArmPath`. It keeps the last ten seconds."""

    def __init__(self, servo: S, ticks: Ticks, loop: PositionLoop, look_ahead: float) -> None:
        """`look_ahead` is for how long the path may be read beyond its committed end, s."""
        self._loop = loop
        self._look_ahead = look_ahead
        self._powered_at, self._period, self._delay = ticks.powered_at, ticks.period, ticks.delay
        self._servo = servo
        """As of the last tick that is over."""
        self._ahead: deque[S] = deque()
        """After the ticks behind it, as if nothing were ordered meanwhile."""
        self.on_change: Callable[[float], object] = _unread
        """Called when an order changes the ticks ahead, with the time up to which the path stays as it was read, s."""
        self.accepted = 0
        """Targets taken so far; the first has the number 1."""
        self._begun = 0
        """How many of them are no longer waiting: the servo has come to them, or they were given up."""
        self._begins: deque[float] = deque(maxlen=_BEGINS)

        # Item k % n describes the loops from the moment they take set point k. It holds the factors of 1, a and b in
        # the positions and the velocities of the axes (6, 3), and the servo itself.
        self._kept = math.ceil((_PAST_S + self._delay) / self._period) + 2
        self._size = self._kept + math.ceil((look_ahead + self._delay) / self._period) + 2
        self._newest = 0
        """The highest tick that was ever noted."""
        self._factors = np.empty((self._size, 6, 3))
        self._rows = self._factors.reshape(self._size, 18)
        self._rows[:] = servo.factors()
        self._servos = [servo] * self._size

    # --- orders

    def at_tick(self, now: float) -> S:
        """Return the servo as of the last tick up to `now`; not to be changed."""
        self.advance(now)
        return self._servo

    def changing(self, now: float) -> S:
        """Return the servo that is to be changed at `now`; everything computed after it is dropped."""
        self.advance(now)
        if self._ahead:
            self._ahead.clear()
            self.on_change(self.committed_until(now))
        self._servo = self._servo.copy()
        return self._servo

    def give_up(self) -> None:
        """No target that waits will be come to."""
        while self._begun < self.accepted:
            self._begin(math.nan)

    def begun_at(self, number: int) -> float | None:
        """When the position loops took, or will take, the first set point on the way to the target of this number,
        s; None before that is known, NaN for a target that was given up.
        """
        if number > self._begun:
            return None
        kept = self._begun - len(self._begins)
        return self._begins[number - kept - 1] if number > kept else math.nan

    def _begin(self, at: float) -> None:
        self._begun += 1
        self._begins.append(at)

    # --- the path

    @property
    def servo(self) -> S:
        """The servo as of the last tick that is over; not to be changed."""
        return self._servo

    def next_tick(self) -> float:
        """When the servo next acts, s."""
        return self._powered_at + (self._servo.tick + 1) * self._period

    def committed_until(self, now: float) -> float:
        """Up to when the path is settled whatever is ordered from `now` on, s, that moment excluded."""
        self.advance(now)
        return self.next_tick() + self._delay - ROUNDING_S

    def predicted_until(self, now: float) -> float:
        """Up to when the path may be read at `now`, s, by a reader that minds `on_change`."""
        return self.committed_until(now) + self._look_ahead

    def at(self, now: float) -> tuple[S, float]:
        """Return the servo whose set point the loops have at `now`, and the time since they took it, s."""
        tick, since = self._tick_at(now)
        return self._servos[tick % self._size], since

    def _tick_at(self, now: float) -> tuple[int, float]:
        """Return the tick whose set point the loops have at `now`, and the time since they took it, s."""
        newest = self._look_to(now - self._delay)
        since = now - (self._powered_at + self._delay)
        tick = math.floor(since / self._period)
        if tick < (oldest := self._oldest()):
            tick = oldest
        if tick > newest:
            tick = newest
        tau = since - tick * self._period
        return tick, tau if tau > 0.0 else 0.0

    def orientation(self, now: float) -> Quaternion:
        """Tool frame in the base frame at `now`, w x y z."""
        return self.at(now)[0].turned

    def pose(self, now: float) -> Pose:
        """Where the tool is at `now`: as `trajectory` and `orientations` of this time alone."""
        tick, since = self._tick_at(now)
        row = tick % self._size
        # numpy's exponential and product, as of arrays: those of `math` differ in the last digit
        x, y, z = (self._factors[row, :3] @ np.array((1.0, *self._loop.response(since)))).tolist()
        return Pose((x, y, z), self._servos[row].turned)

    def trajectory(self, times: Floats) -> tuple[Floats, Floats]:
        """Return true positions (n, 3), m, and velocities (n, 3), m/s, base frame, at ascending `times` (n,).

        Times before the history answer as its first moment.
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
        """Tool frame in the base frame, w x y z, at ascending `times` (n,): which of them have which, in
        order; history as above.
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
        """Ticks whose set points the loops have at the first and the last of `times`."""
        begin, end, period = float(times[0]), float(times[-1]), self._period
        # Later ticks have no say yet.
        newest, oldest = self._look_to(end - self._delay), self._oldest()
        taken = self._powered_at + self._delay
        first, last = math.floor((begin - taken) / period), math.floor((end - taken) / period)
        return min(max(first, oldest), newest), min(max(last, oldest), newest)

    def _oldest(self) -> int:
        """Return the first tick that the history still holds."""
        return max(self._servo.tick - self._kept + 1, self._newest - self._size + 1, 0)

    def _stretches(self, first: int, last: int, since: Floats) -> list[tuple[int, slice]]:
        """Return the ticks from `first` to `last`, each with the part of `since` that it holds for."""
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
        """Let every tick up to and including `now` be over; no effect if there is none."""
        while (at := self.next_tick()) <= now:
            if self._servo.idle and now - at > self._size * self._period:
                self._skip_rest(now)
            self._servo = self._ahead.popleft() if self._ahead else self._noted(self._servo.after_tick())
            for begun_at in self._servo.begins:
                self._begin(begun_at)

    def _after(self, servo: S) -> float:
        """When the tick behind that of a servo is, s."""
        return self._powered_at + (servo.tick + 1) * self._period

    def _look_to(self, then: float) -> int:
        """Have every tick up to and including `then` computed; the number of the last of them."""
        newest = self._ahead[-1] if self._ahead else self._servo
        if self._after(newest) <= then:
            if then - self._after(newest) > self._look_ahead + self._delay:
                # No reader that minds changes looks that far.
                self.advance(then)
                return self._servo.tick
            while self._after(newest) <= then:
                newest = self._noted(newest.after_tick())
                self._ahead.append(newest)
            return newest.tick
        tick = min(newest.tick, math.floor((then - self._powered_at) / self._period) + 1)
        while tick > 0 and self._powered_at + tick * self._period > then:
            tick -= 1
        return tick

    def _noted(self, servo: S) -> S:
        """Let the path be read from this tick's set point on."""
        row = servo.tick % self._size
        self._rows[row] = servo.factors()
        self._servos[row] = servo
        self._newest = max(self._newest, servo.tick)
        return servo

    def _skip_rest(self, now: float) -> None:
        """Jump over ticks in which nothing moves and which no reader can ask about any more."""
        self._ahead.clear()
        self._rows[:] = self._servo.factors()
        self._servos = [self._servo] * self._size
        self._servo = self._servo.copy()
        self._servo.tick = self._newest = math.floor((now - self._powered_at) / self._period) - 1
        self._servo.begins = ()
