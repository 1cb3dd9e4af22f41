"""Leg of a program, which is one step in one pass, and the sequence of all legs."""

from dataclasses import dataclass

from hil_bridge.control.geometry.ways import Place
from hil_bridge.control.steps.plan import StepPlan
from hil_bridge.control.steps.repeat import ALONE, Pass
from hil_bridge.control.steps.seam import Step


@dataclass(frozen=True, slots=True, kw_only=True)
class Leg(StepPlan):
    """One step in one pass."""

    step: Step
    """Settings and behaviour of the step."""
    repeat: Pass = ALONE
    """Position of the step in the passes of a repeat."""
    foreign: bool = False
    """Whether the step comes from a plug-in. If so, its responses are checked, and its retractions are supervised
    like any order.
    """

    @property
    def label(self) -> str:
        """Number and word of the step, for example "3 (track)"."""
        return label_of(self.number, self.step, self.repeat.turn)

    @property
    def presses(self) -> bool:
        """Whether the tool is in contact at the end of the leg."""
        return self.step.presses


@dataclass(frozen=True, slots=True)
class Row:
    """Legs of a program in order, and their start points."""

    legs: tuple[Leg, ...]
    places: tuple[Place | None, ...]
    """Start point of each leg in the work frame, mm; None if it is known only during the run."""
    written: bool = True
    """Whether an operator has written the steps. If so, messages identify each step by its number."""


class StepFailed(Exception):
    """Failure of a step. The exception of the step is its cause."""

    def __init__(self, leg: Leg) -> None:
        super().__init__(leg.label)
        self.leg = leg


def label_of(number: str, step: Step, turn: int) -> str:
    """Return the number and word of a step."""
    return f"{number} ({step.do}{(turn and f', pass {turn}') or ''})"
