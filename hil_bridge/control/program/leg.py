"""One step of a program in one pass, and the row of all of them."""

from dataclasses import dataclass

from hil_bridge.control.geometry.ways import Place
from hil_bridge.control.steps.plan import StepPlan
from hil_bridge.control.steps.repeat import ALONE, Pass
from hil_bridge.control.steps.seam import Step


@dataclass(frozen=True, slots=True, kw_only=True)
class Leg(StepPlan):
    """One step, in one pass."""

    step: Step
    """Its settings, and what it does."""
    repeat: Pass = ALONE
    """Its place in the passes of a repeat."""
    foreign: bool = False
    """The step comes from a plug-in: its answers are checked, and its retractions supervised as any order."""

    @property
    def label(self) -> str:
        """Its number and its word: "3 (track)"."""
        return label_of(self.number, self.step, self.repeat.turn)

    @property
    def presses(self) -> bool:
        """Whether the tool is in contact at its end."""
        return self.step.presses


@dataclass(frozen=True, slots=True)
class Row:
    """The legs of a program, and where they lead."""

    legs: tuple[Leg, ...]
    places: tuple[Place | None, ...]
    """Where each leg begins in the work frame, mm; None where only the run determines that."""
    written: bool = True
    """An operator has written the steps: messages name each by its number."""


class StepFailed(Exception):
    """A step raised the error that is this one's cause."""

    def __init__(self, leg: Leg) -> None:
        super().__init__(leg.label)
        self.leg = leg


def label_of(number: str, step: Step, turn: int) -> str:
    """Return a step's number and word."""
    return f"{number} ({step.do}{(turn and f', pass {turn}') or ''})"
