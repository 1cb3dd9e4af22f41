"""Check of the response from a plug-in's step before it is used. Pure."""

import math
from typing import Any

from hil_bridge.control.course.intent import Phase
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.state import StepState, Tally
from hil_bridge.control.course.stroke import Order, StrokeState
from hil_bridge.control.program.leg import Leg
from hil_bridge.control.steps.seam import LARGEST_ZERO_N, StepContext, StepResult
from hil_bridge.control.types import Command, as_command
from hil_bridge.errors.causes import Reason
from hil_bridge.errors.failures import WrongAnswer


def check_result(context: StepContext, leg: Leg, before: StepState, result: Any) -> None:
    """Check the response of a step to one sample. `before` is the state that the step received.

    Raises WrongAnswer if a part has the wrong type. Raises ValueError for an order that is not finite or out of
    reach, for a zero that could hide a contact, and for an end of the run.
    """
    _require(leg, result, StepResult, "a StepResult")
    state, order = result.state, result.order
    _require(leg, state, StepState, "a StepState in its StepResult")
    _require(leg, state.stroke, StrokeState, "a StrokeState in the state of its StepResult")
    _require(leg, order, Order, "an Order in its StepResult")
    _require(leg, order.phase, Phase, "a Phase in its Order")
    _require(leg, order.command, (Command, type(None)), "a Command in its Order")
    _require(leg, result.trouble, (Reason, type(None)), "a Reason as its trouble")
    _require(leg, state.tally, Tally, "a Tally in the state of its StepResult")
    _require(leg, result.zero, tuple, "a tuple as zero")
    bool(result.done)  # may be a numpy type
    if order.command is not None:
        as_command(order.command)
    if Phase.END in (order.phase, state.stroke.phase):
        raise ValueError("it ends the run by the phase end: a step that is over answers done = True")
    if result.zero:
        _check_zero(context, leg, result)
    (h, k), ((a, b, c), _) = state.heading, state.found
    numbers = (
        *(*state.at, h, k, a, b, c, *result.zero, state.local, state.aside, state.lean, state.ground),
        *(state.stroke.travel, state.stroke.turn or 0.0, order.reference or 0.0),
    )
    (x, y), farthest = state.at, farthest_answer(leg.limits)
    sideways, deeper = math.dist(state.at, before.at), order.depth - context.contact.measurement.commanded
    near = abs(deeper) <= farthest and sideways <= farthest
    if not (near and math.isfinite(sum(numbers))):
        raise ValueError(f"it leads to {x:g} m, {y:g} m at a depth of {order.depth:g} m")


def _check_zero(context: StepContext, leg: Leg, result: StepResult) -> None:
    """Check a zero by the rules of the step `zero`. A retraction would interpret the subtracted force as a force
    from behind.
    """
    if len(result.zero) != 6:
        raise ValueError(f"its zero has {len(result.zero)} numbers, not the 6 of a wrench")
    if not (leg.phase is Phase.ZERO and result.done):
        raise ValueError("it sets a zero, which only a step with the phase zero may do, when it is done")
    force = math.dist(result.zero[:3], context.course.zero[:3] or (0.0, 0.0, 0.0))
    if not force <= LARGEST_ZERO_N:
        raise ValueError(f"its zero takes {force:.1f} N off; allowed: at most {LARGEST_ZERO_N:g} N")


def farthest_answer(limits: Limits) -> float:
    """Return the largest plausible distance of a commanded position from the previous command, m. The workspace is
    smaller.
    """
    return limits.correction_total_mm * 1e-3 + math.dist(limits.workspace_min_m, limits.workspace_max_m)


def _require(leg: Leg, part: Any, kind: type | tuple[type, ...], description: str) -> None:
    if not isinstance(part, kind):
        raise WrongAnswer(leg.step, "take", part, description)
