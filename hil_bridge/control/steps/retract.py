"""Step `retract`."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from msgspec.structs import replace

from hil_bridge.control.checks import FORBID_EXTRA, require_not_negative
from hil_bridge.control.course.intent import Phase
from hil_bridge.control.course.parameters import TaskParameters
from hil_bridge.control.course.state import StepState
from hil_bridge.control.course.yielding import yield_to
from hil_bridge.control.geometry.ways import Place
from hil_bridge.control.steps.plan import StepPlan
from hil_bridge.control.steps.seam import NO_LIMITS, Step, StepContext, StepLimits, StepResult, above_zero
from hil_bridge.control.steps.strokes import take_stroke


@dataclass(frozen=True, slots=True)
class Retract(Step[None]):
    """Move out of the surface, at least to the depth of the start."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    do: Literal["retract"] = "retract"
    back_mm: float | None = None
    """Distance to retract from the tool's position."""
    speed_mm_s: float | None = None
    limits: StepLimits = NO_LIMITS

    def __post_init__(self) -> None:
        above_zero(self, "speed_mm_s")
        if self.back_mm is not None:
            require_not_negative(self, "back_mm")

    @property
    def phase(self) -> Phase:
        return Phase.RETRACT

    @property
    def presses(self) -> bool:
        return False

    def parameters(self, task: TaskParameters) -> Mapping[str, Any]:
        return {"retract_mm": self.back_mm, "retract_speed_mm_s": self.speed_mm_s}

    def seconds(self, plan: StepPlan, begin: object) -> float:
        task = plan.stroke.parameters
        return task.retract_mm / task.retract_speed_mm_s

    def back_from(self, plan: StepPlan, before: float) -> float:
        return plan.stroke.parameters.retract_mm

    def places(self, plan: StepPlan, begin: Place | None) -> tuple[tuple[Place, ...], float]:
        if begin is None:
            return (), 0.0
        return ((begin[0] * 1e-3, begin[1] * 1e-3),), plan.stroke.parameters.retract_mm * 1e-3

    def take(self, context: StepContext, state: StepState[None]) -> StepResult[None]:
        plan, contact, before = context.plan, context.contact, state.at
        distance = plan.stroke.way(plan.stroke.parameters.retract_speed_mm_s, contact.measurement.dt)
        state = yield_to(state, contact, (distance, plan.stroke.friction_share), plan.works_aside)
        result = take_stroke(context, state)
        stroke = result.state.stroke
        if stroke.phase is not Phase.END:
            return result
        state = replace(result.state, stroke=replace(stroke, phase=Phase.RETRACT))
        return replace(
            result, state=state, done=state.at == before
        )  # not before the tool is clear of the obstacle

    def describe(self, parameters: TaskParameters) -> Iterator[str]:
        yield f"{parameters.retract_mm:g} mm back"

    @property
    def band(self) -> str:
        return "#e2f0fa"
