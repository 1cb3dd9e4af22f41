"""The step `hold`."""

from dataclasses import dataclass, field
from typing import ClassVar, Literal

from msgspec.structs import replace

from hil_bridge.control.checks import FORBID_EXTRA
from hil_bridge.control.course.parameters import TaskParameters
from hil_bridge.control.program.leg import Leg
from hil_bridge.control.program.outcome import added
from hil_bridge.control.program.state import Felt, ProgramState
from hil_bridge.control.steps.pressing import PressingStep
from hil_bridge.control.steps.seam import (
    NO_LIMITS,
    Criterion,
    Drawing,
    Orientation,
    StepLimits,
    Taken,
    above_zero,
)


@dataclass(frozen=True, slots=True)
class Hold(PressingStep):
    """Press at the place for a time."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    for_s: float = field()
    do: Literal["hold"] = "hold"
    name: str = ""
    """Name under which the mean place of the second half of the time is told; empty for none."""
    force_n: float | None = None
    orientation: Orientation = "fixed"
    criterion: Criterion | None = None
    limits: StepLimits = NO_LIMITS

    def __post_init__(self) -> None:
        above_zero(self, "for_s", "force_n")

    def parameters(self, task: TaskParameters) -> dict[str, float]:
        return {"speed_mm_s": 0.0}

    def seconds(self, leg: Leg, begin: object) -> float:
        return self.for_s

    def end_sample(self, leg: Leg, before: ProgramState, taken: Taken, felt: Felt) -> Taken:
        state, began = taken.state, before.began
        if began is None or felt.sample.now - began < self.for_s / 2:
            return taken
        return replace(taken, state=replace(state, found=added(state.found, felt.sample.position)))

    @property
    def drawing(self) -> Drawing:
        return Drawing("#009E73", "", "hold")

    @property
    def band(self) -> str:
        return "#d3e9c9"
