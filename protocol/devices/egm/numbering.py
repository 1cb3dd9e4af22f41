"""Sequence numbers of a robot's datagrams: distinguishes regular datagrams from strays, and measures the robot's
cycle.
"""

import math

from protocol.devices.egm.messages import RobotMessage
from protocol.endpoint import NO_TROUBLE, Trouble
from protocol.numbering import AHEAD_MAX, NewNumbers

_NUMBERS = 2**32
_LATE_MAX = 64
"""Largest decrease of the number for a late datagram. A number that is even smaller belongs to a new session.
Chosen: a quarter of a second at 4 ms.
"""
_SILENCE_S = 1.0
"""Duration of silence, s, after which a number that has not increased belongs to a new session. Chosen. Source:
specification of EGM, section 8, rule 7.
"""
_CYCLES_TIMED = 25
"""Number of datagrams over which the robot's cycle is measured on the robot's own clock, before any movement.
Chosen.
"""
_CYCLE_TOLERANCE = 0.2
"""Allowed relative deviation of the cycle. Chosen: a cycle of 4.032 ms counts as 4 ms."""


class Numbering:
    """Tracker of the newest datagram of a robot. It numbers the next datagram."""

    def __init__(self, cycle: float) -> None:
        self._cycle = cycle
        self.number = 0
        """Number of the newest report."""
        self.seqno: int | None = None
        """Sequence number of the newest datagram as sent; None before the first datagram."""
        self.tm = 0
        """Time stamp of the newest datagram on the controller's clock, ms."""
        self._arrived_at = -math.inf
        self._strays = NewNumbers(cycle)
        """Datagrams whose numbers are out of sequence. They are not answered."""
        self.guided_on = False
        """Whether all out-of-sequence datagrams come from a robot that is still guided and has not moved."""

    def distance(self, message: RobotMessage, at: float) -> int | None:
        """Return the number of a datagram minus the number of the newest one; None if the datagram does not
        continue the session.
        """
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
        """Return whether no datagram has arrived for so long that any number starts a new session."""
        return at - self._arrived_at > _SILENCE_S

    def is_stray(self, message: RobotMessage, guided: bool, at: float) -> bool:
        """Return whether to ignore a datagram that does not continue the session, because the robot has not
        restarted its numbering.

        `guided` says whether the datagram comes from a robot that is guided at the newest reference.
        """
        if self.seqno is None or self.is_silent(at):
            self.guided_on = False
            return False
        first = not self._strays.waits
        restarted = self._strays.take(message.seqno, at)
        self.guided_on = (first or self.guided_on) and guided
        return not restarted

    def ahead(self, message: RobotMessage) -> int:
        """Return the number of a datagram minus the number of the newest one, without any check."""
        return 0 if self.seqno is None else _signed(message.seqno - self.seqno)

    def follow(self, message: RobotMessage, distance: int, at: float) -> None:
        """Accept this datagram as the newest. The out-of-sequence datagrams before it were strays."""
        self._strays.forget()
        self.number += distance
        self.seqno, self.tm, self._arrived_at = message.seqno, message.tm_ms, at


class CycleCheck:
    """Measurement of the robot's cycle once per session, because all speeds are distances per cycle."""

    def __init__(self, cycle: float) -> None:
        self._cycle = cycle
        self._first: tuple[int, int] | None = None
        """Sequence number and time stamp of the first datagram of the measurement; None after the measurement."""
        self.trouble = NO_TROUBLE
        """Reason to reject the measured cycle."""

    def begin(self, message: RobotMessage) -> None:
        """Begin the measurement of a session with its first datagram."""
        self._first, self.trouble = (message.seqno, message.tm_ms), NO_TROUBLE

    def take(self, message: RobotMessage) -> None:
        """Use a datagram for the measurement."""
        if self._first is None:
            return
        seqno, tm = self._first
        count = _signed(message.seqno - seqno)
        if count < _CYCLES_TIMED:
            return
        if count > 2 * _CYCLES_TIMED:  # the numbers jumped
            self._first = message.seqno, message.tm_ms
            return
        self._first = None
        cycle = _signed(message.tm_ms - tm) * 1e-3 / count
        if abs(cycle - self._cycle) > _CYCLE_TOLERANCE * self._cycle:
            self.trouble = Trouble(
                f"it sends every {cycle * 1e3:.1f} ms instead of every {self._cycle * 1e3:g} ms",
                "set robot.egm.sample_ms to the SampleRate of its program",
            )


def _signed(difference: int) -> int:
    """Return the signed difference of two 32-bit counters that wrap around."""
    return (difference + _NUMBERS // 2) % _NUMBERS - _NUMBERS // 2
