"""The step `retract`."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from msgspec.structs import replace

from hil_bridge.control.checks import FORBID_EXTRA, require_not_negative
from hil_bridge.control.course.intent import Phase
from hil_bridge.control.course.parameters import TaskParameters
from hil_bridge.control.course.yielding import yield_to
from hil_bridge.control.geometry.ways import Place
from hil_bridge.control.program.leg import Leg
from hil_bridge.control.program.state import Felt, ProgramState
from hil_bridge.control.steps.seam import NO_LIMITS, Step, StepLimits, Taken, above_zero
from hil_bridge.control.steps.strokes import take_stroke


@dataclass(frozen=True, slots=True)
class Retract(Step):
    """Back out of the surface, at least to the depth of the start."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    do: Literal["retract"] = "retract"
    back_mm: float | None = None
    """Way back from where the tool is."""
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

    def seconds(self, leg: Leg, begin: object) -> float:
        task = leg.stroke.parameters
        return task.retract_mm / task.retract_speed_mm_s

    def back_from(self, leg: Leg, before: float) -> float:
        return leg.stroke.parameters.retract_mm

    def places(self, leg: Leg, begin: Place | None) -> tuple[tuple[Place, ...], float]:
        if begin is None:
            return (), 0.0
        return ((begin[0] * 1e-3, begin[1] * 1e-3),), leg.stroke.parameters.retract_mm * 1e-3

    def take(self, leg: Leg, state: ProgramState, felt: Felt) -> Taken:
        before, way = state.at, leg.stroke.way(leg.stroke.parameters.retract_speed_mm_s, felt.measurement.dt)
        state = yield_to(state, felt, (way, leg.stroke.friction_share), leg.works_aside)
        taken = take_stroke(leg, state, felt.measurement)
        stroke = taken.state.stroke
        if stroke.phase is not Phase.END:
            return taken
        done = state.at == before  # not before the tool is off what pushed it
        return replace(
            taken, state=replace(taken.state, stroke=replace(stroke, phase=Phase.RETRACT)), done=done
        )

    def describe(self, parameters: TaskParameters) -> Iterator[str]:
        yield f"{parameters.retract_mm:g} mm back"

    @property
    def band(self) -> str:
        return "#e2f0fa"
