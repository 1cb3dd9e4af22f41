"""A step that presses: the stroke holds the force, the step leads the tool along the surface. Pure.

While the force is controlled along the surface's normal, the controller is shown depths from the ground: the plane that
the estimated normal predicts along the path. So a corner or a way back, where the slope changes its sign, is no
disturbance for it.
"""

from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from hil_bridge.control.course.intent import Phase
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.stroke import Order, Stride, StrokeState
from hil_bridge.control.geometry.ways import Place
from hil_bridge.control.program.leg import Leg
from hil_bridge.control.program.outcome import count_sample
from hil_bridge.control.program.state import Felt, ProgramState
from hil_bridge.control.steps.across import leaning
from hil_bridge.control.steps.seam import Step, Taken, need_contact
from hil_bridge.control.types import Command
from hil_bridge.errors.causes import Reason

FLAT = (0.0, 0.0)
"""Slopes of a surface that does not fall away."""


class Guide(Struct, frozen=True):
    """Force and feed of one sample, and the state with them."""

    state: ProgramState
    stride: Stride
    trouble: Reason | None = None
    """Why the run must end; None while it need not."""


class Led(Struct, frozen=True):
    """Where a step leads the tool, by the names of the program's state."""

    at: Place
    """Commanded x and y from the start point, m."""
    local: float
    """Commanded way along the path of this step, m."""
    aside: float = 0.0
    """Commanded way to the left of the path, m."""
    heading: Place = (1.0, 0.0)
    """Direction of the path there, unit vector."""
    memory: Any = None
    """The step's own state."""


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

    def lead(self, leg: Leg, state: ProgramState, stroke: StrokeState, order: Order, felt: Felt) -> Led:
        """Where this sample orders the tool to in the plane. `stroke` and `order` are what the stroke has made of it;
        `state` is that before the stroke, but for `guide`.
        """
        return Led(state.at, state.local, state.aside, state.heading, state.memory)

    def end_sample(self, leg: Leg, before: ProgramState, taken: Taken, felt: Felt) -> Taken:
        """The sample as the step ends it: whether it is the last one. `before` is the state before the stroke."""
        return taken

    def take(self, leg: Leg, state: ProgramState, felt: Felt) -> Taken:
        measurement = felt.measurement
        guide = self.guide(leg, state, felt)
        state, stride = guide.state, guide.stride
        if guide.trouble is not None:
            return Taken(state, Order(Phase.RETRACT, measurement.commanded), trouble=guide.trouble)
        before, ground = state, state.ground
        fall, shown = state.facing.fall, measurement
        slopes = leg.shows_ground and fall != FLAT
        if ground or slopes:
            behind = rise(fall, felt.place, state.at) if slopes else 0.0
            shown = replace(
                measurement,
                position=measurement.position - (ground - behind),
                commanded=measurement.commanded - ground,
            )
        stroke, order = leg.stroke.step(state.stroke, shown, stride)
        if stroke.travel < state.base:
            stroke = replace(stroke, travel=state.base)
        led, lean = self.lead(leg, state, stroke, order, felt), state.lean
        if self.orientation == "led" and not felt.sample.held:
            lean = leaning(leg, lean, (stroke, order), measurement.dt)
        raised = ground + rise(fall, before.at, led.at) if slopes else ground
        state = replace(
            state,
            stroke=stroke,
            at=led.at,
            local=led.local,
            aside=led.aside,
            heading=led.heading,
            memory=led.memory,
            lean=lean,
            ground=raised,
            tally=count_sample(state, leg, stroke, measurement, stride.reference),
        )
        if raised or order.reference is None:
            command = shift_answer(order.command, raised)
            order = Order(order.phase, order.depth + raised, command, stride.reference)
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
