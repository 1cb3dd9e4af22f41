"""Position loops of six joints that follow their set points after a delay, cycle by cycle. Angles are in degrees."""

from collections import deque
from collections.abc import Sequence

from emulators.arm.loops import PositionLoop
from protocol.arm_size import PerAxis

STILL: PerAxis = (0.0,) * 6
"""Speeds of stationary joints, degrees/s."""
_REST_DEG = 1e-9
"""Distance below which the loops count as stationary, degrees. Chosen."""


class JointLoops:
    """Delay and position loops of the joints of an arm."""

    def __init__(self, joints: PerAxis, loop: PositionLoop, delay_s: float, cycle_s: float) -> None:
        """Power up stationary. The delay is rounded to complete cycles."""
        self._cycle = cycle_s
        self._factors = loop.over(cycle_s)
        self.joints = joints
        """Joints at the end of the last cycle."""
        self.rates = STILL
        """Speeds of the loops, degrees/s."""
        self._usual = round(delay_s / cycle_s)
        self._extra = 0
        """Cycles by which the set points are delayed in addition."""
        self.delayed = deque([joints] * self._usual)
        """Set points that the loops have not received yet, oldest first."""

    @property
    def delay_s(self) -> float:
        """Delay from a set point to the loops, s."""
        return len(self.delayed) * self._cycle

    def delay(self, seconds: float) -> None:
        """Delay the set points by a time in addition. A shorter delay takes effect when the arm is stationary."""
        self._extra = round(seconds / self._cycle)

    def follow(self, set_point: PerAxis, is_still: bool) -> PerAxis:
        """Run a cycle, and return the joints at its end. `is_still` allows a shorter delay to take effect."""
        self.delayed.append(set_point)
        pull = self.delayed[0]
        if len(self.delayed) > self._usual + self._extra:
            pull = self.delayed.popleft()
            if is_still and len(self.delayed) > self._usual + self._extra:
                self.delayed.popleft()
        if pull != self.joints or self.rates != STILL:
            self.joints = self._approach(pull)
        return self.joints

    def rest(self, joints: PerAxis) -> None:
        """Put the loops and all delayed set points at rest at these joints."""
        self.joints, self.rates = joints, STILL
        self.delayed = deque([joints] * len(self.delayed))

    def _approach(self, pull: PerAxis) -> PerAxis:
        a, b, c, d = self._factors
        errors = [joint - to for joint, to in zip(self.joints, pull, strict=True)]
        rates = [c * error + d * rate for error, rate in zip(errors, self.rates, strict=True)]
        ends = [to + a * e + b * rate for to, e, rate in zip(pull, errors, self.rates, strict=True)]
        near = max(max(abs(to - q) for to, q in zip(pull, ends, strict=True)), max(map(abs, rates)) * 1e-2)
        if near < _REST_DEG:
            self.rates = STILL
            return pull
        self.rates = six(rates)
        return six(ends)


def six(values: Sequence[float]) -> PerAxis:
    """Return the values of six joints as a tuple. Raises ValueError for another number of them."""
    a, b, c, d, e, f = values
    return a, b, c, d, e, f
