"""The interface of steps: all that a kind of step defines, from its settings to its picture.

A kind is a frozen dataclass with its settings, derived from `Step`. Its word is the field `do`. The kind of a plug-in
is found through the entry point `hil_bridge.steps`, under that word. Most derive from `steps.led.LedStep`, which
presses and leads the tool along the surface.

In a run a step is given a `StepContext`, which it cannot change, and its own `StepState`, which it answers. The type
parameter of `Step` is that of `StepState.memory`.

A value of None stands for that of the task or of the limits. Places in settings are mm in the work frame: its x axis is
`frame.travel`, its z axis points away from the surface, against `frame.approach`. In a run they are m.
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
"""fixed: as at the start. along-path: turned about the approach so that it looks along the path as at its begin.
normal: perpendicular to the surface. led: tipped along the travel by the controller.
"""
ForceProfile: TypeAlias = float | tuple[tuple[float, float], ...]
"""A force, N, or pairs of way in mm and force in N, with straight ramps between."""


@dataclass(frozen=True, slots=True)
class StepLimits:
    """Limits that hold for one step, tighter than those of the run."""

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
"""A step has no limits of its own."""


@dataclass(frozen=True, slots=True)
class Criterion:
    """How good a step must have been."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    within_n: float
    """Largest distance of the force from the wanted one."""
    for_percent: float = 95.0
    """Share of the way for which the force must be within; of the time where there is no way."""

    def __post_init__(self) -> None:
        require_above_zero(self, "within_n", "for_percent")
        if self.for_percent > 100:
            raise SettingError("for_percent", f"must be at most 100, got {self.for_percent:g}")


LARGEST_ZERO_N = 2.0
"""Largest force that a zero between strokes may take off, N. Chosen; more looks like a contact."""


class StepContext(Struct, frozen=True, gc=False):
    """What a step is given for one sample beside its own state. All of it belongs to the program."""

    plan: StepPlan
    course: Course
    contact: ContactSample


class StepResult(Struct, Generic[M], frozen=True, gc=False):
    """The answer of a step for one sample."""

    state: StepState[M]
    order: Order
    done: bool = False
    """Whether the step ends with this sample."""
    trouble: Reason | None = None
    """Why the run must end; None while it need not."""
    zero: tuple[float, ...] = ()
    """New zero of the program: contact wrench in the tool frame, N and N·m, (6,); empty for none. Only a step whose
    phase is zero may set one, with its last sample. That of a plug-in may differ from the zero before by
    `LARGEST_ZERO_N`.
    """


class Drawing(NamedTuple):
    """How a step looks on the plan of a program."""

    colour: str
    style: Any = "-"
    """Line style of matplotlib; empty for a mark at the place where the step begins."""
    label: str = ""
    width: float = 1.8
    """Width of the line, points."""


