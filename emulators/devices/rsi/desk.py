"""The operator's side of an emulated KUKA controller: emergency stop, key, drives, program, override, messages.

Turning the key switches the drives off and stops the program, as an emergency stop does. One that is released only
permits the drives to be switched on again (ISO 13850: a reset starts nothing). Then a user starts the program, which
continues where it was. Telegrams continue meanwhile.

Source: project specification of RSI, sections 5 and 6: the message that is confirmed in T1 and T2, telegrams while the
motion is stopped (assumed). 250 mm/s in T1: ISO 10218-1. Assumed: the key as above; the override acts on programmed
motions alone, so a correction does not know it.
"""

import math
from dataclasses import dataclass
from enum import StrEnum

T1_M_S = 0.25
"""Fastest tool in T1. Standard: ISO 10218-1."""

TO_CONFIRM = "an operator has not confirmed the sensor correction"
"""Chosen: words of its own for a correction that waits for the message of T1 and T2."""


class Key(StrEnum):
    """Operating modes."""

    T1 = "t1"
    """Test at reduced speed."""
    T2 = "t2"
    """Test at full speed."""
    AUT = "aut"
    EXT = "ext"
    """Automatic, started by a host."""


class RefusedAct(ValueError):
    """The controller refuses an act in its present state; the words say why."""


@dataclass(slots=True)
class Desk:
    """State of the panel, and what an operator does there."""

    emergency_stop: bool = False
    """The button is pressed."""
    drives: bool = True
    """The drives are on."""
    started: bool = True
    """The program was started, and not stopped since."""
    key: Key = Key.AUT
    override_percent: int = 100
    """$OV_PRO."""
    to_confirm: bool = False
    """A message waits: a sensor correction goes active."""

    @property
    def hindrance(self) -> str:
        """Why the program does not move the robot, in words; empty where it may."""
        if self.emergency_stop:
            return "emergency stop"
        if not self.drives:
            return "the drives are off"
        return "" if self.started else "the program is stopped"

    @property
    def is_test(self) -> bool:
        """Whether an operator operates it step by step, in T1 or T2."""
        return self.key in (Key.T1, Key.T2)

    def tool_step_m(self, period: float) -> float:
        """Farthest that the operating mode lets the tool go in a cycle of `period`, s."""
        return T1_M_S * period if self.key is Key.T1 else math.inf

    def press_emergency_stop(self) -> None:
        """Stop at once."""
        self.emergency_stop = True
        self.switch_drives_off()

    def turn_key(self, key: Key) -> None:
        """Choose the operating mode. Harmless for the present one."""
        if key is not self.key:
            self.key = key
            self.switch_drives_off()

    def switch_drives_off(self) -> None:
        """Switch the drives off; the program stops with them."""
        self.drives = self.started = False

    def switch_drives_on(self) -> None:
        """Switch the drives on; the program stays stopped. Raises RefusedAct."""
        if self.emergency_stop:
            raise RefusedAct("an emergency stop is pressed")
        self.drives = True

    def start(self) -> None:
        """Start the program where it was stopped. Raises RefusedAct."""
        if not self.drives:
            raise RefusedAct(self.hindrance)
        self.started = True

    def confirm(self) -> None:
        """Confirm the message. Raises RefusedAct where none waits."""
        if not self.to_confirm:
            raise RefusedAct("no message waits")
        self.to_confirm = False
