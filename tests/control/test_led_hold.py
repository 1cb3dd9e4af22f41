"""An operator holds the tool while a step of a plug-in leads it: it stays, and the step continues afterwards."""

from dataclasses import dataclass
from typing import Any, Literal

from msgspec.structs import replace

from hil_bridge.control.course.contact_sample import ContactSample
from hil_bridge.control.steps.approach import Approach
from hil_bridge.control.steps.led import Lead, LedStep, StepSample
from hil_bridge.control.steps.retract import Retract
from hil_bridge.control.steps.seam import NO_LIMITS, StepLimits
from tests.control.plain import sense
from tests.control.test_program_course import program_of, seen

DT = 0.1
FOR_S = 3.0


@dataclass(frozen=True, slots=True)
class Slides(LedStep):
    """Goes along x without an end, contact or none, and says so when its time is up."""

    do: Literal["slides"] = "slides"
    speed_mm_s: float = 5.0
    for_s: float | None = FOR_S
    limits: StepLimits = NO_LIMITS

    def steer(self, memory: Any, sample: StepSample) -> tuple[Any, Lead]:
        late = "its time is up" if sample.last else ""
        return (memory or 0) + 1, Lead((1.0, 0.0), 8.0, trouble=late, without_contact=True)


def test_a_led_tool_stays_where_a_person_holds_it() -> None:
    program = program_of(Approach(), Slides(), Retract())
    state, depth, places, asked, forces = program.initial(), 0.0, [], [], []
    for k in range(80):
        now, held = DT * k, 20 <= k < 70
        felt: ContactSample = seen(now, state.step.at, depth, (5e3 * max(depth - 1e-3, 0.0), 0.0, 0.0))
        felt = replace(felt, sample=replace(felt.sample, held=held))
        state, intent = program.step(*sense(program, state, felt))
        if state.course.failed:
            break
        depth = intent.target.depth
        places.append(state.step.at)
        asked.append(state.step.memory and state.step.memory.own)
        forces.append(intent.reference)
    assert state.course.began is not None
    assert places[18] < places[19], "it moves before"
    assert len(set(places[19:70])) == 1, "it stays, and does not end although its time is up meanwhile"
    assert len(set(asked[19:70])) == 1, "and its step is not asked"
    assert set(forces[19:70]) == {8.0}, "the step's force is kept"
    assert (k, str(state.course.reason)) == (70, "its time is up, in step 2 (slides)"), (
        "then the step has its say"
    )


def test_a_led_tool_may_lean_on_what_is_beside_it_until_it_has_lifted() -> None:
    """A step of a plug-in may press aside: a retraction then yields to it."""
    legs = program_of(Approach(), Slides(), Retract(), Approach(), Retract()).row.legs
    assert [leg.works_aside for leg in legs] == [False, True, True, False, False]
