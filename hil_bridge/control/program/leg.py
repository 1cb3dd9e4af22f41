"""One step of a program in one pass, with the stroke that carries it out; and all of them in one row."""

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from hil_bridge.control.course.intent import Phase
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.stroke import Stroke
from hil_bridge.control.geometry.ways import Place, Way

if TYPE_CHECKING:
    from hil_bridge.control.steps.seam import Step


@dataclass(frozen=True, slots=True)
class Leg:
    """One step, in one pass."""

    number: str
    """As a person counts: "3", or "3.1" within a repeat."""
    step: "Step"
    """Its settings, and what it does."""
    stroke: Stroke
    """The stroke with the step's own parameters."""
    limits: Limits
    """Limits of the run, tightened by the step."""
    profile: tuple[tuple[float, float], ...]
    """Way in m and wanted force in N."""
    way: Way | None = None
    """Path along the surface, relative to where it begins; None for a step without one."""
    leave_to: int | None = None
    """Number of the leg behind the repeat, at the last leg of a pass; None elsewhere."""
    removed: float | None = None
    """Depth removed, m, at which the repeat is left there; None where all passes are made."""
    first_of_repeat: bool = False
    """The first leg of the first pass: the depths are counted from here."""
    repeat: int = 0
    """Number of the repeat that it belongs to, as a person counts; 0 for none."""
    turn: int = 0
    """Its pass in that repeat, from 1; 0 for none."""
    follows: bool = False
    """The force is controlled along the estimated normal."""
    shows_ground: bool = False
    """The controller is shown depths from the plane that the estimated normal predicts."""
    phase: Phase = Phase.TRACK
    """Phase in which the step begins."""
    works_aside: bool = False
    """The tool may meet what is beside its way, in this step or in one before of the same touch."""
    turns: bool = True
    """The tool may be turned in it."""
    foreign: bool = False
    """The step is one of another package: its answers are checked, and its retractions watched as any order."""

    @property
    def label(self) -> str:
        """Its number and its word: "3 (track)"."""
        return label_of(self.number, self.step, self.turn)

    def reference(self, travel: float) -> float:
        """Wanted force at this length of the way, m; N."""
        profile = self.profile
        if len(profile) == 1 or travel <= profile[0][0]:
            return profile[0][1]
        for (begin, low), (end, high) in pairwise(profile):
            if travel < end:
                return low + (high - low) * (travel - begin) / (end - begin)
        return profile[-1][1]

    @property
    def presses(self) -> bool:
        """Whether the tool is in contact at its end."""
        return self.step.presses


@dataclass(frozen=True, slots=True)
class Row:
    """The legs of a program, and where they lead."""

    legs: tuple[Leg, ...]
    places: tuple[Place | None, ...]
    """Where each leg begins in the work frame, mm; None where that is known in the run alone."""
    written: bool = True
    """A person has written the steps: each is told by its number when it ends, or when the run stops in it."""


class StepFailed(Exception):
    """A step raised the error that is this one's cause."""

    def __init__(self, leg: Leg) -> None:
        super().__init__(leg.label)
        self.leg = leg


def label_of(number: str, step: "Step", turn: int) -> str:
    """A step's number and word."""
    return f"{number} ({step.do}{(turn and f', pass {turn}') or ''})"
