"""Step `hold`."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import ClassVar, Literal

from msgspec.structs import replace

from hil_bridge.control.checks import FORBID_EXTRA
from hil_bridge.control.course.parameters import TaskParameters
from hil_bridge.control.course.state import StepState
from hil_bridge.control.course.stroke import Stride
from hil_bridge.control.steps.plan import StepPlan
from hil_bridge.control.steps.pressing import Guide, PressingStep
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
from protocol.marks import SettingError


@dataclass(frozen=True, slots=True)
class Hold(PressingStep[None]):
    """Press at one position for a time."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    for_s: float = field()
    do: Literal["hold"] = "hold"
    name: str = ""
    """Name under which the mean position of the second half of the time is reported; empty for none."""
    force_n: float | None = None
    sine_n: float = 0.0
    """Amplitude by which the target force oscillates about `force_n`; 0 for a constant force."""
    sine_hz: float = 0.0
    """Frequency of this oscillation."""
    orientation: Orientation = "fixed"
    criterion: Criterion | None = None
    limits: StepLimits = NO_LIMITS

    def __post_init__(self) -> None:
        above_zero(self, "for_s", "force_n")
        for name, other in (("sine_n", "sine_hz"), ("sine_hz", "sine_n")):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise SettingError(name, f"must be a number of at least 0, got {value:g}")
            if value == 0 < getattr(self, other):
                raise SettingError(name, f"must be above 0 if {other} is set")

    def parameters(self, task: TaskParameters) -> dict[str, float]:
        return {"speed_mm_s": 0.0}

    def seconds(self, plan: StepPlan, begin: object) -> float:
        return self.for_s

    def guide(self, context: StepContext, state: StepState[None]) -> Guide[None]:
        force, began = context.plan.reference(0.0), context.course.began
        if self.sine_n and began is not None:
            force += self.sine_n * math.sin(math.tau * self.sine_hz * (context.contact.sample.now - began))
        return Guide(state, Stride(force))

    def end_sample(
        self, context: StepContext, before: StepState[None], result: StepResult[None]
    ) -> StepResult[None]:
        began, sample, state = context.course.began, context.contact.sample, result.state
        if began is None or sample.now - began < self.for_s / 2:
            return result
        (x, y, z), count = state.found
        u, v, w = sample.position
        return replace(result, state=replace(state, found=((x + u, y + v, z + w), count + 1)))

    def describe(self, parameters: TaskParameters) -> Iterator[str]:
        if self.sine_n:
            yield f"±{self.sine_n:g} N at {self.sine_hz:g} Hz"

    @property
    def drawing(self) -> Drawing:
        return Drawing("#009E73", "", "hold")

    @property
    def band(self) -> str:
        return "#d3e9c9"
