"""Whether a telegram continues the session of those before: by its clock, its count of late answers, its set pose."""

import math
from enum import Enum, auto
from typing import NamedTuple

from protocol.devices.rsi.corrections import Correction
from protocol.devices.rsi.profile import RsiLink
from protocol.devices.rsi.robot_telegram import RobotTelegram
from protocol.geometry import Pose
from protocol.kinematics import Joints
from protocol.numbering import AHEAD_MAX, NewNumbers

SESSION_MS = 1000
"""Chosen: a clock that jumps by more, either way, is that of a restarted program."""
PLANNED_MM = 0.1
"""Chosen: a set position that moves by more is that of a program that was restarted, or that moves by itself."""
PLANNED_DEG = 0.02
"""Chosen: the same of a set axis, where the axes are corrected."""


class Arrival(Enum):
    """What a telegram is to those before."""

    NEXT = auto()
    RENUMBERED = auto()
    """The next one, of a clock that jumped."""
    RESTARTED = auto()
    """The first of a program that was restarted, or moves by itself."""
    RESUMED = auto()
    """The first after a silence, or at all."""
    OLD = auto()
    """It was held up, or came again."""
    STRAY = auto()
    """Of a clock from elsewhere, the first of such ones."""
    STRAY_AGAIN = auto()


class Place(NamedTuple):
    """The place of a telegram in the stream."""

    arrival: Arrival
    sequence: int
    """Its number in the stream, in cycles."""
    cycles: int
    """Cycles since the telegram before."""


class Continuity:
    """Knows the newest telegram of a robot, and places the next one."""

    def __init__(self, link: RsiLink) -> None:
        self._link = link
        self.newest: int | None = None
        """Clock of the newest telegram, ms."""
        self.late: int | None = None
        """Its count of late answers."""
        self._strays = NewNumbers(link.cycle_ms * 1e-3, link.cycle_ms)
        """Telegrams whose clocks do not follow; they are not answered."""
        self._sequence = 0
        self._received_at = -math.inf
        self._planned: Pose | None = None
        """Set position of the newest telegram with one."""
        self._planned_axes: Joints | None = None
        """Set axes of the newest telegram with them."""

    def place(self, telegram: RobotTelegram, at: float, total: Correction) -> Place:
        """Place a telegram that came at a time, s, of a robot with this correction. It is the newest then, unless it is
        old or stray.
        """
        arrival, cycles = self._judge(telegram, at, total)
        if arrival in (Arrival.OLD, Arrival.STRAY, Arrival.STRAY_AGAIN):
            return Place(arrival, self._sequence + cycles, cycles)
        self._strays.forget()
        self._sequence += cycles
        self.newest, self._received_at, self.late = telegram.ipoc, at, telegram.late
        self._planned = telegram.planned or self._planned
        self._planned_axes = telegram.planned_axes or self._planned_axes
        return Place(arrival, self._sequence, cycles)

    def _judge(self, telegram: RobotTelegram, at: float, total: Correction) -> tuple[Arrival, int]:
        """Classify a telegram and count the cycles since the newest."""
        since_ms, cycle = (at - self._received_at) * 1e3, self._link.cycle_ms
        silent = at - self._received_at > SESSION_MS / 1e3
        if self.newest is None:
            return Arrival.RESUMED, 1
        passed = telegram.ipoc - self.newest
        cycles = round(passed / cycle) or (1 if passed > 0 else 0)
        first = not self._strays.waits
        follows = silent or 0 < passed <= since_ms + AHEAD_MAX * cycle
        if not follows and not self._strays.take(telegram.ipoc, at):
            old = -SESSION_MS <= passed <= 0
            return Arrival.OLD if old else Arrival.STRAY if first else Arrival.STRAY_AGAIN, cycles
        jumped, restarted = passed <= 0 or passed > SESSION_MS, self._is_restarted(telegram)
        if jumped and not silent and not restarted and self._is_corrected(telegram, total):
            return Arrival.RENUMBERED, max(1, round(since_ms / cycle))
        if jumped or restarted:
            return Arrival.RESTARTED, 1
        return Arrival.RESUMED if silent else Arrival.NEXT, cycles

    def _is_corrected(self, telegram: RobotTelegram, total: Correction) -> bool:
        """Whether the robot is where its correction brought it, so that only the numbers are others."""
        offset = telegram.offset
        return offset is not None and math.dist(offset[:3], total[:3]) <= self._link.stray_mm

    def _is_restarted(self, telegram: RobotTelegram) -> bool:
        """Whether the count of late answers has restarted, or the set position is another."""
        if telegram.late is not None and self.late is not None and telegram.late < self.late:
            return True
        if telegram.planned_axes is not None and self._planned_axes is not None:
            turns = zip(telegram.planned_axes, self._planned_axes, strict=True)
            if any(abs(to - was) > PLANNED_DEG for to, was in turns):
                return True
        if telegram.planned is None or self._planned is None:
            return False
        return math.dist(telegram.planned.position, self._planned.position) * 1e3 > PLANNED_MM
