"""Step that presses: the stroke controls the force, and the step moves the tool along the surface. Pure.

While the force is controlled along the surface's normal, the controller receives depths relative to the ground: the
plane that the estimated normal predicts along the path. So a corner or a reversal, where the slope changes its
sign, does not disturb the controller.
"""

from typing import Generic

from msgspec import Struct
from msgspec.structs import replace

from hil_bridge.control.course.intent import Phase
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.state import M, StepState, Tally
from hil_bridge.control.course.stroke import Order, Stride, StrokeState
from hil_bridge.control.geometry.ways import Place
from hil_bridge.control.steps.across import leaning
from hil_bridge.control.steps.seam import Step, StepContext, StepResult, need_contact
from hil_bridge.control.types import Command
from hil_bridge.errors.causes import Reason

FLAT = (0.0, 0.0)
"""Slopes of a level surface."""


_BAND_SHARE = 0.1
"""Largest error at which the force counts as held if there is no criterion, as a share of the desired force. Chosen."""


class Guide(Struct, Generic[M], frozen=True, gc=False):
    """Desired force and feed for one sample, and the state that contains them."""

    state: StepState[M]
    stride: Stride
    trouble: Reason | None = None
    """Reason why the run must end; None if it may continue."""


class PathPoint(Struct, Generic[M], frozen=True, gc=False):
    """Point to which a step moves the tool. The fields have the names of the fields in the step's state."""

    at: Place
    """Commanded x and y relative to the start point, m."""
    local: float
    """Commanded path length in this step, m."""
    aside: float = 0.0
    """Commanded distance to the left of the path, m."""
    heading: Place = (1.0, 0.0)
    """Direction of the path at this point, as a unit vector."""
    memory: M | None = None
    """Internal memory of the step."""


class PressingStep(Step[M]):
    """Step that presses. A kind controls it by `guide` before the stroke uses the sample, and by `lead` afterwards."""

    __slots__ = ()

    @property
    def controls(self) -> bool:
        return True

    def check(self, pressing: bool, limits: Limits) -> None:
        need_contact(pressing)

    def guide(self, context: StepContext, state: StepState[M]) -> Guide[M]:
        """Return the desired force and the feed for this sample."""
        return Guide(state, Stride(context.plan.reference(length_on_path(context, state))))

    def lead(
        self, context: StepContext, state: StepState[M], stroke: StrokeState, order: Order
    ) -> PathPoint[M]:
        """Return the point in the plane to which this sample moves the tool. `stroke` and `order` are the results
        of the stroke. `state` is the state before the stroke, changed only by `guide`.
        """
        return PathPoint(state.at, state.local, state.aside, state.heading, state.memory)

    def end_sample(self, context: StepContext, before: StepState[M], result: StepResult[M]) -> StepResult[M]:
        """Return the result, including the end of the step if it ends. `before` is the state before the stroke."""
        return result

    def take(self, context: StepContext, state: StepState[M]) -> StepResult[M]:
        plan, contact, measurement = context.plan, context.contact, context.contact.measurement
        guide = self.guide(context, state)
        state, stride = guide.state, guide.stride
        if guide.trouble is not None:
            return StepResult(state, Order(Phase.RETRACT, measurement.commanded), trouble=guide.trouble)
        before, ground = state, state.ground
        fall, from_ground = context.course.facing.fall, measurement
        slopes = plan.shows_ground and fall != FLAT
        if ground or slopes:
            behind = rise(fall, contact.place, state.at) if slopes else 0.0
            from_ground = replace(
                measurement,
                position=measurement.position - (ground - behind),
                commanded=measurement.commanded - ground,
            )
        stroke, order = plan.stroke.step(state.stroke, from_ground, stride)
        if stroke.travel < context.course.base:
            stroke = replace(stroke, travel=context.course.base)
        point, lean = self.lead(context, state, stroke, order), state.lean
        if self.orientation == "led" and not contact.sample.held:
            lean = leaning(plan, lean, (stroke, order), measurement.dt)
        raised = ground + rise(fall, before.at, point.at) if slopes else ground
        state = replace(
            state,
            stroke=stroke,
            at=point.at,
            local=point.local,
            aside=point.aside,
            heading=point.heading,
            memory=point.memory,
            lean=lean,
            ground=raised,
            tally=self.count_sample(context, state, stroke, stride.reference),
        )
        if raised or order.reference is None:
            command = shift_answer(order.command, raised)
            order = Order(order.phase, order.depth + raised, command, stride.reference)
        return self.end_sample(context, before, StepResult(state, order, trouble=stroke.trouble))

    def count_sample(
        self, context: StepContext, state: StepState[M], stroke: StrokeState, reference: float
    ) -> Tally:
        """Return the sums of the step including one more sample. `stroke` is the state of the stroke after it,
        `reference` the desired force, N.
        """
        tally, measurement = state.tally, context.contact.measurement
        if not stroke.in_contact:
            return tally
        amount = measurement.dt if context.plan.way is None else stroke.travel - state.stroke.travel
        if amount < 0.0:
            amount = 0.0
        force, criterion = measurement.force, self.criterion
        total, pressed = tally.total + amount, tally.force + amount * force
        deep = tally.deep + amount * measurement.position
        if abs(force - reference) <= (reference * _BAND_SHARE if criterion is None else criterion.within_n):
            good = stroke.travel - context.course.base
            return Tally(total, tally.within + amount, pressed, deep, good)
        return Tally(total, tally.within, pressed, deep, tally.good)


def length_on_path(context: StepContext, state: StepState[M]) -> float:
    """Return the commanded path length in the step, m."""
    return max(state.stroke.travel - context.course.base, 0.0)


def rise(fall: Place, before: Place, after: Place) -> float:
    """Return how much deeper the surface is at one point than at another, m, according to its slopes."""
    return fall[0] * (after[0] - before[0]) + fall[1] * (after[1] - before[1])


def shift_answer(command: Command | None, ground: float) -> Command | None:
    """Return the response of a controller with depths relative to the start point."""
    return command if command is None or not ground else replace(command, position=command.position + ground)
