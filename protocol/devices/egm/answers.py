"""Which datagrams of a robot are answered, and when. A surplus answer would stay in the robot's queue."""

from collections import deque

from protocol.devices.egm.messages import PoseMm

_ON_THE_WAY = 0.1
"""Chosen: part of a cycle that datagram and answer need to reach the other side, together, and to be looked at."""
_WAITING_MAX = 1024
"""Chosen: reports that are kept until they are answered."""


class Answers:
    """Answers to the datagrams of one robot."""

    def __init__(self, cycle: float) -> None:
        self._cycle = cycle
        self.due = False
        """A datagram waits for its answer."""
        self._again: deque[bool] = deque(maxlen=_WAITING_MAX)
        """For each report that waits for its answer: whether it is one of a datagram that came again."""
        self._waiting_since: float | None = None
        """When the answer left that may still be in the robot's queue, s; None if there is none."""
        self._ends = False
        """A movement has ended on its way: its speed is withdrawn at once, for no other datagram may be answered."""
        self._left_out = False
        """The next datagram has had its answer so."""
        self.count = 0
        """Answers so far."""
        self.reference: PoseMm | None = None
        """That of the newest answer, and the number of the report that it answered."""
        self.number = 0
        self._has_speed = False
        """That answer carried a speed."""

    def expect(self, again: bool) -> None:
        """Expect the answer to a report; `again`: its datagram was a repeat, which gets no answer."""
        self._again.append(again)

    def allow(self, allowed: bool) -> None:
        """Allow the answer to the oldest report, if it is `allowed` at all."""
        again = self._again.popleft() if self._again else False
        self.due |= not again and allowed

    def pass_time(self, at: float) -> None:
        """Note that a datagram arrived at a time, s: the robot has read every answer that left early enough."""
        if self._waiting_since is not None and at - self._waiting_since >= _ON_THE_WAY * self._cycle:
            self._waiting_since = None

    def end_movement(self, moving: bool) -> None:
        """Withdraw a speed at once, if the robot is `moving` by one."""
        self._ends = moving and self._has_speed

    def begin_answer(self, now: float) -> bool:
        """Whether an answer leaves now."""
        if not (self.due or self._ends):
            return False
        if self._ends:
            self._left_out = not self.due
        elif self._left_out or self._waiting_since is not None:
            self.due = self._left_out = False
            return False
        self.due = self._ends = False
        self._waiting_since = now
        return True

    def note(self, reference: PoseMm, number: int, has_speed: bool) -> None:
        """Note that an answer to the report of this number was sent."""
        self.reference, self.number, self._has_speed = reference, number, has_speed
        self.count += 1
