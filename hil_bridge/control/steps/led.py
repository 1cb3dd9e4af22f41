"""A step that presses and leads the tool by what it feels: the base for steps of other packages. Pure."""

import math
from typing import Any, NamedTuple

from msgspec.structs import replace

from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.stroke import Order, Stride, StrokeState
from hil_bridge.control.geometry.ways import Place
from hil_bridge.control.program.leg import Leg
from hil_bridge.control.program.state import Felt, ProgramState
from hil_bridge.control.steps.pressing import Guide, Led, PressingStep, local_way
from hil_bridge.control.steps.seam import Taken, need_travel_speed
from hil_bridge.errors.causes import Cause, Reason
from hil_bridge.errors.failures import WrongAnswer, one_line
from protocol.geometry import Vector


class StepSample(NamedTuple):
    """One sample as a led step sees it. Places count from where the step began, axes are those of the work frame."""

    s: float
    """Time since the step began, s."""
    dt: float
    """Time since the sample before, s."""
    force: Vector
    """Contact force along the approach, x and y, N, positive where the tool presses that way; from the newest zero."""
    moment: Vector
    """Contact moment that acts on the tool, in the tool frame, N·m, from the newest zero; NaN where it is not known. It
    is about that frame's origin, if `sensor.position_mm` tells where the sensor is; by default about the sensor.
    """
    place: Place
    """Reported x and y, m."""
    depth: float
    """Reported depth along the approach, m."""
    in_contact: bool
    """Whether the tool was taken to be in contact by the sample before."""
    force_n: float
    """Force of the step's settings, N."""
    last: bool = False
    """The time of `for_s` is up: the step ends with this sample, in order or, with `Lead.trouble`, as a failure."""


class Lead(NamedTuple):
    """Where a led step wants the tool next."""

    to: Place
    """Commanded x and y from where the step began, m. The tool goes there no faster than the step's speed, and stands
    while it is not in contact.
    """
    force_n: float | None = None
    """Force to press with, N; None for that of the step's settings."""
    done: str = ""
    """How the step has ended, in words; empty while it goes on."""
    trouble: str = ""
    """Why the run must end, in words; empty while it need not."""
    without_contact: bool = False
    """Go there without contact, too: a tool in a hole may touch its wall alone."""


class LedStep(PressingStep):
    """Presses with the run's controller and goes where `steer` says.

    A kind is a frozen dataclass with its settings, `do` and `limits` among them. It needs `for_s`, after which the step
    ends whatever it has found. It may not read a clock, a file or chance: `hil-bridge replay` decides again.
    """

    __slots__ = ()

    def begin(self) -> Any:
        """The step's own state before its first sample."""
        return None

    def steer(self, memory: Any, sample: StepSample) -> tuple[Any, Lead]:
        """The step's own state after a sample, and where it wants the tool."""
        raise NotImplementedError

    def answer(self, memory: Any, sample: StepSample) -> tuple[Any, Lead]:
        """The answer of `steer`, its place in plain numbers. Raises WrongAnswer for one without a state and a Lead."""
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

    def end(self, leg: Leg, begin: Place | None) -> Place | None:
        return None

    def seconds(self, leg: Leg, begin: object) -> float:
        return math.inf if self.for_s is None else self.for_s

    # --- in the run

    def is_over(self, leg: Leg, state: ProgramState, felt: Felt) -> bool:
        """Never before it has seen the sample: it may have to say that it has found nothing."""
        return False

    def _is_last(self, state: ProgramState, felt: Felt) -> bool:
        return (
            self.for_s is not None and state.began is not None and felt.sample.now - state.began >= self.for_s
        )

    def guide(self, leg: Leg, state: ProgramState, felt: Felt) -> Guide:
        """Force of this sample. While a person holds the tool the step sees none: it stays where it was."""
        if felt.sample.held and state.memory is not None:
            return Guide(state, Stride(self._force(leg, state, state.memory[2])))
        measurement, now, at = felt.measurement, felt.sample.now, state.origin
        memory, first, _ = state.memory or (self.begin(), measurement.position, None)
        moment = felt.wrench[3:6] if len(felt.wrench) == 6 else (math.nan, math.nan, math.nan)
        sample = StepSample(
            now - (now if state.began is None else state.began),
            measurement.dt,
            (measurement.force, felt.force[1], felt.force[2]),
            moment,
            (felt.place[0] - at[0], felt.place[1] - at[1]),
            measurement.position - first,
            state.in_contact,
            leg.reference(local_way(state)),
            self._is_last(state, felt),
        )
        memory, lead = self.answer(memory, sample)
        trouble = Reason(Cause.STEP_TROUBLE, one_line(str(lead.trouble))) if lead.trouble else None
        force = self._force(leg, state, lead)
        return Guide(replace(state, memory=(memory, first, lead)), Stride(force), trouble)

    def _force(self, leg: Leg, state: ProgramState, lead: Lead) -> float:
        """Wanted force, N. Raises ValueError for one that is not allowed."""
        force, limit = leg.reference(local_way(state)), leg.stroke.force_limit_n
        if lead.force_n is not None:
            force = float(lead.force_n)
        if not 0.0 < force < limit:
            raise ValueError(
                f"it asks for a force of {force:g} N; allowed is one above 0, and below {limit:g} N"
            )
        return force

    def lead(self, leg: Leg, state: ProgramState, stroke: StrokeState, order: Order, felt: Felt) -> Led:
        lead: Lead = state.memory[2]
        (x, y), (u, v) = state.at, (state.origin[0] + lead.to[0], state.origin[1] + lead.to[1])
        left = math.hypot(u - x, v - y)
        goes = (stroke.in_contact or lead.without_contact) and not felt.sample.held
        if left == 0.0 or not goes:
            return Led(state.at, state.local, state.aside, state.heading, state.memory)
        way = min(leg.stroke.parameters.speed_mm_s * 1e-3 * felt.measurement.dt, left)
        heading = (u - x) / left, (v - y) / left
        at = x + way * heading[0], y + way * heading[1]
        return Led(at, state.local + way, state.aside, heading, state.memory)

    def end_sample(self, leg: Leg, before: ProgramState, taken: Taken, felt: Felt) -> Taken:
        lead: Lead = taken.state.memory[2]
        last = self._is_last(before, felt)
        if felt.sample.held or not (lead.done or last):
            return taken
        text = one_line(str(lead.done)) or f"ended after {self.for_s:g} s"
        state = replace(taken.state, text=text, found=(felt.sample.position, 1))
        return replace(taken, state=state, done=True)
