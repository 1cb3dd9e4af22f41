"""Step `zero`."""

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

from msgspec import Struct
from msgspec.structs import replace

from hil_bridge.control.checks import FORBID_EXTRA
from hil_bridge.control.course.intent import Phase
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.state import StepState
from hil_bridge.control.course.stroke import Order
from hil_bridge.control.steps.plan import StepPlan
from hil_bridge.control.steps.seam import (
    LARGEST_ZERO_N,
    NO_LIMITS,
    Step,
    StepContext,
    StepLimits,
    StepResult,
    above_zero,
    need_free,
)
from hil_bridge.errors.causes import Cause, Reason

_NONE = (0.0,) * 6


class Readings(Struct, frozen=True):
    """Memory of a `zero` step while readings are averaged."""

    sums: tuple[float, ...] = _NONE
    """Sum of the wrenches, N and N·m."""
    count: int = 0
    newest: int = -1
    """Counter of the newest frame."""


@dataclass(frozen=True, slots=True)
class Zero(Step[Readings]):
    """Pause in free space and use the sensor's mean reading there as the zero, against drift between strokes."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    do: Literal["zero"] = "zero"
    settle_ms: float = 1000.0
    """Pause before the readings, for the servo and the sensor's filter to settle. Chosen."""
    for_ms: float = 500.0
    """Time over which readings are averaged. Chosen."""
    at_most_n: float = LARGEST_ZERO_N
    """Largest force that a zero may remove; a larger one looks like a contact. Chosen."""
    limits: StepLimits = NO_LIMITS

    def __post_init__(self) -> None:
        above_zero(self, "settle_ms", "for_ms", "at_most_n")

    @property
    def phase(self) -> Phase:
        return Phase.ZERO

    @property
    def presses(self) -> bool:
        return False

    def check(self, pressing: bool, limits: Limits) -> None:
        need_free(pressing)

    def seconds(self, plan: StepPlan, begin: object) -> float:
        return (self.settle_ms + self.for_ms) * 1e-3

    def take(self, context: StepContext, state: StepState[Readings]) -> StepResult[Readings]:
        course, sample, wrench = context.course, context.contact.sample, context.contact.wrench
        order = Order(Phase.ZERO, context.contact.measurement.commanded)
        passed = sample.now - (sample.now if course.began is None else course.began)
        if passed < self.settle_ms * 1e-3:
            return StepResult(state, order)
        before, readings = course.zero or _NONE, state.memory or Readings()
        if sample.sensor_sequence != readings.newest and len(wrench) == 6:
            sums = tuple(
                a + (value + zero) for a, value, zero in zip(readings.sums, wrench, before, strict=True)
            )
            readings = Readings(sums, readings.count + 1, sample.sensor_sequence)
            state = replace(state, memory=readings)
        if passed < (self.settle_ms + self.for_ms) * 1e-3:
            return StepResult(state, order)
        if not readings.count:
            reason = Reason(Cause.NO_READING, "no force to use as the zero")
            return StepResult(state, order, trouble=reason)
        mean = tuple(value / readings.count for value in readings.sums)
        force = math.dist(mean[:3], before[:3])
        if force > self.at_most_n:
            text = (
                f"{force:.1f} N would be used as the zero, allowed: at most {self.at_most_n:g} N: "
                "the tool touches something, or the sensor drifts"
            )
            return StepResult(state, order, trouble=Reason(Cause.DRIFT, text))
        return StepResult(state, order, done=True, zero=mean)

    @property
    def band(self) -> str:
        return "#e4e4ee"
