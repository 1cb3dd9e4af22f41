"""Interface of steps: everything that a kind of step defines, from its settings to its drawing.

A kind is a frozen dataclass with its settings, derived from `Step`. Its word is the field `do`. The kind of a
plug-in is loaded through the entry point `hil_bridge.steps` with that word as its name. Most plug-ins derive from
`steps.led.LedStep`, which presses and moves the tool along the surface.

In a run, a step receives a read-only `StepContext` and its own `StepState`, and returns the next state. The type
parameter of `Step` is the type of `StepState.memory`.

A setting of None selects the value of the task or of the limits. Positions in settings are in mm in the work frame:
its x axis is `frame.travel`, and its z axis points away from the surface, against `frame.approach`. In a run they
are in m.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar, Generic, Literal, NamedTuple, TypeAlias, TypeVar

from msgspec import Struct

from hil_bridge.control.checks import FORBID_EXTRA, require_above_zero
from hil_bridge.control.course.contact_sample import ContactSample
from hil_bridge.control.course.intent import Phase
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.parameters import TaskParameters
from hil_bridge.control.course.state import Course, M, StepState
from hil_bridge.control.course.stroke import Order
from hil_bridge.control.geometry.ways import Place, Way
from hil_bridge.control.steps.plan import StepPlan
from hil_bridge.errors.causes import Reason
from protocol.marks import SettingError

Plan = TypeVar("Plan", bound=StepPlan)

Orientation: TypeAlias = Literal["fixed", "along-path", "normal", "led"]
"""Orientation of the tool. fixed: as at the start. along-path: rotated about the approach, so that the tool keeps
its angle to the path. normal: perpendicular to the surface. led: tilted along the travel by the controller.
"""
ForceProfile: TypeAlias = float | tuple[tuple[float, float], ...]
"""Force, N, or pairs of path length, mm, and force, N, with linear ramps between them."""


@dataclass(frozen=True, slots=True)
class StepLimits:
    """Limits for one step, tighter than those of the run."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    force_limit_n: float | None = None
    resultant_limit_n: float | None = None
    moment_limit_nm: float | None = None
    correction_mm_s: float | None = None
    travel_mm_s: float | None = None
    turn_deg_s: float | None = None

    def __post_init__(self) -> None:
        require_above_zero(self, *(name for name in self.__slots__ if getattr(self, name) is not None))


NO_LIMITS = StepLimits()
"""No limits in addition to the limits of the run."""


