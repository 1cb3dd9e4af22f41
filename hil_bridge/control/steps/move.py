"""The step `move`."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal

from hil_bridge.control.checks import FORBID_EXTRA
from hil_bridge.control.course.intent import Phase
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.parameters import TaskParameters
from hil_bridge.control.geometry.ways import Place
from hil_bridge.control.program.leg import Leg
from hil_bridge.control.program.state import Felt, ProgramState
from hil_bridge.control.steps import free_space
from hil_bridge.control.steps.paths import check_finite
from hil_bridge.control.steps.seam import (
    NO_LIMITS,
    Drawing,
    Step,
    StepLimits,
    Taken,
    above_zero,
    need_free,
    need_travel_speed,
)


@dataclass(frozen=True, slots=True)
class Move(Step):
    """Go to another place through free space, at the safe height; a touch on the way ends the run."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    to_mm: Place
    """Place in the work frame."""
    do: Literal["move"] = "move"
    speed_mm_s: float = 10.0
    """Speed of the way across; an obstacle is met with it. Chosen."""
    contact_n: float | None = None
    """Force that counts as a touch; nothing: that of the task's contact."""
    limits: StepLimits = NO_LIMITS

    def __post_init__(self) -> None:
        above_zero(self, "speed_mm_s", "contact_n")
        check_finite("to_mm", self.to_mm)

    @property
    def phase(self) -> Phase:
        return Phase.MOVE

    @property
    def presses(self) -> bool:
        return False

    @property
    def goal_mm(self) -> Place:
        return self.to_mm

    @property
    def turns_home(self) -> bool:
        return True

    @property
    def works_aside(self) -> bool:
        return True

    def check(self, pressing: bool, limits: Limits) -> None:
        need_free(pressing)
        need_travel_speed(self.speed_mm_s, limits)

    def end(self, leg: Leg, begin: Place | None) -> Place:
        return self.to_mm

    def seconds(self, leg: Leg, begin: Place | None) -> float:
        return math.dist(begin, self.to_mm) / self.speed_mm_s if begin else 1.0

    def back_from(self, leg: Leg, before: float) -> float:
        return max(before, leg.stroke.parameters.safe_height_mm)

    def places(self, leg: Leg, begin: Place | None) -> tuple[tuple[Place, ...], float]:
        ends = [self.to_mm] if begin is None else [begin, self.to_mm]
        height = leg.stroke.parameters.safe_height_mm * 1e-3
        return tuple((x * 1e-3, y * 1e-3) for x, y in ends), height

    def take(self, leg: Leg, state: ProgramState, felt: Felt) -> Taken:
        return free_space.move(self, leg, state, felt)

    def describe(self, parameters: TaskParameters) -> Iterator[str]:
        yield f"to {self.to_mm[0]:g}, {self.to_mm[1]:g} mm"

    @property
    def drawing(self) -> Drawing:
        return Drawing("#808080", (0, (4, 3)), "move, in free space", 1.2)

    @property
    def band(self) -> str:
        return "#f0f0f0"
