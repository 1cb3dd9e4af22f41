"""Step `approach`."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

from hil_bridge.control.checks import FORBID_EXTRA
from hil_bridge.control.course.intent import Phase
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.parameters import TaskParameters, check_approach_speed
from hil_bridge.control.course.state import StepState
from hil_bridge.control.steps.plan import StepPlan
from hil_bridge.control.steps.seam import (
    NO_LIMITS,
    Plan,
    Step,
    StepContext,
    StepLimits,
    StepResult,
    above_zero,
    need_free,
)
from hil_bridge.control.steps.strokes import take_stroke


@dataclass(frozen=True, slots=True)
class Approach(Step[None]):
    """Move into the surface until the force indicates contact."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    do: Literal["approach"] = "approach"
    name: str = ""
    """Name under which the position of the contact is reported; empty for none."""
    speed_mm_s: float | None = None
    contact_n: float | None = None
    at_most_mm: float | None = None
    limits: StepLimits = NO_LIMITS

    def __post_init__(self) -> None:
        above_zero(self, "speed_mm_s", "contact_n", "at_most_mm")
        if self.speed_mm_s is not None:
            check_approach_speed("speed_mm_s", self.speed_mm_s)

    @property
    def phase(self) -> Phase:
        return Phase.APPROACH

    def check(self, pressing: bool, limits: Limits) -> None:
        need_free(pressing)
        if self.speed_mm_s is not None and self.speed_mm_s > limits.correction_mm_s:
            raise ValueError(f"speed_mm_s of {self.speed_mm_s:g} is above limits.correction_mm_s")

    def parameters(self, task: TaskParameters) -> Mapping[str, Any]:
        return {
            "approach_speed_mm_s": self.speed_mm_s,
            "contact_threshold_n": self.contact_n,
            "approach_depth_limit_mm": self.at_most_mm,
        }

    def seconds(self, plan: StepPlan, begin: object) -> float:
        task = plan.stroke.parameters
        return task.approach_depth_limit_mm / task.approach_speed_mm_s / 4

    def reach(self, plan: Plan, back_mm: float) -> Plan:
        """Return the plan with its reach increased by the distance that the tool has retracted, unless the step
        sets its own limit.
        """
        if self.at_most_mm is not None or not back_mm:
            return plan
        parameters = plan.stroke.parameters
        deeper = replace(parameters, approach_depth_limit_mm=parameters.approach_depth_limit_mm + back_mm)
        return replace(plan, stroke=replace(plan.stroke, parameters=deeper))

    @property
    def finds_end(self) -> bool:
        return True

    def is_over(self, context: StepContext, state: StepState[None]) -> bool:
        stroke = context.plan.stroke
        touches = context.contact.measurement.force > stroke.parameters.contact_threshold_n
        return touches and stroke.is_proven(state.stroke)

    def take(self, context: StepContext, state: StepState[None]) -> StepResult[None]:
        return take_stroke(context, state)

    def describe(self, parameters: TaskParameters) -> Iterator[str]:
        yield f"{parameters.approach_depth_limit_mm:g} mm at most"
        yield f"contact at {parameters.contact_threshold_n:g} N"

    @property
    def band(self) -> str:
        return "#fff3d6"