@dataclass(frozen=True, slots=True)
class Criterion:
    """Quality that a step must reach."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    within_n: float
    """Largest difference between the force and the desired one."""
    for_percent: float = 95.0
    """Share of the path for which the force must be within; of the time if there is no path."""

    def __post_init__(self) -> None:
        require_above_zero(self, "within_n", "for_percent")
        if self.for_percent > 100:
            raise SettingError("for_percent", f"must be at most 100, got {self.for_percent:g}")


LARGEST_ZERO_N = 2.0
"""Largest force that a zero between strokes may remove, N. Chosen: a larger force looks like a contact."""


class StepContext(Struct, frozen=True, gc=False):
    """Read-only data of the program that a step receives for one sample, in addition to its own state."""

    plan: StepPlan
    course: Course
    contact: ContactSample


class StepResult(Struct, Generic[M], frozen=True, gc=False):
    """Response of a step to one sample."""

    state: StepState[M]
    order: Order
    done: bool = False
    """Whether the step ends with this sample."""
    trouble: Reason | None = None
    """Reason why the run must end; None if it may continue."""
    zero: tuple[float, ...] = ()
    """New zero of the program: contact wrench in the tool frame, N and N·m, shape (6,); empty if there is none.
    Only a step whose phase is zero may set a zero, with its last sample. The zero of a plug-in may differ from the
    previous zero by `LARGEST_ZERO_N`.
    """


class Drawing(NamedTuple):
    """Appearance of a step in the drawing of a program."""

    colour: str
    style: Any = "-"
    """Line style of matplotlib; empty to draw a mark at the point where the step begins."""
    label: str = ""
    width: float = 1.8
    """Line width, points."""


class Step(Generic[M]):
    """One step of a program: its settings, its behaviour in a run, its description and its drawing.

    The settings of a kind are the fields of a frozen dataclass. The settings below have defaults here, so that a
    kind declares only the settings that it has.
    """

    __slots__ = ()
    __pydantic_config__: ClassVar = FORBID_EXTRA

    # --- settings that more than one kind has

    @property
    def do(self) -> str:
        """Word of the step in a program."""
        raise NotImplementedError

    @property
    def limits(self) -> StepLimits:
        return NO_LIMITS

    @property
    def name(self) -> str:
        """Name under which a position is reported; empty if no position is reported."""
        return ""

    @property
    def criterion(self) -> Criterion | None:
        return None

    @property
    def orientation(self) -> Orientation:
        return "fixed"

    @property
    def for_s(self) -> float | None:
        """Time after which the step ends, s; None if there is no time limit."""
        return None

    @property
    def force_n(self) -> ForceProfile | None:
        return None

    @property
    def sine_n(self) -> float:
        """Amplitude by which the force oscillates about `force_n`, N."""
        return 0.0

    @property
    def speed_mm_s(self) -> float | None:
        return None

    # --- before the run

    @property
    def phase(self) -> Phase:
        """Phase in which the step begins."""
        return Phase.TRACK

    @property
    def presses(self) -> bool:
        """Whether the tool presses at the end of the step."""
        return True

    @property
    def controls(self) -> bool:
        """Whether the controller holds a force in the step."""
        return False

    @property
    def turns_home(self) -> bool:
        """Whether the tool returns to the orientation at the start."""
        return False

    @property
    def goal_mm(self) -> Place | None:
        """Point in the work frame to which the step moves in free space; None for other steps."""
        return None

    @property
    def sketch_mm(self) -> tuple[Place, ...]:
        """Points to which the step may move the tool, relative to its start, mm. The list is empty for a step that
        has a path or a goal, or that does not move. The points must lie in the workspace, and are drawn as the line
        of the step.
        """
        return ()

    @property
    def works_aside(self) -> bool:
        """Whether the tool may meet an obstacle next to its path. If so, it yields to the obstacle while it
        retracts.
        """
        return False

    @property
    def watches_way(self) -> bool:
        """Whether the supervisor checks the force against the motion, as `limits.against_travel_n` defines."""
        return True

    def check(self, pressing: bool, limits: Limits) -> None:
        """Raise ValueError if the step cannot follow the previous one.

        `pressing` states whether the tool is in contact at the start of the step. `limits` are the limits of the
        step.
        """

    def make_way(self, begin: Place | None) -> Way | None:
        """Return the path along the surface from the start of the step, work frame, mm; None for a step without a
        path. Raises ValueError for an invalid path.
        """
        return None

    def parameters(self, task: TaskParameters) -> Mapping[str, Any]:
        """Return the task settings that the step overrides, by name; None for a setting that stays unchanged."""
        return {}

    def end(self, plan: StepPlan, begin: Place | None) -> Place | None:
        """Return the position of the tool after the step, work frame, mm; None if it is known only during the run."""
        return begin

    def seconds(self, plan: StepPlan, begin: Place | None) -> float:
        """Return the approximate duration of the step, s."""
        raise NotImplementedError

    def reach(self, plan: Plan, back_mm: float) -> Plan:
        """Return the plan for a tool that has retracted by up to `back_mm` (mm) before the step."""
        return plan

    def back_from(self, plan: StepPlan, before: float) -> float:
        """Return the largest distance that the tool has retracted after the step. `before` is the largest distance
        before the step.
        """
        return 0.0 if self.presses else before

    def places(self, plan: StepPlan, begin: Place | None) -> tuple[tuple[Place, ...], float]:
        """Return the points of the path, work frame, m, and their height above the start, m. The list is empty for
        a step whose start is known only during the run.
        """
        if begin is None:
            return (), 0.0
        x0, y0 = begin[0] * 1e-3, begin[1] * 1e-3
        if plan.way is None:
            return tuple((x0 + x * 1e-3, y0 + y * 1e-3) for x, y in self.sketch_mm), 0.0
        return tuple((x0 + x, y0 + y) for x, y in plan.way.points), 0.0

    def resumed(self, spent_s: float) -> "Step":
        """Return the rest of a step that was interrupted after the given time, s."""
        return self

    @property
    def finds_end(self) -> bool:
        """Whether the step reports the position at its end under its name."""
        return False

    # --- in the run

    def is_over(self, context: StepContext, state: StepState[M]) -> bool:
        """Return whether the step is over before it uses the given sample."""
        began = context.course.began
        return (
            self.for_s is not None and began is not None and context.contact.sample.now - began >= self.for_s
        )

    def take(self, context: StepContext, state: StepState[M]) -> StepResult[M]:
        """Return the response of the step to one sample."""
        raise NotImplementedError

    # --- words and picture

    def describe(self, parameters: TaskParameters) -> Iterator[str]:
        """Return a description of the settings that have no column in the table of a program."""
        return iter(())

    @property
    def drawing(self) -> Drawing | None:
        """Appearance of the step in the drawing; None for a step that is not drawn."""
        return None

    @property
    def band(self) -> str:
        """Colour of the step's band in the plot of the forces."""
        return "#f2f2f2"


def above_zero(step: Step, *names: str) -> None:
    """Raise SettingError for the first of the given settings that is set and not above 0."""
    require_above_zero(step, *(name for name in names if getattr(step, name) is not None))


def check_profile(force: ForceProfile | None) -> None:
    """Raise SettingError for a force profile that has gaps, or a force that does not press."""
    if force is None:
        return
    pairs = ((0.0, force),) if isinstance(force, (int, float)) else force
    if not pairs or pairs[0][0] != 0.0:
        raise SettingError("force_n", "must begin at 0 mm of the path")
    for (before, _), (after, _) in pairwise(pairs):
        if not after > before:
            raise SettingError(
                "force_n", f"must ascend along the path, but {after:g} mm follows {before:g} mm"
            )
    for _, value in pairs:
        if not (math.isfinite(value) and value > 0):
            raise SettingError("force_n", f"must be above 0 N everywhere, got {value:g}")


def need_contact(pressing: bool) -> None:
    """Raise ValueError if a step that presses does not begin in contact."""
    if not pressing:
        raise ValueError("the tool does not press here: insert an approach before")


def need_free(pressing: bool) -> None:
    """Raise ValueError if a step through free space begins in contact."""
    if pressing:
        raise ValueError("the tool presses here: insert a retract before")


def need_travel_speed(speed_mm_s: float | None, limits: Limits) -> None:
    """Raise ValueError if a speed along the surface is above the limit."""
    if speed_mm_s is not None and speed_mm_s > limits.travel_mm_s:
        raise ValueError(
            f"speed_mm_s of {speed_mm_s:g} is above limits.travel_mm_s of {limits.travel_mm_s:g}"
        )
