"""Step `seek`."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal

from msgspec import Struct
from msgspec.structs import replace

from hil_bridge.control.checks import FORBID_EXTRA, require_not_negative
from hil_bridge.control.course.intent import Phase
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.parameters import TaskParameters
from hil_bridge.control.course.state import StepState
from hil_bridge.control.course.stroke import Order, StrokeState
from hil_bridge.control.geometry.ways import ROUNDING, Place, Way, way_of
from hil_bridge.control.steps.free_space import come_to, not_there, towards
from hil_bridge.control.steps.paths import Line
from hil_bridge.control.steps.plan import StepPlan
from hil_bridge.control.steps.pressing import PathPoint, PressingStep
from hil_bridge.control.steps.seam import (
    NO_LIMITS,
    Drawing,
    StepContext,
    StepLimits,
    StepResult,
    above_zero,
    need_free,
    need_travel_speed,
)
from hil_bridge.errors.causes import Cause, Reason
from protocol.marks import SettingError

_UNSURE_N = 5.0
"""Smallest force across the approach that is treated as a force against the motion if axes are unverified, N.
Chosen.
"""
_UNSURE_SHARE = 3.0
"""Largest ratio of the force across the approach to the force against the motion. Chosen: an obstacle met at less
than 70°.
"""


class BackOff(Struct, frozen=True):
    """Memory of a seek whose search has ended."""

    to: float
    """Path length to which the tool backs off, m."""
    since: float
    """Time of the last order that moved the target, s on the run's clock."""


