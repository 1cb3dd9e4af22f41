"""Base class for steps of plug-ins that press and steer the tool by its sensor readings. Pure."""

import math
from typing import Any, Generic, NamedTuple

from msgspec import Struct
from msgspec.structs import replace

from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.state import M, StepState
from hil_bridge.control.course.stroke import Order, Stride, StrokeState
from hil_bridge.control.geometry.ways import Place
from hil_bridge.control.steps.plan import StepPlan
from hil_bridge.control.steps.pressing import Guide, PathPoint, PressingStep, length_on_path
from hil_bridge.control.steps.seam import StepContext, StepResult, need_travel_speed
from hil_bridge.errors.causes import Cause, Reason
from hil_bridge.errors.failures import WrongAnswer, one_line
from protocol.geometry import Vector


class StepSample(NamedTuple):
    """One sample as a `LedStep` receives it. Positions are relative to the start of the step, along the axes of the
    work frame.
    """

    s: float
    """Time since the step began, s."""
    dt: float
    """Time since the previous sample, s."""
    force: Vector
    """Contact force along the approach, x and y, N, relative to the newest zero. A component is positive if the
    tool presses in its direction.
    """
    moment: Vector
    """Contact moment on the tool relative to the newest zero, in the tool frame, N·m; NaN if unknown. It is about
    the origin of the tool frame if `sensor.position_mm` gives the sensor's position, and about the sensor by
    default.
    """
    place: Place
    """Reported x and y, m."""
    depth: float
    """Reported depth along the approach, m."""
    in_contact: bool
    """Whether the tool was in contact according to the previous sample."""
    force_n: float
    """Force from the step's settings, N."""
    last: bool = False
    """Whether the time `for_s` has passed. The step ends with this sample, successfully or, with `Lead.trouble`, as
    a failure.
    """


class Lead(NamedTuple):
    """Next target of a `LedStep`."""

    to: Place
    """Commanded x and y relative to the start of the step, m. The tool moves to this point no faster than the
    step's speed, and stops while it is not in contact.
    """
    force_n: float | None = None
    """Force to press with, N; None to use the force from the step's settings."""
    done: str = ""
    """Description of how the step has ended; empty while it continues."""
    trouble: str = ""
    """Reason why the run must end; empty if it may continue."""
    without_contact: bool = False
    """Whether to move to the target even without contact: a tool in a hole may touch only the wall of the hole."""


class LedMemory(Struct, Generic[M], frozen=True):
    """Memory of a `LedStep`."""

    own: M
    """Internal memory that `steer` has returned."""
    first: float
    """Reported depth at the first sample of the step, m."""
    lead: Lead


