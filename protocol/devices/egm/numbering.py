"""Numbers of a robot's datagrams: which follow, which are strays, and how long its cycle is by them."""

import math

from protocol.devices.egm.messages import RobotMessage
from protocol.endpoint import NO_TROUBLE, Trouble
from protocol.numbering import AHEAD_MAX, NewNumbers

_NUMBERS = 2**32
_LATE_MAX = 64
"""A number that is smaller by more belongs to a new session. Chosen: a quarter of a second at 4 ms."""
_SILENCE_S = 1.0
"""Chosen: after so long without a datagram a number that is not larger belongs to a new session. Source: specification
of EGM, section 8, rule 7."""
_CYCLES_TIMED = 25
"""Chosen: datagrams over which the robot's cycle is measured by its own clock, before anything moves."""
_CYCLE_TOLERANCE = 0.2
"""Chosen: part by which that may differ; a cycle of 4.032 ms counts as 4 ms."""


class Numbering:
    """Knows the newest datagram of a robot, and numbers the next one."""

    def __init__(self, cycle: float) -> None:
        self._cycle = cycle
        self.number = 0
        """Number of the newest report."""
        self.seqno: int | None = None
        """Number of the newest datagram as sent; None before the first."""
        self.tm = 0
        """Its time by the controller's clock, ms."""
        self._arrived_at = -math.inf
        self._strays = NewNumbers(cycle)
        """Datagrams whose numbers do not follow; they are not answered."""
        self.guided_on = False
        """All of these are of a robot that is guided on and stands where it did."""

    def distance(self, message: RobotMessage, at: float) -> int | None:
        """By how much the number of a datagram is larger than the newest one; None where it does not follow."""
        if self.seqno is None:
            return None
        ahead = _signed(message.seqno - self.seqno)
        if 0 < ahead <= (at - self._arrived_at) / self._cycle + AHEAD_MAX:
            return ahead
        if ahead > 0:
            return None
        later = _signed(message.tm_ms - self.tm) > 0  # the controller's clock continues with a new session
        return None if later or self.is_silent(at) or ahead < -_LATE_MAX else ahead

    def _silent(self, at: float) -> bool:
        return at - self._arrived_at > _SILENCE_S

    def is_silent(self, at: float) -> bool:
        """Whether nothing has come for so long that any number begins a session."""
        return at - self._arrived_at > _SILENCE_S

    def is_stray(self, message: RobotMessage, guided: bool, at: float) -> bool:
        """Whether to ignore a datagram that does not follow, because the robot has not restarted its numbers.
        `guided` says whether it is of a robot that is guided where the newest reference is.
        """
        if self.seqno is None or self.is_silent(at):
            self.guided_on = False
            return False
        first = not self._strays.waits
        restarted = self._strays.take(message.seqno, at)
        self.guided_on = (first or self.guided_on) and guided
        return not restarted

    def ahead(self, message: RobotMessage) -> int:
        """By how much the number of a datagram is larger than the newest one."""
        return 0 if self.seqno is None else _signed(message.seqno - self.seqno)

    def follow(self, message: RobotMessage, distance: int, at: float) -> None:
        """Accept this datagram as the newest; skipped ones that did not follow were strays."""
        self._strays.forget()
        self.number += distance
        self.seqno, self.tm, self._arrived_at = message.seqno, message.tm_ms, at


class CycleCheck:
    """Measures the robot's cycle once in a session: all speeds are distances of a cycle."""

    def __init__(self, cycle: float) -> None:
        self._cycle = cycle
        self._first: tuple[int, int] | None = None
        """Number and tm of a session's first datagram until its cycle has been measured."""
        self.trouble = NO_TROUBLE
        """A cycle that is not as expected."""

    def begin(self, message: RobotMessage) -> None:
        """Begin a session with this datagram."""
        self._first, self.trouble = (message.seqno, message.tm_ms), NO_TROUBLE

    def take(self, message: RobotMessage) -> None:
        """Measure by a datagram."""
        if self._first is None:
            return
        seqno, tm = self._first
        count = _signed(message.seqno - seqno)
        if count < _CYCLES_TIMED:
            return
        if count > 2 * _CYCLES_TIMED:  # numbers jumped
            self._first = message.seqno, message.tm_ms
            return
        self._first = None
        cycle = _signed(message.tm_ms - tm) * 1e-3 / count
        if abs(cycle - self._cycle) > _CYCLE_TOLERANCE * self._cycle:
            self.trouble = Trouble(
                f"it sends every {cycle * 1e3:.1f} ms and not every {self._cycle * 1e3:g} ms",
                "set robot.egm.sample_ms to the SampleRate of its program",
            )


def _signed(difference: int) -> int:
    """Return the signed difference of two 32-bit counters that wrap around."""
    return (difference + _NUMBERS // 2) % _NUMBERS - _NUMBERS // 2
