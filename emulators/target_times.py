"""Times at which the targets of a robot arrived, and at which the motions to them began."""

import math
from bisect import bisect_right
from collections import deque

_KEPT = 1024
"""Number of targets whose times are kept. Chosen: two seconds of the fastest stream, twice what a reader needs."""


class TargetTimes:
    """Times of the newest targets of a robot. Targets are numbered from 1, and begin in the order of their numbers."""

    def __init__(self) -> None:
        self.accepted = 0
        """Number of targets accepted so far."""
        self._begun = 0
        """Number of targets that are no longer waiting: their motion has begun, or they were dropped."""
        self._arrivals: deque[float] = deque(maxlen=_KEPT)
        self._begins: deque[float] = deque(maxlen=_KEPT)

    # --- for the robot

    def accept(self, at: float) -> None:
        """Add a target whose order arrived at `at`, s: for a robot that reads its inputs once per cycle, the beginning
        of the cycle in which it arrived.
        """
        self.accepted += 1
        self._arrivals.append(at)

    def begin(self, at: float) -> None:
        """Store the time at which the motion to the oldest waiting target begins, s; NaN if it never begins."""
        self._begun += 1
        self._begins.append(at)

    def begin_newest(self, at: float) -> None:
        """Store the time at which the motion to the newest target begins, s. Earlier waiting targets are dropped."""
        while self._begun < self.accepted:
            self.begin(at if self._begun + 1 == self.accepted else math.nan)

    def drop(self, count: int | None = None) -> None:
        """Drop the `count` oldest waiting targets; all if it is None."""
        for _ in range(self.accepted - self._begun if count is None else count):
            self.begin(math.nan)

    # --- for readers

    def arrived_by(self, at: float) -> int:
        """Return the number of accepted targets whose orders arrived up to and including the time `at`, s."""
        return self.accepted - len(self._arrivals) + bisect_right(self._arrivals, at)

    def begun_at(self, number: int) -> float | None:
        """Return the time at which the motion to a target began, s.

        The result is None while the time is unknown, and NaN for a target that was dropped or is no longer kept.
        """
        if number > self._begun:
            return None
        back = self._begun - number
        return self._begins[-1 - back] if back < len(self._begins) else math.nan
