"""The step `seek`."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal

from msgspec.structs import replace

from hil_bridge.control.checks import FORBID_EXTRA, require_not_negative
from hil_bridge.control.course.intent import Phase
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.parameters import TaskParameters
from hil_bridge.control.course.stroke import Order, StrokeState
from hil_bridge.control.geometry.ways import Place, Way, way_of
from hil_bridge.control.program.leg import Leg
from hil_bridge.control.program.outcome import ROUNDING
from hil_bridge.control.program.state import Felt, ProgramState
from hil_bridge.control.steps import free_space
from hil_bridge.control.steps.paths import Line
from hil_bridge.control.steps.pressing import Led, PressingStep
from hil_bridge.control.steps.seam import (
    NO_LIMITS,
    Drawing,
    StepLimits,
    Taken,
    above_zero,
    need_free,
    need_travel_speed,
)
from hil_bridge.errors.causes import Cause, Reason
from protocol.marks import SettingError


@dataclass(frozen=True, slots=True)
class Seek(PressingStep):
    """Move along the surface until something is found: a force against the tool, or the edge of the surface."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    direction_deg: float
    """Direction in the plane, from x towards y."""
    do: Literal["seek"] = "seek"
    until: Literal["force", "edge"] = "force"
    """force: in free space, until something pushes back. edge: pressing, until the surface ends."""
    name: str = ""
    """Name under which the found place is told; empty for none."""
    at_most_mm: float = 50.0
    speed_mm_s: float | None = None
    """Nothing: the speed of an approach."""
    contact_n: float | None = None
    """Force that counts as found; nothing: that of the task's contact."""
    back_off_mm: float = 1.0
    """Way back from what pushed back; unused for an edge."""
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
            raise ValueError("an edge is sought while pressing: let an approach come before")
        need_travel_speed(self.speed_mm_s, limits)

    def make_way(self, begin: Place | None) -> Way:
        return way_of(Line(length_mm=self.at_most_mm, direction_deg=self.direction_deg).corners((0.0, 0.0)))

    def parameters(self, task: TaskParameters) -> dict[str, float | None]:
        speed = self.speed_mm_s or task.approach_speed_mm_s
        return {"speed_mm_s": speed, "contact_threshold_n": self.contact_n}

    def end(self, leg: Leg, begin: Place | None) -> None:
        return None

    def seconds(self, leg: Leg, begin: object) -> float:
        return self.at_most_mm / leg.stroke.parameters.speed_mm_s

    # --- in the run

    def take(self, leg: Leg, state: ProgramState, felt: Felt) -> Taken:
        if self.presses:
            return PressingStep.take(self, leg, state, felt)
        return free_space.seek(self, leg, state, felt)

    def lead(self, leg: Leg, state: ProgramState, stroke: StrokeState, order: Order, felt: Felt) -> Led:
        assert leg.way is not None
        local = stroke.travel - state.base
        x, y = leg.way.at(local)
        at = state.origin[0] + x, state.origin[1] + y
        return Led(at, local, state.aside, leg.way.headings[0], state.memory)

    def end_sample(self, leg: Leg, before: ProgramState, taken: Taken, felt: Felt) -> Taken:
        """A loss of contact is what the step wants."""
        assert leg.way is not None
        state, stroke = taken.state, taken.state.stroke
        if stroke.in_contact:
            state = replace(state, found=(felt.sample.position, 1))
            trouble = taken.trouble
            if stroke.travel - state.base >= leg.way.length - ROUNDING and trouble is None:
                trouble = Reason(Cause.NO_EDGE, f"no edge within {leg.way.length * 1e3:g} mm")
            return replace(taken, state=state, trouble=trouble)
        lost, pressed = stroke.phase is not Phase.TRACK, before.found[1] > 0
        if not (lost and pressed):  # a contact that this step has not had yet is sought on
            return taken
        # stand still: the next leg leads away
        state = replace(state, stroke=replace(before.stroke, travel=stroke.travel))
        order = replace(taken.order, phase=Phase.TRACK, depth=felt.measurement.commanded)
        return Taken(state, order, done=True)

    # --- words and picture

    def describe(self, parameters: TaskParameters) -> Iterator[str]:
        yield f"{'the edge' if self.presses else 'a force'} towards {self.direction_deg:g}°"

    @property
    def drawing(self) -> Drawing:
        return Drawing("#D55E00", ":", "seek, at most", 1.6)

    @property
    def band(self) -> str:
        return "#fbe3d9"
