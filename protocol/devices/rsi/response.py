"""Monitor of a robot's response to its answers: whether it accepts them, follows its correction, or runs away from
it.
"""

import math
from collections import deque

from protocol.devices.rsi.axis_channel import AxisChannel
from protocol.devices.rsi.corrections import NO_CORRECTION, Correction
from protocol.devices.rsi.profile import RsiLink
from protocol.devices.rsi.robot_telegram import NO_POSE, RobotTelegram
from protocol.endpoint import NO_TROUBLE, Trouble

FOLLOWS_WITHIN_S = 0.25
"""Time limit for a robot to follow its correction, s. Chosen: longer than any lag of its servo."""
RUNS_AWAY_CYCLES = 25
"""Number of consecutive cycles of motion away from a constant correction after which a robot counts as running
away. Chosen: longer than any lag of its servo.
"""
RUNS_AWAY_MM = 0.01
"""Minimum motion away from a constant correction in one cycle, mm. Chosen: the last digits of a constant position
change by less.
"""
RUNNING = 3.0
"""Status of a running program, if the robot sends a status. Observed (FZI's configuration)."""


class Response:
    """Monitor of one robot that evaluates its telegrams in order."""

    def __init__(self, link: RsiLink) -> None:
        self._link = link
        self._trail: deque[Correction] = deque(
            [NO_CORRECTION], maxlen=math.ceil(FOLLOWS_WITHIN_S * 1e3 / link.cycle_ms)
        )
        """Newest corrections, one per cycle."""
        self.offset: Correction | None = None
        """Correction in the newest telegram; None if it cannot be determined."""
        self.missed = 0
        """Number of consecutive answers that the robot has not accepted."""
        self.strayed = False
        """Whether the robot failed to follow its correction in this movement."""
        self.halted = False
        """Whether the robot reported a fault in this movement. The rest of the movement is then abandoned."""
        self._leaving, self._apart_mm = 0, 0.0
        """Number of consecutive cycles in which the robot moved away from a constant correction, and the robot's
        distance from that correction, mm.
        """
        self.has_run_away = False
        """Whether the robot ran away. It would move forever, because it adds each correction to the previous one,
        so it gets no more answers.
        """

    def begin_session(self, restarted: bool) -> None:
        """Begin a session after the robot's program restarted or was silent."""
        self.missed = self._leaving = 0
        self.has_run_away = self.has_run_away and not restarted

    def begin_movement(self) -> None:
        """Begin a movement and clear the faults of the previous one."""
        self.strayed = self.halted = False

    def reset(self, correction: Correction) -> None:
        """Set the current correction of the robot."""
        self._trail.clear()
        self._trail.append(correction)

    def observe(self, offset: Correction | None, total: Correction, moves: bool) -> str:
        """Compare the robot's `offset` with its correction `total`. `moves` says whether a movement is in progress.
        Return the text of a new fault, or an empty string.
        """
        is_constant = self._trail[-1] == total
        self._trail.append(total)
        self.offset = offset
        if offset is None:
            return ""
        if self._link.mode == "absolute":
            self._observe_flight(math.dist(offset[:3], total[:3]), is_constant)
        if not moves or self.missed or self.strayed:
            return ""
        position, most = offset[:3], self._link.stray_mm
        for correction in reversed(self._trail):
            if math.dist(position, correction[:3]) <= most:
                return ""  # almost always one of the newest
        stray = min(math.dist(position, correction[:3]) for correction in self._trail)
        if not stray > most:
            return ""
        self.strayed = True
        return (
            f"the robot is {stray:.1f} mm away from its correction: it does not move, or POSCORR or AXISCORR limits "
            "it, or HOLDON or the mode of RSI_ON are not as set"
        )

    def _observe_flight(self, apart_mm: float, is_constant: bool) -> None:
        """Detect a robot in relative mode. It accumulates corrections, so it moves although its correction is
        constant.
        """
        leaves = is_constant and apart_mm > self._apart_mm + RUNS_AWAY_MM
        self._apart_mm = apart_mm
        self._leaving = self._leaving + 1 if leaves else 0
        if self._leaving >= RUNS_AWAY_CYCLES and apart_mm > self._link.stray_mm:
            self.has_run_away = True

    def find_trouble(self, telegram: RobotTelegram, axes: AxisChannel | None) -> Trouble:
        """Return the reason why the robot does not follow its corrections, from this telegram and the previous ones."""
        if telegram.status is not None and telegram.status != RUNNING:
            return Trouble(
                f"its program does not run (ProgStatus {telegram.status:g})",
                "release its stops and start it again",
            )
        if self.has_run_away:
            return Trouble(
                "it runs away from a constant correction, and gets no more answers",
                "set robot.rsi.mode to the mode that its program passes to RSI_ON, then start it again",
            )
        if telegram.missing:
            return Trouble(
                f"its telegrams have no {telegram.missing}, which a correction of the axes needs",
                f"add DEF_{telegram.missing} to the controller's Ethernet configuration",
            )
        if axes is not None and telegram.pose is not NO_POSE:
            if telegram.axes is None or telegram.planned_axes is None:
                return Trouble("its axes are not numeric", "check its Ethernet configuration")
            apart_mm = axes.flange_deviation_mm(telegram.pose, telegram.axes)
            if not apart_mm <= self._link.stray_mm:
                return Trouble(
                    f"its axes are {apart_mm:.1f} mm away from its pose, by the dimensions of a {self._link.model}",
                    "set robot.rsi.model to the arm, and let the program set $BASE to $ROBROOT",
                )
        if self.missed >= self._link.late_max:
            return Trouble(
                f"it has not accepted {self.missed} answers in a row (late so far: {telegram.late})",
                "check the network, this computer's load, and SENTYPE",
            )
        return NO_TROUBLE