class Step(Generic[M]):
    """One step of a program: its settings, its part in a run, its words and its picture.

    The settings of a kind are the fields of a frozen dataclass. Those below have defaults here, so that a kind declares
    what it has.
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
        """Name under which a found place is told; empty for none."""
        return ""

    @property
    def criterion(self) -> Criterion | None:
        return None

    @property
    def orientation(self) -> Orientation:
        return "fixed"

    @property
    def for_s(self) -> float | None:
        """Time after which the step ends, s; None for no such end."""
        return None

    @property
    def force_n(self) -> ForceProfile | None:
        return None

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
        """Whether the tool takes the orientation of the start again."""
        return False

    @property
    def goal_mm(self) -> Place | None:
        """Place in the work frame that the step goes to in free space; None for a step that does not."""
        return None

    @property
    def sketch_mm(self) -> tuple[Place, ...]:
        """Places from where the step begins to which it may lead the tool, mm; empty for a step that has a way, a goal,
        or stays. They must lie in the workspace, and are its line on the plan.
        """
        return ()

    @property
    def works_aside(self) -> bool:
        """Whether the tool may meet what is beside its way, so that it yields to it while it retracts."""
        return False

    @property
    def watches_way(self) -> bool:
        """Whether the guard watches the force against the way, as `limits.against_travel_n` says."""
        return True

    def check(self, pressing: bool, limits: Limits) -> None:
        """Raise ValueError where the step cannot follow the one before. `pressing`: the tool is in contact there.
        `limits` are those of the step.
        """

    def make_way(self, begin: Place | None) -> Way | None:
        """Path along the surface from where the step begins, work frame, mm; None for a step without one. Raises
        ValueError for one that cannot be.
        """
        return None

    def parameters(self, task: TaskParameters) -> Mapping[str, Any]:
        """Return settings of the task that differ in this step, by name; None for one that stays."""
        return {}

    def end(self, plan: StepPlan, begin: Place | None) -> Place | None:
        """Where the tool is behind the step, work frame, mm; None where the run alone knows."""
        return begin

    def seconds(self, plan: StepPlan, begin: Place | None) -> float:
        """Time that the step takes about, s."""
        raise NotImplementedError

    def reach(self, plan: Plan, back_mm: float) -> Plan:
        """Return the plan for a tool that has come back from the surface by up to `back_mm` before the step, mm."""
        return plan

    def back_from(self, plan: StepPlan, before: float) -> float:
        """How far the tool has come back from the surface behind the step, at most; `before` it likewise."""
        return 0.0 if self.presses else before

    def places(self, plan: StepPlan, begin: Place | None) -> tuple[tuple[Place, ...], float]:
        """Places where the path leads, work frame, m, and their height over the start, m. None are known in a step
        whose path begins where the run alone knows.
        """
        if begin is None:
            return (), 0.0
        x0, y0 = begin[0] * 1e-3, begin[1] * 1e-3
        if plan.way is None:
            return tuple((x0 + x * 1e-3, y0 + y * 1e-3) for x, y in self.sketch_mm), 0.0
        return tuple((x0 + x, y0 + y) for x, y in plan.way.points), 0.0

    def resumed(self, spent_s: float) -> "Step":
        """Return the rest of a step that was cut after this time, s."""
        return self

    @property
    def finds_end(self) -> bool:
        """Whether the place where it ends is the one that it tells under its name."""
        return False

    # --- in the run

    def is_over(self, context: StepContext, state: StepState[M]) -> bool:
        """Return whether the step is over before it has used this sample."""
        began = context.course.began
        return (
            self.for_s is not None and began is not None and context.contact.sample.now - began >= self.for_s
        )

    def take(self, context: StepContext, state: StepState[M]) -> StepResult[M]:
        """Return the step's answer to one sample."""
        raise NotImplementedError

    # --- words and picture

    def describe(self, parameters: TaskParameters) -> Iterator[str]:
        """Describe settings for which the table of a program has no column."""
        return iter(())

    @property
    def drawing(self) -> Drawing | None:
        """How the step looks on the plan; None for one that is not drawn."""
        return None

    @property
    def band(self) -> str:
        """Colour of the step's band in the picture of the forces."""
        return "#f2f2f2"


def above_zero(step: Step, *names: str) -> None:
    """Raise SettingError for the first of these settings that is given and not above 0."""
    require_above_zero(step, *(name for name in names if getattr(step, name) is not None))


def check_profile(force: ForceProfile | None) -> None:
    """Raise SettingError for a force profile with gaps, or with a force that does not press."""
    if force is None:
        return
    pairs = ((0.0, force),) if isinstance(force, (int, float)) else force
    if not pairs or pairs[0][0] != 0.0:
        raise SettingError("force_n", "must begin at 0 mm of the way")
    for (before, _), (after, _) in pairwise(pairs):
        if not after > before:
            raise SettingError(
                "force_n", f"must ascend along the way, but {after:g} mm follows {before:g} mm"
            )
    for _, value in pairs:
        if not (math.isfinite(value) and value > 0):
            raise SettingError("force_n", f"must be above 0 N everywhere, got {value:g}")


def need_contact(pressing: bool) -> None:
    """Raise ValueError for a step that presses and does not begin in contact."""
    if not pressing:
        raise ValueError("the tool does not press here: let an approach come before")


def need_free(pressing: bool) -> None:
    """Raise ValueError for a step through free space that begins in contact."""
    if pressing:
        raise ValueError("the tool presses here: let a retract come before")


def need_travel_speed(speed_mm_s: float | None, limits: Limits) -> None:
    """Raise ValueError for a speed along the surface above that of the limits."""
    if speed_mm_s is not None and speed_mm_s > limits.travel_mm_s:
        raise ValueError(
            f"speed_mm_s of {speed_mm_s:g} is above limits.travel_mm_s of {limits.travel_mm_s:g}"
        )
