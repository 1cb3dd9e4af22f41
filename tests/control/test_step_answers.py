"""Answers of a plug-in's step: false retractions, and invalid answers."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from hil_bridge.control import (
    Allow,
    Command,
    Decision,
    Limits,
    Phase,
    Stop,
    Stroke,
    TaskParameters,
)
from hil_bridge.control.course.contact_sample import ContactSample
from hil_bridge.control.course.state import StepState
from hil_bridge.control.course.stroke import Order, StrokeState
from hil_bridge.control.decision import LoopState
from hil_bridge.control.program.legs import Ground, legs_of
from hil_bridge.control.steps.approach import Approach
from hil_bridge.control.steps.hold import Hold
from hil_bridge.control.steps.plan import StepPlan
from hil_bridge.control.steps.retract import Retract
from hil_bridge.control.steps.seam import Step, StepContext, StepResult
from hil_bridge.errors import Cause
from protocol.geometry import Vector
from tests.control.plain import DT, guarded, walk
from tests.control.test_program_course import Presses

LIMITS = Limits(workspace_min_m=(0.0, -1.0, 0.0), workspace_max_m=(2.0, 1.0, 2.0))
Answer = Callable[[StepState, ContactSample], Any]


@dataclass(frozen=True, slots=True)
class Takes(Step):
    """Step that returns this answer."""

    answer: Answer
    do: str = "takes"
    for_s: float = 8.0

    def seconds(self, plan: StepPlan, begin: object) -> float:
        return self.for_s

    def take(self, context: StepContext, state: StepState) -> StepResult:
        result: StepResult = self.answer(state, context.contact)
        return result


def run(answer: Answer, stiffness: float = 5e3, rises: float = 0.0) -> tuple[list[Decision], list[float]]:
    """Decisions of approach, that step and a retraction, and the forces. The surface is 2 mm deep; from 1 to 5 s it
    rises by this, m/s.
    """
    stroke = Stroke(TaskParameters(retract_mm=4.0, expected_stiffness_n_m=stiffness), Presses(), 50.0)
    forces: list[float] = []

    def respond(state: LoopState, time: float, position: Vector) -> dict[str, Any]:
        risen = rises * min(max(time - 1.0, 0.0), 4.0)
        forces.append(stiffness * max(position[0] - 2e-3 + risen, 0.0))
        return {"force": forces[-1]}

    return walk(guarded((Approach(), Takes(answer), Retract()), stroke, LIMITS), respond), forces


def deeper(phase: Phase, rate: float) -> Answer:
    """Return a step that orders the tool deeper at this speed, m/s, under the name of this phase."""
    return lambda state, contact: StepResult(state, Order(phase, contact.measurement.commanded + rate * DT))


@dataclass(frozen=True, slots=True)
class Zeroes(Takes):
    """Step that returns this answer in the phase zero."""

    @property
    def phase(self) -> Phase:
        return Phase.ZERO

    @property
    def presses(self) -> bool:
        return False


def run_zero(answer: Answer) -> tuple[list[Decision], list[float]]:
    """Decisions of an approach to a surface of 50 kN/m, a step with the phase zero and a retraction, and the forces."""
    stroke = Stroke(TaskParameters(retract_mm=4.0, expected_stiffness_n_m=50e3), Presses(), 50.0)
    forces: list[float] = []

    def respond(state: LoopState, time: float, position: Vector) -> dict[str, Any]:
        forces.append(50e3 * max(position[0] - 2e-3, 0.0))
        return {"force": forces[-1]}

    return walk(guarded((Approach(), Zeroes(answer), Retract()), stroke, LIMITS), respond), forces


# --- a zero that hides a contact


@pytest.mark.parametrize(
    ("force", "done", "message"),
    [
        (-2.1, True, "its zero takes 2.1 N off; allowed: at most 2 N"),
        (1e6, True, "its zero takes 1000000.0 N off; allowed: at most 2 N"),
        (math.nan, True, "its zero takes nan N off; allowed: at most 2 N"),
        (0.0, False, "it sets a zero, which only a step with the phase zero may do, when it is done"),
    ],
)
def test_zero_of_plugin_that_hides_contact_retracts_tool(force: float, done: bool, message: str) -> None:
    decisions, forces = run_zero(
        lambda state, contact: StepResult(
            state,
            Order(Phase.TRACK, contact.measurement.commanded + 5e-3 * DT),
            done=done,
            zero=(0.0, 0.0, force, 0.0, 0.0, 0.0),
        )
    )
    stop = next(each.verdict for each in decisions if isinstance(each.verdict, Stop))
    assert stop.reason.cause is Cause.STEP_CODE
    assert message in stop.reason.text
    assert forces[-1] == 0.0


def test_zero_of_plugin_within_limit_is_used() -> None:
    zero = (0.0, 0.0, -1.9, 0.0, 0.0, 0.0)
    decisions, forces = run_zero(
        lambda state, contact: StepResult(
            state, Order(Phase.ZERO, contact.measurement.commanded), done=True, zero=zero
        )
    )
    assert decisions[-1].intent.reason is None
    assert forces[-1] == 0.0


# --- false retractions


@pytest.mark.parametrize("stiffness", [5e3, 50e3])
@pytest.mark.parametrize("phase", [Phase.RETRACT, Phase.TRACK, Phase.MOVE, Phase.ZERO])
def test_pressing_step_is_limited_in_every_phase(phase: Phase, stiffness: float) -> None:
    _, forces = run(deeper(phase, 4e-3), stiffness)
    assert 40.0 < max(forces) <= 50.0 + 1e-6
    assert forces[-1] == 0.0


def test_stationary_retraction_yields_to_rising_surface() -> None:
    """10 mm/s on 5 kN/m, 50 N in each second: the guard orders it back before the limit."""
    decisions, forces = run(deeper(Phase.RETRACT, 0.0), rises=10e-3)
    assert 40.0 < max(forces) <= 50.0
    depths = [each.target.depth for each in decisions]
    # the surface has risen to 38 mm over the start, 9 mm are pressed in, and the retraction is 4 mm
    assert min(depths) == pytest.approx(-33e-3, abs=0.5e-3)


@pytest.mark.parametrize("back", [1e-9, 0.1e-3])
def test_slow_plugin_retraction_is_replaced_by_guard(
    back: float,
) -> None:
    """30 mm/s on 5 kN/m are 150 N in each second: the guard stops it, and its own retraction escapes."""
    decisions, forces = run(deeper(Phase.RETRACT, -back), rises=30e-3)
    assert max(forces) < 70.0
    assert min(each.target.depth for each in decisions) < -50e-3


def test_plugin_retraction_within_force_limit_is_allowed() -> None:
    decisions, _ = run(deeper(Phase.RETRACT, -4e-3))
    back = [each for each in decisions if each.intent.phase is Phase.RETRACT]
    assert all(isinstance(each.verdict, Allow) for each in back)
    assert decisions[-1].intent.reason is None


def test_stopped_plugin_retraction_becomes_built_in() -> None:
    """A force of 80 N appears without cause while it goes deeper."""
    stroke = Stroke(TaskParameters(retract_mm=4.0), Presses(), 50.0)
    steps = (Approach(), Takes(deeper(Phase.RETRACT, 1e-6)), Retract())
    decisions = walk(
        guarded(steps, stroke, LIMITS),
        lambda state, time, position: {
            "force": 80.0 if 2.0 < time < 2.1 else 5e3 * max(position[0] - 2e-3, 0.0)
        },
    )
    reason = decisions[-1].intent.reason
    assert reason is not None
    assert reason.cause is Cause.FORCE
    assert len(decisions) < 4.0 / DT, "at once, and not at its time limit"


def test_built_in_retraction_is_not_stopped_at_its_end() -> None:
    """Repeated counts of a sensor do not stop a retraction, in a sample without motion."""
    stroke = Stroke(TaskParameters(retract_mm=1.0), Presses(), 50.0)
    decisions = walk(
        guarded((Approach(), Hold(for_s=1.0), Retract()), stroke, LIMITS),
        lambda state, time, position: {
            "force": 5e3 * max(position[0] - 2e-3, 0.0),
            "unchanged": 99.0
            if state.program.course.leg == 2 and state.program.course.began is not None
            else 0.0,
        },
    )
    assert decisions[-1].target.depth == decisions[-2].target.depth
    assert not any(isinstance(each.verdict, Stop) for each in decisions)


def test_built_in_retraction_keeps_route_to_its_end() -> None:
    """Its last order is the position that it has reached."""
    decisions, _ = run(
        lambda state, contact: StepResult(state, Order(Phase.TRACK, contact.measurement.commanded), done=True)
    )
    depths = [each.target.depth for each in decisions]
    assert depths[-1] == depths[-2]
    assert isinstance(decisions[-1].verdict, Allow)
    assert decisions[-1].intent.reason is None


# --- invalid answers


def at(state: StepState, contact: ContactSample, **changes: Any) -> StepResult:
    return StepResult(replace(state, **changes), Order(Phase.TRACK, contact.measurement.commanded))


def zero(state: StepState, contact: ContactSample, value: Any) -> StepResult:
    return StepResult(state, Order(Phase.TRACK, contact.measurement.commanded), done=True, zero=value)


def order(state: StepState, contact: ContactSample, *parts: Any) -> StepResult:
    return StepResult(state, Order(*parts) if parts else None)  # type: ignore[arg-type]


def done(state: StepState, answer: Any) -> StepResult:
    return StepResult(state, Order(Phase.TRACK, 0.0), answer)


COMMAND = Command("x", 0.0)  # type: ignore[arg-type]
FAR = 10.0
"""Farther than the box of the run, m."""


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (lambda s, f: None, "take returns NoneType, not a StepResult"),
        (lambda s, f: StepResult(None, Order(Phase.TRACK, 0.0)), "take returns NoneType, not a StepState"),  # type: ignore[arg-type]
        (lambda s, f: order(s, f), "take returns NoneType, not an Order in its StepResult"),
        (lambda s, f: order(s, f, "track", 0.0), "take returns str, not a Phase in its Order"),
        (lambda s, f: order(s, f, Phase.TRACK, None), "TypeError: "),
        (lambda s, f: order(s, f, Phase.TRACK, "deep"), "TypeError: "),
        (lambda s, f: order(s, f, Phase.TRACK, 0.0, 3.0), "take returns float, not a Command in its Order"),
        (lambda s, f: done(s, np.zeros(2)), "ValueError: The truth value of an array"),
        (lambda s, f: zero(s, f, np.zeros(6)), "take returns ndarray, not a tuple as zero"),
        (lambda s, f: at(s, f, heading=(1.0,)), "ValueError: not enough values to unpack"),
        (lambda s, f: at(s, f, found=None), "TypeError: cannot unpack"),
        (lambda s, f: at(s, f, tally=None), "take returns NoneType, not a Tally"),
        (lambda s, f: order(s, f, Phase.TRACK, 0.0, COMMAND), "ValueError: could not convert string"),
        (lambda s, f: StepResult(s, Order(Phase.TRACK, 0.0), trouble="no"), "take returns str, not a Reason"),  # type: ignore[arg-type]
        (lambda s, f: order(s, f, Phase.TRACK, math.nan), "it leads to 0 m, 0 m at a depth of nan m"),
        (lambda s, f: order(s, f, Phase.RETRACT, math.nan), "it leads to 0 m, 0 m at a depth of nan m"),
        (lambda s, f: order(s, f, Phase.RETRACT, -math.inf), "it leads to 0 m, 0 m at a depth of -inf m"),
        (lambda s, f: order(s, f, Phase.RETRACT, -FAR), "it leads to 0 m, 0 m at a depth of -10 m"),
        (
            lambda s, f: order(s, f, Phase.TRACK, 0.0, None, math.nan),
            "it leads to 0 m, 0 m at a depth of 0 m",
        ),
        (lambda s, f: at(s, f, at=(0.0, math.nan)), "it leads to 0 m, nan m at a depth of 0.00"),
        (lambda s, f: at(s, f, at=(FAR, 0.0)), "it leads to 10 m, 0 m at a depth of 0.00"),
        (lambda s, f: at(s, f, at=None), "TypeError: "),
        (lambda s, f: at(s, f, heading=(1.0, math.inf)), "it leads to 0 m, 0 m at a depth of 0.00"),
        (lambda s, f: zero(s, f, (1.0,)), "its zero has 1 numbers, not the 6 of a wrench"),
        (lambda s, f: zero(s, f, (0.0,) * 6), "it sets a zero, which only a step with the phase zero may do"),
        (lambda s, f: at(s, f, stroke=None), "take returns NoneType, not a StrokeState"),
        (
            lambda s, f: at(s, f, stroke=StrokeState(Phase.RETRACT, turn=math.nan)),
            "it leads to 0 m, 0 m at a ",
        ),
        (
            lambda s, f: at(s, f, stroke=replace(s.stroke, phase=Phase.END)),
            "it ends the run by the phase end",
        ),
        (lambda s, f: order(s, f, Phase.END, 0.0), "it ends the run by the phase end"),
    ],
)
def test_invalid_step_answer_retracts_and_names_step(answer: Answer, message: str) -> None:
    decisions, forces = run(answer)
    stop = next(each.verdict for each in decisions if isinstance(each.verdict, Stop))
    assert stop.reason.cause is Cause.STEP_CODE
    assert stop.reason.text.startswith("step 2 (takes) failed: ")
    assert message in stop.reason.text
    assert "tests/control/test_step_answers.py:" in stop.reason.text
    last = decisions[-1].intent.reason
    assert last is not None
    assert (last.step, str(last)) == ("2 (takes)", stop.reason.text), "the step is named once, as a value too"
    assert forces[-1] == 0.0
    assert all(math.isfinite(part) for each in decisions for part in each.position)


def test_built_in_step_answers_are_not_checked() -> None:
    stroke = Stroke(TaskParameters(), Presses(), 50.0)
    row = legs_of((Approach(), Takes(at), Hold(for_s=1.0), Retract()), Ground(stroke, LIMITS))
    assert [leg.foreign for leg in row.legs] == [False, True, False, False]


def test_step_answer_accepts_numpy_numbers() -> None:
    began: list[float] = []

    def answer(state: StepState, contact: ContactSample) -> StepResult:
        began.append(contact.sample.now)
        position = (np.float64(0.0), np.float32(0.0))
        depth = np.float32(contact.measurement.commanded)
        done = np.bool_(contact.sample.now - began[0] > 0.5)
        return StepResult(replace(state, at=position), Order(Phase.TRACK, depth), done)  # type: ignore[arg-type]

    decisions, _ = run(answer)
    assert decisions[-1].intent.reason is None
    assert len(decisions) < 6.0 / DT