@dataclass(frozen=True, slots=True)
class Seek(PressingStep[BackOff]):
    """Move along the surface until the tool meets a force against it, or the edge of the surface."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    direction_deg: float
    """Direction in the plane, from x towards y."""
    do: Literal["seek"] = "seek"
    until: Literal["force", "edge"] = "force"
    """force: move in free space until something pushes back. edge: press until the surface ends."""
    name: str = ""
    """Name under which the resulting position is reported; empty for none."""
    at_most_mm: float = 50.0
    speed_mm_s: float | None = None
    """Speed of the search. Default: the speed of an approach."""
    contact_n: float | None = None
    """Force that ends the search. Default: the contact force of the task."""
    back_off_mm: float = 1.0
    """Distance to back off from the obstacle; unused for an edge."""
    limits: StepLimits = NO_LIMITS

    def __post_init__(self) -> None:
        above_zero(self, "at_most_mm", "speed_mm_s", "contact_n")
        require_not_negative(self, "back_off_mm")
        if not math.isfinite(self.direction_deg):
            raise SettingError("direction_deg", "must be a number")

    # --- before the run

    @property
    def phase(self) -> Phase:
        return Phase.TRACK if self.presses else Phase.SEEK

    @property
    def presses(self) -> bool:
        return self.until == "edge"

    @property
    def controls(self) -> bool:
        return self.presses

    @property
    def works_aside(self) -> bool:
        return not self.presses

    @property
    def watches_way(self) -> bool:
        return self.presses

    def check(self, pressing: bool, limits: Limits) -> None:
        if not self.presses:
            need_free(pressing)
        elif not pressing:
            raise ValueError("an edge is searched for while pressing: insert an approach before")
        need_travel_speed(self.speed_mm_s, limits)

    def make_way(self, begin: Place | None) -> Way:
        return way_of(Line(length_mm=self.at_most_mm, direction_deg=self.direction_deg).corners((0.0, 0.0)))

    def parameters(self, task: TaskParameters) -> dict[str, float | None]:
        speed = self.speed_mm_s or task.approach_speed_mm_s
        return {"speed_mm_s": speed, "contact_threshold_n": self.contact_n}

    def end(self, plan: StepPlan, begin: Place | None) -> None:
        return None

    def seconds(self, plan: StepPlan, begin: object) -> float:
        return self.at_most_mm / plan.stroke.parameters.speed_mm_s

    # --- in the run

    def take(self, context: StepContext, state: StepState[BackOff]) -> StepResult[BackOff]:
        if self.presses:
            return PressingStep.take(self, context, state)
        return self._advance(context, state) if state.memory is None else self._back_off(context, state)

    def _advance(self, context: StepContext, state: StepState[BackOff]) -> StepResult[BackOff]:
        """Return the response while the tool advances until an obstacle resists."""
        plan, contact, measurement = context.plan, context.contact, context.contact.measurement
        task, path, order = plan.stroke, plan.way, Order(Phase.SEEK, measurement.commanded)
        assert path is not None
        (h, k), (u, v) = path.headings[0], context.course.origin
        local, reported = ((x - u) * h + (y - v) * k for x, y in (state.at, contact.place))
        force = contact.against((h, k))
        if contact.aside > max(_UNSURE_N, _UNSURE_SHARE * force) and force < contact.aside:
            text = f"{contact.aside:.1f} N across the approach, {force:.1f} N against the way: an axis is dead or wrong"
            return StepResult(state, order, trouble=Reason(Cause.DEAD_AXIS, text))
        if force > task.parameters.contact_threshold_n:
            back = BackOff(max(reported - self.back_off_mm * 1e-3, 0.0), contact.sample.now)
            return StepResult(replace(state, memory=back, found=(contact.sample.position, 1)), order)
        if local >= path.length - ROUNDING:
            text = f"no obstacle within {self.at_most_mm:g} mm"
            return StepResult(state, order, trouble=Reason(Cause.NOT_FOUND, text))
        forth = min(
            task.way(task.parameters.speed_mm_s, measurement.dt),
            task.careful_step(local - reported, measurement.dt),
            path.length - local,
        )
        return StepResult(replace(state, at=(state.at[0] + forth * h, state.at[1] + forth * k)), order)

    def _back_off(self, context: StepContext, state: StepState[BackOff]) -> StepResult[BackOff]:
        """Return the response while the tool backs off from the obstacle."""
        plan, contact, measurement, back = (
            context.plan,
            context.contact,
            context.contact.measurement,
            state.memory,
        )
        assert plan.way is not None
        assert back is not None
        (x, y), (h, k) = context.course.origin, plan.way.headings[0]
        speed = plan.stroke.parameters.retract_speed_mm_s
        state, arrived = towards(
            state, (x + back.to * h, y + back.to * k), plan.stroke.way(speed, measurement.dt)
        )
        if not arrived:
            back = replace(back, since=contact.sample.now)
            state = replace(state, memory=back)
        order, there = Order(Phase.SEEK, measurement.commanded), arrived and come_to(contact, state.at)
        return StepResult(state, order, there, not_there(back.since, contact.sample.now))

    def lead(
        self, context: StepContext, state: StepState[BackOff], stroke: StrokeState, order: Order
    ) -> PathPoint[BackOff]:
        path, origin = context.plan.way, context.course.origin
        assert path is not None
        local = stroke.travel - context.course.base
        x, y = path.at(local)
        at = origin[0] + x, origin[1] + y
        return PathPoint(at, local, state.aside, path.headings[0], state.memory)

    def end_sample(
        self, context: StepContext, before: StepState[BackOff], result: StepResult[BackOff]
    ) -> StepResult[BackOff]:
        """Return the end of the step at a loss of contact, if that is the edge that it searches for."""
        path, contact = context.plan.way, context.contact
        assert path is not None
        state, stroke = result.state, result.state.stroke
        if stroke.in_contact:
            state = replace(state, found=(contact.sample.position, 1))
            trouble = result.trouble
            if stroke.travel - context.course.base >= path.length - ROUNDING and trouble is None:
                trouble = Reason(Cause.NO_EDGE, f"no edge within {path.length * 1e3:g} mm")
            return replace(result, state=state, trouble=trouble)
        lost, pressed = stroke.phase is not Phase.TRACK, before.found[1] > 0
        if not (lost and pressed):  # the search continues until this step has had contact
            return result
        # stop: the next leg moves away
        state = replace(state, stroke=replace(before.stroke, travel=stroke.travel))
        order = replace(result.order, phase=Phase.TRACK, depth=contact.measurement.commanded)
        return StepResult(state, order, done=True)

    # --- words and picture

    def describe(self, parameters: TaskParameters) -> Iterator[str]:
        yield f"{'the edge' if self.presses else 'a force'} towards {self.direction_deg:g}°"

    @property
    def drawing(self) -> Drawing:
        return Drawing("#D55E00", ":", "seek, at most", 1.6)

    @property
    def band(self) -> str:
        return "#fbe3d9"
