"""Arm path that a controller computes cycle by cycle.

The controller reads its inputs in each cycle and returns the pose of the arm one cycle later. In between, the arm
moves in a straight line at constant speed. The path keeps the last ten seconds.
"""

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from emulators.target_times import TargetTimes
from protocol.geometry import Pose, Quaternion

Floats = NDArray[np.float64]

ROUNDING_S = 1e-9
"""Largest difference between two times that count as equal, s."""
_PAST_S = 10.0
"""Length of the past path that is kept, s. Chosen: longer than any stall of a process after which its run is still
useful.
"""


def _unread(time: float) -> None:
    """Do nothing, because no reader has read ahead."""


class CycledPath:
    """Path of an arm whose controller is called once per cycle; an `emulators.seams.ArmPath`."""

    def __init__(self, start: Pose, powered_at: float, period: float, step: Callable[[float], Pose]) -> None:
        """`step(now)` runs the cycle that begins at `now`, s, and returns the pose one `period`, s, later."""
        self._powered_at, self._period, self._step = powered_at, period, step
        self.cycle = 0
        """Number of the newest cycle that has begun; cycle 0 begins at power-up."""
        self.pose = start
        """Tool pose at the start of the current cycle."""
        self.next_pose = start
        """Tool pose at the end of the current cycle."""
        self.on_change: Callable[[float], object] = _unread
        self.targets = TargetTimes()
        self._next_at = powered_at + period
        """Time at which the next cycle begins, s."""
        self._size = math.ceil(_PAST_S / period) + 2
        self._places = np.empty((self._size, 3))
        """Position at the start of cycle k in row k % size, m."""
        self._speeds = np.zeros((self._size, 3))
        self._turns: list[Quaternion] = [start.quaternion] * self._size
        self._places[:] = start.position

    # --- for the controller

    def cycle_at(self, number: int) -> float:
        """Return the time at which a cycle begins, s."""
        return self._powered_at + number * self._period

    def newest_by(self, now: float) -> int:
        """Return the number of the last cycle that begins by `now`, s, whether or not it has been computed."""
        return math.floor((now + ROUNDING_S - self._powered_at) / self._period)

    # --- for readers

    def advance(self, now: float) -> None:
        """Compute all cycles that begin by `now`."""
        while self._next_at <= now + ROUNDING_S:
            at = self._next_at
            self.cycle += 1
            self._next_at = self.cycle_at(self.cycle + 1)
            self.pose = self.next_pose
            self.next_pose = self._step(at)
            row = self.cycle % self._size
            (x, y, z), (u, v, w), period = self.pose.position, self.next_pose.position, self._period
            self._places[row] = x, y, z
            self._speeds[row] = (u - x) / period, (v - y) / period, (w - z) / period
            self._turns[row] = self.pose.quaternion

    def committed_until(self, now: float) -> float:
        self.advance(now)
        return max(self._next_at - ROUNDING_S, now)

    def predicted_until(self, now: float) -> float:
        return self.committed_until(now)

    def _cycle_of(self, time: float) -> int:
        """Return the number of the cycle that contains a time, limited to the cycles that are kept."""
        cycle, newest = math.floor((time - self._powered_at) / self._period + ROUNDING_S), self.cycle
        return newest if cycle >= newest else max(cycle, newest - self._size + 1, 0)

    def _cycles_of(self, times: Floats) -> Floats:
        """Return the numbers of the cycles that contain these times (n,), limited to the cycles that are kept."""
        cycles: Floats = np.floor((times - self._powered_at) / self._period + ROUNDING_S)
        oldest = max(self.cycle - self._size + 1, 0)
        return np.minimum(np.maximum(cycles, oldest, out=cycles), self.cycle, out=cycles)

    def trajectory(self, times: Floats) -> tuple[Floats, Floats]:
        self.advance(float(times[-1]) - ROUNDING_S)
        cycles = self._cycles_of(times)
        rows = cycles.astype(int) % self._size
        since = times - (self._powered_at + cycles * self._period)
        since = np.minimum(np.maximum(since, 0.0, out=since), self._period, out=since)
        speeds = self._speeds[rows]
        return self._places[rows] + speeds * since[:, None], speeds

    def orientations(self, times: Floats) -> list[tuple[slice, Quaternion]]:
        self.advance(float(times[-1]) - ROUNDING_S)
        first, last = self._cycle_of(float(times[0])), self._cycle_of(float(times[-1]))
        if first == last:  # the usual case: no cycle after the current one is known
            return [(slice(0, len(times)), self._turns[first % self._size])]
        edges = self._cycles_of(times).searchsorted(np.arange(first + 1, last + 1)).tolist()
        stretches: list[tuple[slice, Quaternion]] = []
        for cycle, (begin, end) in enumerate(pairwise((0, *edges, len(times))), first):
            if begin < end:
                orientation = self._turns[cycle % self._size]
                if stretches and stretches[-1][1] == orientation:
                    begin = stretches.pop()[0].start
                stretches.append((slice(begin, end), orientation))
        return stretches
