"""How a robot responds to its answers: whether it takes them, comes along with its correction, or runs away from it."""

import math
from collections import deque

from protocol.devices.rsi.axis_channel import AxisChannel
from protocol.devices.rsi.corrections import NO_CORRECTION, Correction
from protocol.devices.rsi.profile import RsiLink
from protocol.devices.rsi.robot_telegram import NO_POSE, RobotTelegram
from protocol.endpoint import NO_TROUBLE, Trouble

FOLLOWS_WITHIN_S = 0.25
"""Chosen: a robot is where its correction was within so long; more than any lag of its servo."""
RUNS_AWAY_CYCLES = 25
"""Chosen: cycles in a row in which a robot leaves a correction that stands; more than any lag of its servo."""
RUNS_AWAY_MM = 0.01
"""Chosen: way of such a cycle; the last digits of a position that stands change by less."""
RUNNING = 3.0
"""Observed (FZI's configuration): status of a program that runs, where it is sent."""


class Response:
    """Observes one robot, telegram by telegram."""

    def __init__(self, link: RsiLink) -> None:
        self._link = link
        self._trail: deque[Correction] = deque(
            [NO_CORRECTION], maxlen=math.ceil(FOLLOWS_WITHIN_S * 1e3 / link.cycle_ms)
        )
        """The newest corrections, cycle by cycle."""
        self.offset: Correction | None = None
        """Correction that the newest telegram shows; None where it shows none."""
        self.missed = 0
        """Consecutive answers that the robot has not accepted."""
        self.strayed = False
        """The robot has not come along with its correction in this movement."""
        self.halted = False
        """It has reported a fault in this movement: what it lacks of its way is given up."""
        self._leaving, self._apart_mm = 0, 0.0
        """Cycles in a row in which the robot left its correction, which stood; distance from it."""
        self.ran_away = False
        """It repeats for ever, as each whole correction is added to the one before: it gets no more answers."""

    def begin_session(self, restarted: bool) -> None:
        """Begin a session after the robot's program restarted or was silent."""
        self.missed = self._leaving = 0
        self.ran_away = self.ran_away and not restarted

    def begin_movement(self) -> None:
        """Begin a movement without the faults of the previous one."""
        self.strayed = self.halted = False

    def reset(self, correction: Correction) -> None:
        """Set the robot's present correction."""
        self._trail.clear()
        self._trail.append(correction)

    def observe(self, offset: Correction | None, total: Correction, moves: bool) -> str:
        """Observe the offset of a robot that has a correction, in a movement or not. What went wrong, or an empty
        string.
        """
        stands = self._trail[-1] == total
        self._trail.append(total)
        self.offset = offset
        if offset is None:
            return ""
        if self._link.mode == "absolute":
            self._observe_flight(math.dist(offset[:3], total[:3]), stands)
        if not moves or self.missed or self.strayed:
            return ""
        place, most = offset[:3], self._link.stray_mm
        for correction in reversed(self._trail):
            if math.dist(place, correction[:3]) <= most:
                return ""  # nearly always one of the newest
        stray = min(math.dist(place, correction[:3]) for correction in self._trail)
        if not stray > most:
            return ""
        self.strayed = True
        return (
            f"the robot is {stray:.1f} mm beside its correction: it stands, or POSCORR or AXISCORR limits it, or "
            "HOLDON or the mode of RSI_ON are not as set"
        )

    def _observe_flight(self, apart_mm: float, stands: bool) -> None:
        """Detect relative mode, in which the robot adds corrections up: it moves under a constant one."""
        leaves = stands and apart_mm > self._apart_mm + RUNS_AWAY_MM
        self._apart_mm = apart_mm
        self._leaving = self._leaving + 1 if leaves else 0
        if self._leaving >= RUNS_AWAY_CYCLES and apart_mm > self._link.stray_mm:
            self.ran_away = True

    def find_trouble(self, telegram: RobotTelegram, axes: AxisChannel | None) -> Trouble:
        """Return what keeps the robot from its corrections, judged by this telegram and earlier ones."""
        if telegram.status is not None and telegram.status != RUNNING:
            return Trouble(
                f"its program does not run (ProgStatus {telegram.status:g})",
                "release its stops and start it again",
            )
        if self.ran_away:
            return Trouble(
                "it runs away from a correction that stands, and gets no more answers",
                "give robot.rsi.mode what its program gives to RSI_ON, then start it again",
            )
        if telegram.missing:
            return Trouble(
                f"its telegrams have no {telegram.missing}, which a correction of the axes needs",
                f"enter DEF_{telegram.missing} into the controller's Ethernet configuration",
            )
        if axes is not None and telegram.pose is not NO_POSE:
            if telegram.axes is None or telegram.planned_axes is None:
                return Trouble("its axes are told as no numbers", "look at its Ethernet configuration")
            beside_mm = axes.beside_mm(telegram.pose, telegram.axes)
            if not beside_mm <= self._link.stray_mm:
                return Trouble(
                    f"its axes stand {beside_mm:.1f} mm beside its pose, by the sizes of a {self._link.model}",
                    "give robot.rsi.model the arm, and let the program set $BASE to $ROBROOT",
                )
        if self.missed >= self._link.late_max:
            return Trouble(
                f"it has not taken {self.missed} answers in a row (late so far: {telegram.late})",
                "look at the network, at this computer's load, and at SENTYPE",
            )
        return NO_TROUBLE
