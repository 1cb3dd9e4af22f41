"""Step `hold`."""

from dataclasses import dataclass, field
from typing import ClassVar, Literal

from msgspec.structs import replace

from hil_bridge.control.checks import FORBID_EXTRA
from hil_bridge.control.course.parameters import TaskParameters
from hil_bridge.control.course.state import StepState
from hil_bridge.control.steps.plan import StepPlan
from hil_bridge.control.steps.pressing import PressingStep
from hil_bridge.control.steps.seam import (
    NO_LIMITS,
    Criterion,
    Drawing,
    Orientation,
    StepContext,
    StepLimits,
    StepResult,
    above_zero,
)


@dataclass(frozen=True, slots=True)
class Hold(PressingStep[None]):
    """Press at one position for a time."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    for_s: float = field()
    do: Literal["hold"] = "hold"
    name: str = ""
    """Name under which the mean position of the second half of the time is reported; empty for none."""
    force_n: float | None = None
    orientation: Orientation = "fixed"
    criterion: Criterion | None = None
    limits: StepLimits = NO_LIMITS

    def __post_init__(self) -> None:
        above_zero(self, "for_s", "force_n")

    def parameters(self, task: TaskParameters) -> dict[str, float]:
        return {"speed_mm_s": 0.0}

    def seconds(self, plan: StepPlan, begin: object) -> float:
        return self.for_s

    def end_sample(
        self, context: StepContext, before: StepState[None], result: StepResult[None]
    ) -> StepResult[None]:
        began, sample, state = context.course.began, context.contact.sample, result.state
        if began is None or sample.now - began < self.for_s / 2:
            return result
        (x, y, z), count = state.found
        u, v, w = sample.position
        return replace(result, state=replace(state, found=((x + u, y + v, z + w), count + 1)))

    @property
    def drawing(self) -> Drawing:
        return Drawing("#009E73", "", "hold")

    @property
    def band(self) -> str:
        return "#d3e9c9"
