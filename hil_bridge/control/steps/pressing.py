"""A step that presses: the stroke holds the force, the step leads the tool along the surface. Pure.

While the force is controlled along the surface's normal, the controller is shown depths from the ground: the plane that
the estimated normal predicts along the path. So a corner or a way back, where the slope changes its sign, is no
disturbance for it.
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
"""Slopes of a surface that does not fall away."""


_BAND_SHARE = 0.1
"""Chosen: share of the desired force by which it may be off and still counts as held, without a criterion."""


class Guide(Struct, Generic[M], frozen=True, gc=False):
    """Force and feed of one sample, and the state with them."""

    state: StepState[M]
    stride: Stride
    trouble: Reason | None = None
    """Why the run must end; None while it need not."""


class PathPoint(Struct, Generic[M], frozen=True, gc=False):
    """Where a step leads the tool, by the names of its state."""

    at: Place
    """Commanded x and y from the start point, m."""
    local: float
    """Commanded length along the path of this step, m."""
    aside: float = 0.0
    """Commanded distance to the left of the path, m."""
    heading: Place = (1.0, 0.0)
    """Direction of the path there, unit vector."""
    memory: M | None = None
    """The step's own memory."""


class PressingStep(Step[M]):
    """A step that presses. A kind leads it by `guide`, before the stroke takes the sample, and by `lead` after it."""

    __slots__ = ()

    @property
    def controls(self) -> bool:
        return True

    def check(self, pressing: bool, limits: Limits) -> None:
        need_contact(pressing)

    def guide(self, context: StepContext, state: StepState[M]) -> Guide[M]:
        """Return the desired force and the feed of this sample."""
        return Guide(state, Stride(context.plan.reference(local_way(context, state))))

    def lead(
        self, context: StepContext, state: StepState[M], stroke: StrokeState, order: Order
    ) -> PathPoint[M]:
        """Return where this sample leads the tool in the plane. `stroke` and `order` are what the stroke has made of
        it; `state` is that before the stroke, but for `guide`.
        """
        return PathPoint(state.at, state.local, state.aside, state.heading, state.memory)

    def end_sample(self, context: StepContext, before: StepState[M], result: StepResult[M]) -> StepResult[M]:
        """Return the result with the end of the step, if it ends. `before` is the state before the stroke."""
        return result

    def take(self, context: StepContext, state: StepState[M]) -> StepResult[M]:
        plan, contact, measurement = context.plan, context.contact, context.contact.measurement
        guide = self.guide(context, state)
        state, stride = guide.state, guide.stride
        if guide.trouble is not None:
            return StepResult(state, Order(Phase.RETRACT, measurement.commanded), trouble=guide.trouble)
        before, ground = state, state.ground
        fall, given = context.course.facing.fall, measurement
        slopes = plan.shows_ground and fall != FLAT
        if ground or slopes:
            behind = rise(fall, contact.place, state.at) if slopes else 0.0
            given = replace(
                measurement,
                position=measurement.position - (ground - behind),
                commanded=measurement.commanded - ground,
            )
        stroke, order = plan.stroke.step(state.stroke, given, stride)
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
        """Return the sums of the step with one more sample. `stroke` is the stroke's state after it, `reference` the
        desired force, N.
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


def local_way(context: StepContext, state: StepState[M]) -> float:
    """Return the commanded length along the path of the step, m."""
    return max(state.stroke.travel - context.course.base, 0.0)


def rise(fall: Place, before: Place, after: Place) -> float:
    """How much deeper the surface lies at one place than at another, m, going by its slopes."""
    return fall[0] * (after[0] - before[0]) + fall[1] * (after[1] - before[1])


def shift_answer(command: Command | None, ground: float) -> Command | None:
    """Return a controller's answer in depths from the start point."""
    return command if command is None or not ground else replace(command, position=command.position + ground)
