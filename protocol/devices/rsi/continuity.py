"""Classification of telegrams: whether one continues the session, by its clock, its count of late answers, and its
set pose.
"""

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
"""Largest jump of the clock within a program, in either direction, ms. Chosen. A larger jump means that the program
was restarted.
"""
PLANNED_MM = 0.1
"""Largest change of the set position between two telegrams of one session, mm. Chosen. A larger change means that
the program was restarted, or moves by itself.
"""
PLANNED_DEG = 0.02
"""Largest change of a set axis between two telegrams of one session, degrees, if the axes are corrected. Chosen. A
larger change means that the program was restarted, or moves by itself.
"""


class Arrival(Enum):
    """Relation of a telegram to the previous ones."""

    NEXT = auto()
    RENUMBERED = auto()
    """The next telegram, but its clock has jumped."""
    RESTARTED = auto()
    """The first telegram of a program that was restarted or moves by itself."""
    RESUMED = auto()
    """The first telegram of all, or the first after a silence."""
    OLD = auto()
    """The telegram was delayed or repeated."""
    STRAY = auto()
    """The first in a series of telegrams with an unrelated clock."""
    STRAY_AGAIN = auto()


class Place(NamedTuple):
    """Classification and position of a telegram in the stream."""

    arrival: Arrival
    sequence: int
    """Sequence number in the stream, in cycles."""
    cycles: int
    """Number of cycles since the previous telegram."""


class Continuity:
    """Tracker of the newest telegram of a robot. It classifies the next telegram."""

    def __init__(self, link: RsiLink) -> None:
        self._link = link
        self.newest: int | None = None
        """Clock (IPOC) of the newest telegram, ms."""
        self.late: int | None = None
        """Count of late answers in the newest telegram."""
        self._strays = NewNumbers(link.cycle_ms * 1e-3, link.cycle_ms)
        """Telegrams with clocks that do not continue the session. They are not answered."""
        self._sequence = 0
        self._received_at = -math.inf
        self._planned: Pose | None = None
        """Set position in the newest telegram that contains one."""
        self._planned_axes: Joints | None = None
        """Set axes in the newest telegram that contains them."""

    def place(self, telegram: RobotTelegram, at: float, total: Correction) -> Place:
        """Classify a telegram that arrived at time `at`, s. `total` is the current correction of the robot.

        The telegram becomes the newest unless it is old or stray.
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
        """Classify a telegram and count the cycles since the newest one."""
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
        """Return whether the robot is at its corrected position, which means that only the clock has changed."""
        offset = telegram.offset
        return offset is not None and math.dist(offset[:3], total[:3]) <= self._link.stray_mm

    def _is_restarted(self, telegram: RobotTelegram) -> bool:
        """Return whether the count of late answers has restarted, or the set position has changed."""
        if telegram.late is not None and self.late is not None and telegram.late < self.late:
            return True
        if telegram.planned_axes is not None and self._planned_axes is not None:
            turns = zip(telegram.planned_axes, self._planned_axes, strict=True)
            if any(abs(to - was) > PLANNED_DEG for to, was in turns):
                return True
        if telegram.planned is None or self._planned is None:
            return False
        return math.dist(telegram.planned.position, self._planned.position) * 1e3 > PLANNED_MM
