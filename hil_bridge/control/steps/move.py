"""Step `move`."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal, TypeAlias

from msgspec.structs import replace

from hil_bridge.control.checks import FORBID_EXTRA
from hil_bridge.control.course.intent import Phase
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.parameters import TaskParameters
from hil_bridge.control.course.state import StepState
from hil_bridge.control.course.stroke import Order
from hil_bridge.control.geometry.ways import ROUNDING, Place
from hil_bridge.control.steps.free_space import come_to, not_there, towards
from hil_bridge.control.steps.paths import check_finite
from hil_bridge.control.steps.plan import StepPlan
from hil_bridge.control.steps.seam import (
    NO_LIMITS,
    Drawing,
    Step,
    StepContext,
    StepLimits,
    StepResult,
    above_zero,
    need_free,
    need_travel_speed,
)
from hil_bridge.errors.causes import Cause, Reason
from protocol.geometry import angle_between

_AS_AT_HOME = math.radians(0.5)
"""Largest angle to the orientation at the start at which the tool counts as having returned to it. Chosen."""


Arrival: TypeAlias = float
"""Memory of a move: the time of the last order that moved the target, s on the run's clock."""


@dataclass(frozen=True, slots=True)
class Move(Step[Arrival]):
    """Move to another point through free space, at the safe height; a touch during the motion ends the run."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    to_mm: Place
    """Target point in the work frame."""
    do: Literal["move"] = "move"
    speed_mm_s: float = 10.0
    """Speed of the motion across; an obstacle is hit at this speed. Chosen."""
    contact_n: float | None = None
    """Force that counts as a touch. Default: the contact force of the task."""
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

    def end(self, plan: StepPlan, begin: Place | None) -> Place:
        return self.to_mm

    def seconds(self, plan: StepPlan, begin: Place | None) -> float:
        return math.dist(begin, self.to_mm) / self.speed_mm_s if begin else 1.0

    def back_from(self, plan: StepPlan, before: float) -> float:
        return max(before, plan.stroke.parameters.safe_height_mm)

    def places(self, plan: StepPlan, begin: Place | None) -> tuple[tuple[Place, ...], float]:
        ends = [self.to_mm] if begin is None else [begin, self.to_mm]
        height = plan.stroke.parameters.safe_height_mm * 1e-3
        return tuple((x * 1e-3, y * 1e-3) for x, y in ends), height

    def take(self, context: StepContext, state: StepState[Arrival]) -> StepResult[Arrival]:
        """Move up to the safe height, across to the target, and wait there until the tool has arrived."""
        course, contact, task = context.course, context.contact, context.plan.stroke
        measurement, now = contact.measurement, contact.sample.now
        touch = self.contact_n or task.parameters.contact_threshold_n
        depth, force = measurement.commanded, max(math.hypot(*contact.force), contact.sample.hidden or 0.0)
        if force > touch:
            text = f"the tool touches something in free space, with {force:.1f} N"
            return StepResult(state, Order(Phase.MOVE, depth), trouble=Reason(Cause.TOUCH, text))
        if depth > course.safe + ROUNDING:
            distance = task.way(min(self.speed_mm_s, task.parameters.retract_speed_mm_s), measurement.dt)
            if depth <= ROUNDING:  # there may be an obstacle above the start
                distance = min(distance, task.careful_step(measurement.position - depth, measurement.dt))
            return StepResult(
                replace(state, memory=now), Order(Phase.MOVE, max(depth - distance, course.safe))
            )
        assert course.start is not None
        x, y = (place * 1e-3 - start for place, start in zip(self.to_mm, course.start, strict=True))
        state, arrived = towards(state, (x, y), task.way(self.speed_mm_s, measurement.dt))
        home, turned = course.home, course.turned
        turned_back = home is None or turned is None or angle_between(turned, home) < _AS_AT_HOME
        since = now if state.memory is None or not (arrived and turned_back) else state.memory
        if since != state.memory:
            state = replace(state, memory=since)
        done = arrived and turned_back and come_to(contact, state.at, depth)
        return StepResult(state, Order(Phase.MOVE, depth), done, not_there(since, now))

    def describe(self, parameters: TaskParameters) -> Iterator[str]:
        yield f"to {self.to_mm[0]:g}, {self.to_mm[1]:g} mm"

    @property
    def drawing(self) -> Drawing:
        return Drawing("#808080", (0, (4, 3)), "move, in free space", 1.2)

    @property
    def band(self) -> str:
        return "#f0f0f0"
