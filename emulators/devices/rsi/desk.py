"""Operator's side of an emulated KUKA controller: emergency stop, key, drives, program, override, messages.

Turning the key switches the drives off and stops the program; an emergency stop does the same. Releasing an
emergency stop only permits the drives to be switched on again (ISO 13850: a reset starts nothing). An operator then
starts the program, which continues where it was stopped. Telegrams continue during the stop.

Source: project specification of RSI, sections 5 and 6: the message that is confirmed in T1 and T2, telegrams while
the motion is stopped (assumed). 250 mm/s in T1: ISO 10218-1. Assumed: the effect of the key; the override acts on
programmed motions only, so it does not affect a correction.
"""

import math
from dataclasses import dataclass
from enum import StrEnum

T1_M_S = 0.25
"""Tool speed limit in T1, m/s. Standard: ISO 10218-1."""

TO_CONFIRM = "an operator has not confirmed the sensor correction"
"""Text for a correction that waits until the message of T1 and T2 is confirmed. Chosen: not the controller's own
text.
"""


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
    """Action that the controller refuses in its current state. The text gives the reason."""


@dataclass(slots=True)
class Desk:
    """State of the panel, and the actions of an operator there."""

    emergency_stop: bool = False
    """Whether the emergency-stop button is pressed."""
    drives: bool = True
    """Whether the drives are on."""
    started: bool = True
    """Whether the program was started and has not been stopped since."""
    key: Key = Key.AUT
    override_percent: int = 100
    """Override, %: $OV_PRO."""
    to_confirm: bool = False
    """Whether the message that a sensor correction becomes active waits for confirmation."""

    @property
    def hindrance(self) -> str:
        """Reason why the program does not move the robot; empty if it can."""
        if self.emergency_stop:
            return "emergency stop"
        if not self.drives:
            return "the drives are off"
        return "" if self.started else "the program is stopped"

    @property
    def is_test(self) -> bool:
        """Whether the operating mode is T1 or T2, in which an operator tests the program."""
        return self.key in (Key.T1, Key.T2)

    def tool_step_m(self, period: float) -> float:
        """Return the maximum distance that the tool may move in one cycle in this operating mode, m. `period` is in
        s.
        """
        return T1_M_S * period if self.key is Key.T1 else math.inf

    def press_emergency_stop(self) -> None:
        """Stop at once."""
        self.emergency_stop = True
        self.switch_drives_off()

    def turn_key(self, key: Key) -> None:
        """Select the operating mode. No effect if it is already selected."""
        if key is not self.key:
            self.key = key
            self.switch_drives_off()

    def switch_drives_off(self) -> None:
        """Switch the drives off. This stops the program."""
        self.drives = self.started = False

    def switch_drives_on(self) -> None:
        """Switch the drives on. The program remains stopped. Raises RefusedAct."""
        if self.emergency_stop:
            raise RefusedAct("an emergency stop is pressed")
        self.drives = True

    def start(self) -> None:
        """Start the program where it was stopped. Raises RefusedAct."""
        if not self.drives:
            raise RefusedAct(self.hindrance)
        self.started = True

    def confirm(self) -> None:
        """Confirm the message. Raises RefusedAct if there is none."""
        if not self.to_confirm:
            raise RefusedAct("there is no message to confirm")
        self.to_confirm = False
