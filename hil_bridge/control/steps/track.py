"""Step `track`."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from dataclasses import replace as altered
from typing import ClassVar, Literal

from msgspec.structs import replace

from hil_bridge.control.checks import FORBID_EXTRA
from hil_bridge.control.course.contact_sample import ContactSample
from hil_bridge.control.course.facing import lateral_of
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.parameters import TaskParameters
from hil_bridge.control.course.state import StepState
from hil_bridge.control.course.stroke import Order, Stride, StrokeState
from hil_bridge.control.geometry.ways import ROUNDING, Place, Way, way_of
from hil_bridge.control.steps.across import aside_by, sideways_position
from hil_bridge.control.steps.feed import STUCK_S, TrackMemory, feed_of, watch_progress
from hil_bridge.control.steps.paths import Line, Path
from hil_bridge.control.steps.plan import StepPlan
from hil_bridge.control.steps.pressing import FLAT, Guide, PathPoint, PressingStep
from hil_bridge.control.steps.seam import (
    NO_LIMITS,
    Criterion,
    Drawing,
    ForceProfile,
    Orientation,
    StepContext,
    StepLimits,
    StepResult,
    above_zero,
    check_profile,
    need_travel_speed,
)
from hil_bridge.errors.causes import Cause, Reason
from protocol.marks import SettingError

_NEAR_MM = 0.01
"""Largest distance between the start of a path and the tool at which the start counts as the tool's position.
Chosen.
"""


@dataclass(frozen=True, slots=True)
class Track(PressingStep[TrackMemory]):
    """Press with a force while the tool moves along a path."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    path: Path
    do: Literal["track"] = "track"
    speed_mm_s: float | None = None
    force_n: ForceProfile | None = None
    for_s: float | None = None
    """Time after which the step ends, even before the end of the path. Default: no time limit."""
    orientation: Orientation = "fixed"
    lateral_limit_n: float | None = None
    """Force along the surface, friction included, at which the feed stops. Default: the guard stops the run at
    `limits.against_travel_n` beyond friction.
    """
    at_wall: Literal["slow", "stop"] = "slow"
    """slow: the feed becomes slower towards the limit, and the step fails when it makes no more progress. stop: it
    fails at the limit.
    """
    feed_error_n: float | None = None
    """Error of the force at which the feed is a tenth of the full speed, reached without an error. Default: always full
    speed.
    """
    across: Literal["position", "compliant", "force"] = "position"
    """Behaviour of the axis across the path: on the path; yielding to the force; or pressing with a force."""
    across_n: float = 0.0
    """Force across the path, N, positive to the left of it; with across = "force"."""
    across_n_mm: float = 1.0
    """Force across the path that moves the tool by 1 mm, N/mm; with across = "compliant"."""
    across_mm: float = 5.0
    """Largest distance of the tool from the path."""
    criterion: Criterion | None = None
    limits: StepLimits = NO_LIMITS

    def __post_init__(self) -> None:
        names = "speed_mm_s", "for_s", "lateral_limit_n", "feed_error_n", "across_n_mm", "across_mm"
        above_zero(self, *names)
        check_profile(self.force_n)
        if self.across == "force" and not (math.isfinite(self.across_n) and self.across_n):
            raise SettingError("across_n", 'must be a force that is not 0 for across = "force"')
        if self.across_n and self.across != "force":
            raise SettingError("across_n", f'needs across = "force", now "{self.across}"')

    # --- before the run

    @property
    def works_aside(self) -> bool:
        return self.across != "position"

    @property
    def watches_way(self) -> bool:
        return self.lateral_limit_n is None

    def check(self, pressing: bool, limits: Limits) -> None:
        PressingStep.check(self, pressing, limits)
        need_travel_speed(self.speed_mm_s, limits)

    def make_way(self, begin: Place | None) -> Way:
        corners = self.path.corners(begin)
        self._check_begin(corners[0], begin)
        return way_of(corners)

    def _check_begin(self, first: Place, place: Place | None) -> None:
        if isinstance(self.path, Line) and self.path.to_mm is None:
            return
        begins = f"the path begins at {first[0]:g}, {first[1]:g} mm, but the tool"
        if place is None:
            raise ValueError(f"{begins}'s position is not known here: insert a move before")
        if math.dist(first, place) > _NEAR_MM:
            raise ValueError(f"{begins} is at {place[0]:g}, {place[1]:g} mm: insert a move before")

    def parameters(self, task: TaskParameters) -> dict[str, float | None]:
        return {"speed_mm_s": self.speed_mm_s}

    def end(self, plan: StepPlan, begin: Place | None) -> Place | None:
        if self.for_s or self.across != "position" or plan.way is None or begin is None:
            return None
        x, y = plan.way.points[-1]
        return begin[0] + x * 1e3, begin[1] + y * 1e3

    def seconds(self, plan: StepPlan, begin: object) -> float:
        assert plan.way is not None
        speed = plan.stroke.parameters.speed_mm_s * 1e-3
        along = plan.way.length / speed if speed else math.inf
        return min(along, self.for_s or math.inf)

    def places(self, plan: StepPlan, begin: Place | None) -> tuple[tuple[Place, ...], float]:
        if plan.way is None or begin is None:
            return (), 0.0
        farthest = math.inf if self.for_s is None else self.for_s * plan.stroke.parameters.speed_mm_s * 1e-3
        points = plan.way.points_until(farthest)
        return tuple((begin[0] * 1e-3 + x, begin[1] * 1e-3 + y) for x, y in points), 0.0

    def resumed(self, spent_s: float) -> "Track":
        return self if self.for_s is None else altered(self, for_s=max(self.for_s - spent_s, 1e-3))

    # --- in the run

    def guide(self, context: StepContext, state: StepState[TrackMemory]) -> Guide[TrackMemory]:
        plan, contact = context.plan, context.contact
        local = state.stroke.travel - context.course.base
        reference = plan.reference(local)
        limit, is_held, lateral, feed, trouble = self.lateral_limit_n, contact.sample.held, 0.0, 1.0, None
        if limit is not None or self.feed_error_n is not None:
            lateral = lateral_of(contact.force, context.course.facing.fall if plan.shows_ground else FLAT)
            feed, trouble = feed_of(self, contact.measurement.force - reference, lateral, local)
        if is_held:
            feed = min(feed, 0.0)
        if feed != state.feed:
            state = replace(state, feed=feed)
        if limit is not None and state.stroke.in_contact and not is_held:
            memory = state.memory or _FRESH
            memory = watch_progress(memory, plan.stroke.parameters.speed_mm_s, contact.measurement.dt, local)
            state = replace(state, memory=memory)
            if memory.stuck >= STUCK_S and trouble is None:
                text = (
                    f"a lateral force of {lateral:.1f} N stops the feed {local * 1e3:.1f} mm along the path: "
                    "there is an obstacle"
                )
                trouble = Reason(Cause.NO_PROGRESS, text)
        return Guide(state, Stride(reference, feed), trouble)

    def lead(
        self, context: StepContext, state: StepState[TrackMemory], stroke: StrokeState, order: Order
    ) -> PathPoint[TrackMemory]:
        plan, origin, measurement = context.plan, context.course.origin, context.contact.measurement
        path, command = plan.way, order.command
        assert path is not None
        local, memory, aside = stroke.travel - context.course.base, state.memory, state.aside
        place, heading = path.place_and_heading(local)
        if self.across != "position":
            left = _leftwards(path.headings[path.piece(state.local)], origin, place, context.contact)
            memory = memory or _FRESH
            aside, controller = sideways_position(
                plan.stroke, self, (aside, memory.across), measurement, left
            )
            memory = replace(memory, across=controller)
        elif command is not None and command.across:
            aside = aside_by(plan, self, aside, (stroke, order), measurement.dt)
        x, y = origin[0] + place[0], origin[1] + place[1]
        if aside:
            x, y = x - aside * heading[1], y + aside * heading[0]
        return PathPoint((x, y), local, aside, heading, memory)

    def end_sample(
        self, context: StepContext, before: StepState[TrackMemory], result: StepResult[TrackMemory]
    ) -> StepResult[TrackMemory]:
        assert context.plan.way is not None
        if result.state.local < context.plan.way.length - ROUNDING:
            return result
        return replace(result, done=True)

    # --- words and picture

    def describe(self, parameters: TaskParameters) -> Iterator[str]:
        yield f"{self.path.kind}, {parameters.speed_mm_s:g} mm/s"
        if self.for_s is not None:
            yield f"{self.for_s:g} s at most"
        if self.lateral_limit_n is not None:
            ends = "stops" if self.at_wall == "stop" else "slower"
            yield f"{ends} up to {self.lateral_limit_n:g} N from the side"
        if self.feed_error_n is not None:
            yield f"slower up to {self.feed_error_n:g} N of error"
        if self.across != "position":
            yield f"{self.across} across"

    @property
    def drawing(self) -> Drawing:
        return Drawing("#0072B2", "-", "track")

    @property
    def band(self) -> str:
        return "#e3f3ec"


_FRESH = TrackMemory()
"""Memory before the first sample of the step."""


def _leftwards(heading: Place, origin: Place, place: Place, contact: ContactSample) -> tuple[float, float]:
    """Return the force to the left of the path, N, and the reported distance to the left of the given point on it,
    m.
    """
    h, k = heading
    dx, dy = contact.place[0] - origin[0] - place[0], contact.place[1] - origin[1] - place[1]
    return h * contact.force[2] - k * contact.force[1], h * dy - k * dx
