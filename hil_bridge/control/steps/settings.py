"""Settings of the task of a run: its parameters, and the steps of its program."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, TypeAlias

from pydantic import Discriminator, SerializeAsAny, WrapValidator

from hil_bridge.control.checks import FORBID_EXTRA
from hil_bridge.control.course.parameters import TaskParameters
from hil_bridge.control.geometry.ways import Place
from hil_bridge.control.steps.approach import Approach
from hil_bridge.control.steps.hold import Hold
from hil_bridge.control.steps.kinds import read_step
from hil_bridge.control.steps.move import Move
from hil_bridge.control.steps.paths import Line
from hil_bridge.control.steps.repeat import Repeat
from hil_bridge.control.steps.retract import Retract
from hil_bridge.control.steps.seam import Step
from hil_bridge.control.steps.seek import Seek
from hil_bridge.control.steps.track import Track
from hil_bridge.control.steps.zero import Zero
from protocol.geometry import Quaternion, Vector

ProgramStep: TypeAlias = SerializeAsAny[
    Annotated[
        Annotated[Approach | Track | Hold | Seek | Retract | Move | Zero | Repeat, Discriminator("do")],
        WrapValidator(read_step),
    ]
]
"""Step of a program, by its word."""


@dataclass(frozen=True, slots=True)
class ResumePoint:
    """Point at which a program continues. `run --resume` fills it in."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    leg: int
    """Step of the program, with all passes counted, from 0."""
    way_mm: float
    """Length along its path from which it continues; 0 for a step without a path."""
    place_mm: Place
    """That point in the work frame."""
    start_m: Vector
    """Start point of the first run, base frame; the safe height, and paths without an origin, are relative to it."""
    quaternion: Quaternion
    """Orientation of that start."""
    spent_s: float = 0.0
    """Time that the step has already used."""


@dataclass(frozen=True, slots=True)
class TaskSettings(TaskParameters):
    """Settings of the task. All values are chosen for the paper's experiments and the robot's resolution."""

    __pydantic_config__: ClassVar = {"extra": "forbid"}

    step: tuple[ProgramStep, ...] = ()
    """Program, with a table [[task.step]] for each step; empty for one approach, one straight path and one retraction.
    """
    resume: ResumePoint | None = None
    """Point at which an interrupted program continues; `run --resume` fills it in."""
    file: str = ""
    """File with the steps of a program, relative to the configuration; empty for steps defined here, or for none."""

    def program(self, duration_s: float) -> tuple[Step, ...]:
        """Return the steps of the run.

        Without a program, these are an approach, a straight path for the given time, s, and a retraction.
        """
        return self.step or plain_steps(self, duration_s)


def plain_steps(task: TaskParameters, duration_s: float) -> tuple[Step, ...]:
    """Return the program of a run without steps: approach, straight track, retract."""
    path = Line(length_mm=task.travel_limit_mm)
    return Approach(), Track(path, for_s=duration_s, across_mm=task.travel_limit_mm), Retract()
