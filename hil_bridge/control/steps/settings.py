"""Settings of the task of a run: its numbers, and the steps of its program."""

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
"""A step of a program, by its word."""


@dataclass(frozen=True, slots=True)
class ResumePoint:
    """Where a program continues. `run --resume` fills it in."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    leg: int
    """Step of the program, passes counted, from 0."""
    way_mm: float
    """Way along its path from which it continues; 0 for a step without a path."""
    place_mm: Place
    """That place in the work frame."""
    start_m: Vector
    """Start point of the first run, base frame: the safe height, and paths without an origin, count from there."""
    quaternion: Quaternion
    """Orientation of that start."""
    spent_s: float = 0.0
    """Time that the step has had already."""


@dataclass(frozen=True, slots=True)
class TaskSettings(TaskParameters):
    """Settings of the task. All values are chosen for the paper's experiments and the robot's resolution."""

    __pydantic_config__: ClassVar = {"extra": "forbid"}

    step: tuple[ProgramStep, ...] = ()
    """A program, a table [[task.step]] for each step; empty for one approach, one straight way and one retraction."""
    resume: ResumePoint | None = None
    """Where a program continues that was cut before; `run --resume` fills it in."""
    file: str = ""
    """File with the steps of a program, beside the configuration; empty for steps that stand here, or for none."""

    def program(self, duration_s: float) -> tuple[Step, ...]:
        """Return the steps of the run.

        Without a program of its own: an approach, a straight path for this time, s, and a retraction.
        """
        return self.step or plain_steps(self, duration_s)


def plain_steps(task: TaskParameters, duration_s: float) -> tuple[Step, ...]:
    """Return the program of a run without steps: approach, track straight on, retract."""
    way = Line(length_mm=task.travel_limit_mm)
    return Approach(), Track(way, for_s=duration_s, across_mm=task.travel_limit_mm), Retract()
