"""A controller or a step that fails: in words with its package and place, and its traceback."""

from typing import Any, NamedTuple

from hil_bridge.control.program.leg import Leg, StepFailed
from hil_bridge.control.types import Command, Controller, ControllerFailed
from hil_bridge.errors.causes import Cause, Reason
from hil_bridge.errors.failures import failure, place_of_method, traceback_of

_METHODS = "steer", "take", "guide", "lead", "end_sample", "is_over"
"""Methods by which a step of a plug-in takes part in a run; the first that it has is told."""
_STIFFEST_N_M = 1e12
"""Stiffness that a controller can mean at most, N/m. Chosen: above that of any contact, and its square is a number."""


class Failed(NamedTuple):
    """A fault of a controller or of a step."""

    reason: Reason
    trace: str = ""
    """Traceback of what it raised; empty where it raised nothing."""


def blame_error(controller: Controller[Any], leg: Leg, error: BaseException) -> Failed:
    """Blame the controller, or the step of this leg, for an exception that it raised or that its answer caused."""
    if isinstance(error, ControllerFailed):
        raised = error.__cause__ or error
        said = failure(raised, place_of_method(controller, "step"))
        return _blame(controller, said, traceback_of(raised))
    if isinstance(error, StepFailed):  # a sample may end one step and begin the next
        leg, error = error.leg, error.__cause__ or error
    said = failure(error, _place_of(leg))
    reason = Reason(Cause.STEP_CODE, f"step {leg.label} failed: {said}", step=leg.label)
    return Failed(reason, traceback_of(error))


def is_stiffness(value: float | None) -> bool:
    """Whether a controller can mean this stiffness, N/m, or tells none."""
    return value is None or abs(value) <= _STIFFEST_N_M


def blame_answer(controller: Controller[Any], command: Command) -> Failed:
    """Blame it for a command that is not a number, or too far away to be meant."""
    place = place_of_method(controller, "step")
    aside = f" and {command.across} m aside" if command.across else ""
    turn = f" and a turn of {command.turn} rad" if command.turn else ""
    learnt = "" if is_stiffness(command.stiffness) else f" and learns a stiffness of {command.stiffness} N/m"
    said = f"it commands {command.position} m{aside}{turn}{learnt}"
    return _blame(controller, f"{said}{place and f' ({place})'}")


def _place_of(leg: Leg) -> str:
    """Package and place of the step's own code; empty for a step of ours."""
    return next(filter(None, (place_of_method(leg.step, name) for name in _METHODS)), "")


def _blame(controller: Controller[Any], said: str, trace: str = "") -> Failed:
    return Failed(Reason(Cause.CONTROLLER, f"controller {controller.name} failed: {said}"), trace)
