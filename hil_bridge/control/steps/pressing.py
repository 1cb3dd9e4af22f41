"""A step that presses: the stroke holds the force, the step leads the tool along the surface. Pure.

While the force is controlled along the surface's normal, the controller is shown depths from the ground: the plane that
the estimated normal predicts along the path. So a corner or a way back, where the slope changes its sign, is no
disturbance for it.
"""

from typing import NamedTuple

from msgspec.structs import replace

from hil_bridge.control.course.intent import Phase
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.stroke import Order, Stride
from hil_bridge.control.program.leg import Leg
from hil_bridge.control.program.outcome import count_sample
from hil_bridge.control.program.state import Felt, ProgramState
from hil_bridge.control.steps.paths import Place
from hil_bridge.control.steps.seam import Step, Taken, need_contact
from hil_bridge.control.types import Command
from hil_bridge.errors.causes import Reason

ROUNDING = 1e-9
"""Slack for sums of steps, m."""
FLAT = (0.0, 0.0)
"""Slopes of a surface that does not fall away."""


class Guide(NamedTuple):
    """How a step leads one sample."""

    state: ProgramState
    stride: Stride
    trouble: Reason | None = None
    """Why the run must end; None while it need not."""


class PressingStep(Step):
    """A step that presses. A kind leads it by `guide`, before the stroke takes the sample, and by `lead` after it."""

    __slots__ = ()

    @property
    def controls(self) -> bool:
        return True

    def check(self, pressing: bool, limits: Limits) -> None:
        need_contact(pressing)

    def guide(self, leg: Leg, state: ProgramState, felt: Felt) -> Guide:
        """Wanted force and feed of this sample."""
        return Guide(state, Stride(leg.reference(local_way(state))))

    def lead(self, leg: Leg, state: ProgramState, order: Order, felt: Felt) -> ProgramState:
        """State with the place in the plane that this sample orders; `order` is the stroke's answer."""
        return state

    def end_sample(self, leg: Leg, before: ProgramState, taken: Taken, felt: Felt) -> Taken:
        """The sample as the step ends it: whether it is the last one. `before` is the state before the stroke."""
        return taken

    def take(self, leg: Leg, state: ProgramState, felt: Felt) -> Taken:
        measurement = felt.measurement
        state, stride, trouble = self.guide(leg, state, felt)
        if trouble is not None:
            return Taken(state, Order(Phase.RETRACT, measurement.commanded), trouble=trouble)
        before, ground = state, state.ground
        fall = state.facing.fall if leg.shows_ground else FLAT
        seen = measurement
        if ground or fall != FLAT:
            behind = rise(fall, felt.place, state.at)
            seen = replace(
                measurement,
                position=measurement.position - (ground - behind),
                commanded=measurement.commanded - ground,
            )
        stroke, order = leg.stroke.step(state.stroke, seen, stride)
        if stroke.travel < state.base:
            stroke = replace(stroke, travel=state.base)
        state = self.lead(leg, replace(state, stroke=stroke), order, felt)
        raised = ground + rise(fall, before.at, state.at)
        state = count_sample(replace(state, ground=raised), leg, before, measurement)
        order = Order(
            order.phase, order.depth + raised, shift_answer(order.command, raised), stride.reference
        )
        return self.end_sample(leg, before, Taken(state, order, trouble=stroke.trouble), felt)


def local_way(state: ProgramState) -> float:
    """Commanded way along the path of the step, m."""
    return max(state.stroke.travel - state.base, 0.0)


def rise(fall: Place, before: Place, after: Place) -> float:
    """How much deeper the surface lies at one place than at another, m, going by its slopes."""
    return fall[0] * (after[0] - before[0]) + fall[1] * (after[1] - before[1])


def shift_answer(command: Command | None, ground: float) -> Command | None:
    """A controller's answer in depths from the start point."""
    return command if command is None or not ground else replace(command, position=command.position + ground)
