"""Rules for which datagrams of a robot are answered, and when. A surplus answer would remain in the robot's queue."""

from collections import deque

from protocol.devices.egm.messages import PoseMm

_TRANSIT_SHARE = 0.1
"""Time for transmission and processing of a datagram and its answer, as a fraction of a cycle. Chosen."""
_WAITING_MAX = 1024
"""Maximum number of reports that wait for their answers. Chosen."""


class Answers:
    """Record of the answers to the datagrams of one robot."""

    def __init__(self, cycle: float) -> None:
        self._cycle = cycle
        self.due = False
        """Whether a datagram is waiting for its answer."""
        self._repeats: deque[bool] = deque(maxlen=_WAITING_MAX)
        """Whether the datagram of each report that waits for its answer was a repeat."""
        self._waiting_since: float | None = None
        """Time at which the answer that may still be in the robot's queue was sent, s; None if the queue is empty."""
        self._is_ending = False
        """Whether a movement has ended while the tool was moving. The speed is then withdrawn at once, because the
        next datagram may not be answered.
        """
        self._skips_next = False
        """Whether the early answer that withdrew the speed already answered the next datagram."""
        self.count = 0
        """Number of answers sent so far."""
        self.reference: PoseMm | None = None
        """Reference in the newest answer. `number` is the number of the report that was answered."""
        self.number = 0
        self._has_speed = False
        """Whether the newest answer carried a speed."""

    def expect(self, again: bool) -> None:
        """Record that a report waits for its answer. `again` marks a repeated datagram, which gets no answer."""
        self._repeats.append(again)

    def allow(self, allowed: bool) -> None:
        """Mark the answer to the oldest report as due if `allowed` is true and its datagram was not a repeat."""
        again = self._repeats.popleft() if self._repeats else False
        self.due |= not again and allowed

    def pass_time(self, at: float) -> None:
        """Record the arrival time `at` of a datagram, s: the robot has by then read every answer that was sent
        early enough.
        """
        if self._waiting_since is not None and at - self._waiting_since >= _TRANSIT_SHARE * self._cycle:
            self._waiting_since = None

    def end_movement(self, moving: bool) -> None:
        """Withdraw the speed at once if the robot is `moving` and the newest answer carried a speed."""
        self._is_ending = moving and self._has_speed

    def begin_answer(self, now: float) -> bool:
        """Return whether to send an answer now."""
        if not (self.due or self._is_ending):
            return False
        if self._is_ending:
            self._skips_next = not self.due
        elif self._skips_next or self._waiting_since is not None:
            self.due = self._skips_next = False
            return False
        self.due = self._is_ending = False
        self._waiting_since = now
        return True

    def note(self, reference: PoseMm, number: int, has_speed: bool) -> None:
        """Record that an answer to report `number` was sent."""
        self.reference, self.number, self._has_speed = reference, number, has_speed
        self.count += 1
