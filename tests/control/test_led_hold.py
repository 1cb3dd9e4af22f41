"""An operator holds the tool during a led step of a plug-in: the tool stays, and the step continues afterwards."""

from dataclasses import dataclass
from typing import Any, Literal

from msgspec.structs import replace

from hil_bridge.control.course.contact_sample import ContactSample
from hil_bridge.control.steps.approach import Approach
from hil_bridge.control.steps.led import Lead, LedStep, StepSample
from hil_bridge.control.steps.retract import Retract
from hil_bridge.control.steps.seam import NO_LIMITS, StepLimits
from tests.control.plain import sense
from tests.control.test_program_course import contact_at, program_of

DT = 0.1
FOR_S = 3.0


@dataclass(frozen=True, slots=True)
class Slides(LedStep):
    """Step that moves along x without end, with or without contact, and ends when its time is over."""

    do: Literal["slides"] = "slides"
    speed_mm_s: float = 5.0
    for_s: float | None = FOR_S
    limits: StepLimits = NO_LIMITS

    def steer(self, memory: Any, sample: StepSample) -> tuple[Any, Lead]:
        late = "its time is up" if sample.last else ""
        return (memory or 0) + 1, Lead((1.0, 0.0), 8.0, trouble=late, without_contact=True)


def test_led_step_pauses_while_operator_holds() -> None:
    program = program_of(Approach(), Slides(), Retract())
    state, depth, positions, requested, forces = program.initial(), 0.0, [], [], []
    for k in range(80):
        now, is_held = DT * k, 20 <= k < 70
        contact: ContactSample = contact_at(
            now, state.step.at, depth, (5e3 * max(depth - 1e-3, 0.0), 0.0, 0.0)
        )
        contact = replace(contact, sample=replace(contact.sample, held=is_held))
        state, intent = program.step(*sense(program, state, contact))
        if state.course.failed:
            break
        depth = intent.target.depth
        positions.append(state.step.at)
        requested.append(state.step.memory and state.step.memory.own)
        forces.append(intent.reference)
    assert state.course.began is not None
    assert positions[18] < positions[19], "it moves before"
    assert len(set(positions[19:70])) == 1, "it stays, and does not end although its time expires"
    assert len(set(requested[19:70])) == 1, "and its step is not called"
    assert set(forces[19:70]) == {8.0}, "the step's force is kept"
    assert (k, str(state.course.reason)) == (70, "its time is up, in step 2 (slides)"), (
        "then the step continues"
    )


def test_led_step_may_touch_side_until_lifted() -> None:
    """A step of a plug-in may press sideways; a retraction then yields to the lateral force."""
    legs = program_of(Approach(), Slides(), Retract(), Approach(), Retract()).row.legs
    assert [leg.works_aside for leg in legs] == [False, True, True, False, False]
