"""The step `zero`."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from hil_bridge.control.checks import FORBID_EXTRA
from hil_bridge.control.course.intent import Phase
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.program.leg import Leg
from hil_bridge.control.program.state import Felt, ProgramState
from hil_bridge.control.steps import free_space
from hil_bridge.control.steps.seam import NO_LIMITS, Step, StepLimits, Taken, above_zero, need_free


@dataclass(frozen=True, slots=True)
class Zero(Step):
    """Stand still in free space, and take what the sensor reads there for zero: against drift between strokes."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    do: Literal["zero"] = "zero"
    settle_ms: float = 1000.0
    """Time to stand still before: for the servo and the sensor's filter. Chosen."""
    for_ms: float = 500.0
    """Time over which the reading is averaged. Chosen."""
    at_most_n: float = 2.0
    """Largest force that may be taken for zero; more looks like a touch. Chosen."""
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

    def seconds(self, leg: Leg, begin: object) -> float:
        return (self.settle_ms + self.for_ms) * 1e-3

    def take(self, leg: Leg, state: ProgramState, felt: Felt) -> Taken:
        return free_space.zero(self, leg, state, felt)

    @property
    def band(self) -> str:
        return "#e4e4ee"
