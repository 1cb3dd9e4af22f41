"""One sample of a step that consists only of a stroke into or out of the surface. Pure."""

from msgspec.structs import replace

from hil_bridge.control.course.state import M, StepState
from hil_bridge.control.steps.seam import StepContext, StepResult


def take_stroke(context: StepContext, state: StepState[M]) -> StepResult[M]:
    """Return the response to one sample of a step that consists only of a stroke."""
    stroke, order = context.plan.stroke.step(state.stroke, context.contact.measurement)
    return StepResult(replace(state, stroke=stroke), order, trouble=stroke.trouble)
