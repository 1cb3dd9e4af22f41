"""A path that a controller computes cycle by cycle: straight from one cycle's place to the next one's.

The controller looks at its inputs in each cycle and says where the arm is one cycle later. Between the two the arm goes
evenly. The path keeps the last ten seconds.
"""

import math
from collections import deque
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from protocol.geometry import Pose, Quaternion

Floats = NDArray[np.float64]

ROUNDING_S = 1e-9
"""A time nearer than this to another is the same."""
_PAST_S = 10.0
"""Chosen: longer than any stall of a process after which its run is still of use."""
_BEGINS = 256
"""Chosen: begins of motion that are kept, more than targets that a reader asks for."""


def _unread(time: float) -> None:
    """No reader has looked ahead."""


class CycledPath:
    """An `emulators.seams.ArmPath` that calls its controller once a cycle."""

    def __init__(self, start: Pose, powered_at: float, period: float, step: Callable[[float], Pose]) -> None:
        """`step(now)` acts for the cycle that begins at `now`, s, and gives the pose one `period`, s, later."""
        self._powered_at, self._period, self._step = powered_at, period, step
        self.cycle = 0
        """Number of the newest cycle that has begun; cycle 0 is that of the power-up."""
        self.pose = start
        """Where the tool is at its begin."""
        self.next_pose = start
        """Where it is at its end."""
        self.on_change: Callable[[float], object] = _unread
        self.accepted = 0
        self._begun = 0
        self._begins: deque[float] = deque(maxlen=_BEGINS)
        self._size = math.ceil(_PAST_S / period) + 2
        self._places = np.empty((self._size, 3))
        """Place at the begin of cycle k in row k % size, m."""
        self._speeds = np.zeros((self._size, 3))
        self._turns: list[Quaternion] = [start.quaternion] * self._size
        self._places[:] = start.position

    # --- of the controller

    def taken(self) -> None:
        """Note that the controller has taken another target."""
        self.accepted += 1

    def begins(self, at: float) -> None:
        """Begin the motion to the newest target at `at`, s; earlier targets were overtaken."""
        while self._begun < self.accepted:
            self._begun += 1
            self._begins.append(at if self._begun == self.accepted else math.nan)

    def begun_at(self, number: int) -> float | None:
        """When the motion to a target began, s; None before, NaN for one that was overtaken or is forgotten."""
        if number > self._begun:
            return None
        back = self._begun - number
        return self._begins[-1 - back] if back < len(self._begins) else math.nan

    def cycle_at(self, number: int) -> float:
        """When a cycle begins, s."""
        return self._powered_at + number * self._period

    def newest_by(self, now: float) -> int:
        """Return the number of the newest cycle that begins up to `now`, s, whether it has happened yet or not."""
        return math.floor((now + ROUNDING_S - self._powered_at) / self._period)

    # --- of readers

    def advance(self, now: float) -> None:
        """Let all cycles that begin up to `now` happen."""
        while self.cycle_at(self.cycle + 1) <= now + ROUNDING_S:
            self.cycle += 1
            self.pose = self.next_pose
            self.next_pose = self._step(self.cycle_at(self.cycle))
            row = self.cycle % self._size
            here, there = self.pose.position, self.next_pose.position
            self._places[row] = here
            self._speeds[row] = [(b - a) / self._period for a, b in zip(here, there, strict=True)]
            self._turns[row] = self.pose.quaternion

    def committed_until(self, now: float) -> float:
        self.advance(now)
        return max(self.cycle_at(self.cycle + 1) - ROUNDING_S, now)

    def predicted_until(self, now: float) -> float:
        return self.committed_until(now)

    def _cycle_of(self, time: float) -> int:
        """Return the cycle in which a time lies, as far as it is kept."""
        cycle, newest = math.floor((time - self._powered_at) / self._period + ROUNDING_S), self.cycle
        return newest if cycle >= newest else max(cycle, newest - self._size + 1, 0)

    def _stretches(self, times: Floats) -> list[tuple[int, slice]]:
        """Which of these ascending times lie in which cycle, in order."""
        self.advance(float(times[-1]) - ROUNDING_S)
        first, last = self._cycle_of(float(times[0])), self._cycle_of(float(times[-1]))
        if first == last:  # as nearly always: nothing ahead of a cycle is known
            return [(first, slice(0, len(times)))]
        cycles = np.floor((times - self._powered_at) / self._period + ROUNDING_S)
        edges = cycles.searchsorted(tuple(range(first + 1, last + 1))).tolist()
        return [
            (first + number, slice(begin, end))
            for number, (begin, end) in enumerate(pairwise((0, *edges, len(times))))
            if begin < end
        ]

    def trajectory(self, times: Floats) -> tuple[Floats, Floats]:
        stretches = self._stretches(times)
        if len(stretches) == 1:
            return self._straight(stretches[0][0], times)
        parts = [self._straight(cycle, times[part]) for cycle, part in stretches]
        places, speeds = zip(*parts, strict=True)
        return np.concatenate(places), np.concatenate(speeds)

    def _straight(self, cycle: int, times: Floats) -> tuple[Floats, Floats]:
        """Places and velocities (n, 3) at these times (n,), all in one cycle."""
        row, speeds = cycle % self._size, np.empty((len(times), 3))
        speeds[:] = self._speeds[row]
        since = times - self.cycle_at(cycle)
        since = np.minimum(np.maximum(since, 0.0, out=since), self._period, out=since)
        return self._places[row] + speeds * since[:, None], speeds

    def orientations(self, times: Floats) -> list[tuple[slice, Quaternion]]:
        found: list[tuple[slice, Quaternion]] = []
        for cycle, part in self._stretches(times):
            turned = self._turns[cycle % self._size]
            if found and found[-1][1] == turned:
                part = slice(found.pop()[0].start, part.stop)
            found.append((part, turned))
        return found