class LedStep(PressingStep[LedMemory[M]], Generic[M]):
    """Step that presses with the run's controller and moves to the targets that `steer` returns.

    A kind is a frozen dataclass with its settings, including `do` and `limits`. It needs `for_s`, after which the
    step ends whether or not it has succeeded. It must not use a clock, a file or random numbers, because
    `hil-bridge replay` repeats its decisions.
    """

    __slots__ = ()

    def begin(self) -> M:
        """Return the step's internal memory before its first sample."""
        return None  # type: ignore[return-value]

    def steer(self, memory: M, sample: StepSample) -> tuple[M, Lead]:
        """Return the step's internal memory after a sample, and its next target."""
        raise NotImplementedError

    def answer(self, memory: M, sample: StepSample) -> tuple[M, Lead]:
        """Return the response of `steer`, with its point as plain numbers.

        Raises WrongAnswer if the response is not a state and a Lead.
        """
        answer: Any = self.steer(memory, sample)
        if not (isinstance(answer, tuple) and len(answer) == 2 and isinstance(answer[1], Lead)):
            raise WrongAnswer(self, "steer", answer, "a state and a Lead")
        memory, lead = answer
        x, y = lead.to
        return memory, lead._replace(to=(float(x), float(y)))

    # --- before the run

    @property
    def works_aside(self) -> bool:
        return True

    def check(self, pressing: bool, limits: Limits) -> None:
        PressingStep.check(self, pressing, limits)
        need_travel_speed(self.speed_mm_s, limits)

    def parameters(self, task: object) -> dict[str, float | None]:
        return {"speed_mm_s": self.speed_mm_s}

    def end(self, plan: StepPlan, begin: Place | None) -> Place | None:
        return None

    def seconds(self, plan: StepPlan, begin: object) -> float:
        return math.inf if self.for_s is None else self.for_s

    # --- in the run

    def is_over(self, context: StepContext, state: StepState[LedMemory[M]]) -> bool:
        """Return False. The step must receive the sample first, because it may have to report a failed search."""
        return False

    def _is_last(self, context: StepContext) -> bool:
        began = context.course.began
        return (
            self.for_s is not None and began is not None and context.contact.sample.now - began >= self.for_s
        )

    def guide(self, context: StepContext, state: StepState[LedMemory[M]]) -> Guide[LedMemory[M]]:
        """Return the force for this sample. `steer` is not called while an operator holds the tool."""
        before, contact, course = state.memory, context.contact, context.course
        if contact.sample.held and before is not None:
            return Guide(state, Stride(self._force(context, state, before.lead)))
        measurement, now, at, wrench = contact.measurement, contact.sample.now, course.origin, contact.wrench
        first = measurement.position if before is None else before.first
        moment = wrench[3:6] if len(wrench) == 6 else (math.nan, math.nan, math.nan)
        sample = StepSample(
            s=now - (now if course.began is None else course.began),
            dt=measurement.dt,
            force=(measurement.force, contact.force[1], contact.force[2]),
            moment=moment,
            place=(contact.place[0] - at[0], contact.place[1] - at[1]),
            depth=measurement.position - first,
            in_contact=state.stroke.in_contact,
            force_n=context.plan.reference(length_on_path(context, state)),
            last=self._is_last(context),
        )
        own, lead = self.answer(self.begin() if before is None else before.own, sample)
        trouble = Reason(Cause.STEP_TROUBLE, one_line(str(lead.trouble))) if lead.trouble else None
        force = self._force(context, state, lead)
        return Guide(replace(state, memory=LedMemory(own, first, lead)), Stride(force), trouble)

    def _force(self, context: StepContext, state: StepState[LedMemory[M]], lead: Lead) -> float:
        """Return the desired force, N. Raises ValueError for a force that is not allowed."""
        plan = context.plan
        force, limit = plan.reference(length_on_path(context, state)), plan.stroke.force_limit_n
        if lead.force_n is not None:
            force = float(lead.force_n)
        if not 0.0 < force < limit:
            raise ValueError(f"it asks for a force of {force:g} N; allowed: above 0 N and below {limit:g} N")
        return force

    def lead(
        self, context: StepContext, state: StepState[LedMemory[M]], stroke: StrokeState, order: Order
    ) -> PathPoint[LedMemory[M]]:
        contact, origin, memory = context.contact, context.course.origin, state.memory
        assert memory is not None
        lead = memory.lead
        (x, y), (u, v) = state.at, (origin[0] + lead.to[0], origin[1] + lead.to[1])
        left = math.hypot(u - x, v - y)
        goes = (stroke.in_contact or lead.without_contact) and not contact.sample.held
        if left == 0.0 or not goes:
            return PathPoint(state.at, state.local, state.aside, state.heading, memory)
        speed = context.plan.stroke.parameters.speed_mm_s * 1e-3
        distance = min(speed * contact.measurement.dt, left)
        heading = (u - x) / left, (v - y) / left
        at = x + distance * heading[0], y + distance * heading[1]
        return PathPoint(at, state.local + distance, state.aside, heading, memory)

    def end_sample(
        self,
        context: StepContext,
        before: StepState[LedMemory[M]],
        result: StepResult[LedMemory[M]],
    ) -> StepResult[LedMemory[M]]:
        memory, sample = result.state.memory, context.contact.sample
        assert memory is not None
        if sample.held or not (memory.lead.done or self._is_last(context)):
            return result
        text = one_line(str(memory.lead.done)) or f"ended after {self.for_s:g} s"
        state = replace(result.state, text=text, found=(sample.position, 1))
        return replace(result, state=state, done=True)
