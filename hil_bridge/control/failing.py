"""Failure of a controller or step: its description with package and code location, and its traceback."""

from typing import Any, NamedTuple

from hil_bridge.control.program.leg import Leg, StepFailed
from hil_bridge.control.types import Command, Controller, ControllerFailed
from hil_bridge.errors.causes import Cause, Reason
from hil_bridge.errors.failures import failure, method_location, traceback_of

_METHODS = "steer", "take", "guide", "lead", "end_sample", "is_over"
"""Methods by which a plug-in's step takes part in a run. The first method that the step defines is reported."""
_STIFFEST_N_M = 1e12
"""Largest plausible stiffness that a controller may report, N/m. Chosen: above the stiffness of any contact, with a
finite square.
"""


class Failed(NamedTuple):
    """Failure of a controller or step."""

    reason: Reason
    trace: str = ""
    """Traceback of the exception; empty if there was no exception."""


def blame_error(controller: Controller[Any], leg: Leg, error: BaseException) -> Failed:
    """Return the failure of the controller, or of this leg's step, for an exception that it raised or that its
    response caused.
    """
    if isinstance(error, ControllerFailed):
        raised = error.__cause__ or error
        text = failure(raised, method_location(controller, "step"))
        return _controller_failure(controller, text, traceback_of(raised))
    if isinstance(error, StepFailed):  # a sample may end one step and begin the next
        leg, error = error.leg, error.__cause__ or error
    text = failure(error, _code_location(leg))
    reason = Reason(Cause.STEP_CODE, f"step {leg.label} failed: {text}", step=leg.label)
    return Failed(reason, traceback_of(error))


def is_stiffness(value: float | None) -> bool:
    """Return whether a controller may report the given stiffness, N/m. None is allowed."""
    return value is None or abs(value) <= _STIFFEST_N_M


def blame_answer(controller: Controller[Any], command: Command) -> Failed:
    """Return the failure of the controller if its command is not finite or implausibly far away."""
    place = method_location(controller, "step")
    aside = f" and {command.across} m sideways" if command.across else ""
    turn = f" and a turn of {command.turn} rad" if command.turn else ""
    learnt = "" if is_stiffness(command.stiffness) else f" and reports a stiffness of {command.stiffness} N/m"
    text = f"it commands {command.position} m{aside}{turn}{learnt}"
    return _controller_failure(controller, f"{text}{place and f' ({place})'}")


def _code_location(leg: Leg) -> str:
    """Return the package and code location of a plug-in's step; empty for a built-in step."""
    return next(filter(None, (method_location(leg.step, name) for name in _METHODS)), "")


def _controller_failure(controller: Controller[Any], text: str, trace: str = "") -> Failed:
    return Failed(Reason(Cause.CONTROLLER, f"controller {controller.name} failed: {text}"), trace)
