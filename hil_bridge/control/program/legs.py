"""Preparation of a program: its steps in sequence, each with its stroke, checked before any motion."""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

from hil_bridge.control.course.intent import Phase
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.parameters import TaskParameters
from hil_bridge.control.course.stroke import Stroke
from hil_bridge.control.geometry.ways import Place, Way
from hil_bridge.control.program.leg import Leg, Row, label_of
from hil_bridge.control.steps.repeat import unroll
from hil_bridge.control.steps.seam import Step, StepLimits
from hil_bridge.errors import StepError
from hil_bridge.errors.failures import failure, involves_plugin, is_ours

LEGS_MAX = 5000
"""Maximum number of steps in a program, counting all passes. Chosen."""


@dataclass(frozen=True, slots=True)
class Ground:
    """Data from which legs are made, in addition to their steps."""

    stroke: Stroke
    """Stroke with the parameters of the run."""
    limits: Limits
    """Limits of the run."""
    speed_mm_s: float = math.inf
    """Path velocity of the robot, mm/s."""
    origin_known: bool = False
    """Whether paths are relative to a given origin instead of the start point."""
    follows: bool = False
    """Whether the force is controlled along the estimated normal in every step that presses."""
    shows_ground: bool = True
    """Whether the controller receives depths from the plane that the normal predicts, if it follows the normal."""


def legs_of(steps: Sequence[Step], ground: Ground, written: bool = True) -> Row:
    """Return the sequence of legs for the given steps. `written` is True if the user wrote the steps.

    Raises ConfigError with the number of the first invalid step.
    """
    legs: list[Leg] = []
    places: list[Place | None] = []
    place: Place | None = None if ground.origin_known else (0.0, 0.0)
    presses, back_mm = False, 0.0
    for number, step, turn in unroll(tuple(steps)):
        if len(legs) >= LEGS_MAX:
            raise StepError(f"more than {LEGS_MAX} steps, with the passes of a repeat")
        with _label_errors(label_of(number, step, turn.turn)):
            leg = _leg(number, step, ground, (place, presses))
            leg = step.reach(leg, back_mm)
            back_mm = step.back_from(leg, back_mm)
            after = step.end(leg, place)
        leg = replace(
            leg,
            repeat=turn,
            works_aside=leg.works_aside or _inherits_side(legs, leg),
        )
        legs.append(leg)
        places.append(place)
        presses = step.presses
        place = after
    if presses or not legs:
        raise StepError("the last step must be a retract, because a program must not end in contact")
    return Row(tuple(legs), tuple(places), written)


def seconds(row: Row) -> list[float]:
    """Return the approximate duration of each leg, s. Slower motion in corners is not included."""
    durations = []
    for leg, place in zip(row.legs, row.places, strict=True):
        with _label_errors(leg.label):
            time = leg.step.seconds(leg, place)
        if not math.isfinite(time):
            raise StepError("it never ends; give speed_mm_s above 0, or for_s", leg.label)
        durations.append(time)
    return durations


def _inherits_side(before: Sequence[Leg], leg: Leg) -> bool:
    """Return whether the tool may still touch an obstacle next to the path of an earlier step."""
    if not before or not before[-1].works_aside:
        return False
    return before[-1].presses or leg.phase is Phase.RETRACT


@contextmanager
def _label_errors(label: str) -> Iterator[None]:
    """Convert the rejection by a step, and any exception of a plug-in's step, to a StepError with the given label."""
    try:
        yield
    except ValueError as error:
        raise StepError(str(error), label) from error
    except Exception as error:
        if not involves_plugin(error):
            raise
        raise StepError(failure(error), label) from error


def _leg(number: str, step: Step, ground: Ground, before: tuple[Place | None, bool]) -> Leg:
    """Return the leg of a step. `before` holds the position of the tool, mm, and whether it presses there."""
    place, presses = before
    tight = _tighten(ground.limits, step.limits)
    speed = step.speed_mm_s
    if speed is not None and speed > ground.speed_mm_s:
        raise ValueError(
            f"speed_mm_s of {speed:g} is faster than the robot's path velocity: lower it, or set "
            f"robot.velocity_mm_s, now {ground.speed_mm_s:g}"
        )
    step.check(presses, tight)
    path = step.make_way(place)
    parameters = _parameters(ground.stroke.parameters, step)
    profile = _profile(step, parameters, path)
    sine = f" with a sine of {step.sine_n:g} N" if step.sine_n else ""
    for newton in (force for _, force in profile if step.controls):
        if newton - step.sine_n <= parameters.contact_threshold_n:
            raise ValueError(
                f"force_n of {newton:g} N{sine} must be above task.contact_threshold_n of "
                f"{parameters.contact_threshold_n:g} N: with less, the tool is not in contact"
            )
        if newton + step.sine_n >= tight.force_limit_n:
            raise ValueError(
                f"force_n of {newton:g} N{sine} must be below its force limit of {tight.force_limit_n:g} N"
            )
    if not step.watches_way:
        tight = replace(tight, against_travel_n=tight.resultant_limit_n)
    follows = ground.follows or step.orientation == "normal"
    return Leg(
        number=number,
        stroke=replace(ground.stroke, parameters=parameters, force_limit_n=tight.force_limit_n),
        limits=tight,
        profile=profile,
        way=path,
        follows=follows,
        shows_ground=follows and ground.shows_ground,
        phase=step.phase,
        works_aside=step.works_aside,
        turns=step.turns_home or step.orientation != "fixed",
        step=step,
        foreign=not is_ours(step),
    )


def _profile(step: Step, parameters: TaskParameters, path: Way | None) -> tuple[tuple[float, float], ...]:
    """Return pairs of path length, m, and desired force, N."""
    force = step.force_n
    pairs = force if isinstance(force, tuple) else ((0.0, parameters.force_n),)
    profile = tuple((mm * 1e-3, newton) for mm, newton in pairs)
    if path is not None and len(profile) > 1 and profile[-1][0] < path.length - 1e-9:
        end, length = profile[-1][0] * 1e3, path.length * 1e3
        raise ValueError(
            f"force_n ends at {end:g} mm, but the path is {length:.1f} mm long: give the force of its end"
        )
    return profile


def _parameters(task: TaskParameters, step: Step) -> TaskParameters:
    """Return the parameters of the task, overridden by the parameters of the step."""
    changes = {name: value for name, value in step.parameters(task).items() if value is not None}
    force = step.force_n
    if force is not None:
        changes["force_n"] = max(newton for _, newton in force) if isinstance(force, tuple) else force
    contact = changes.get("contact_threshold_n")
    if contact is not None:
        changes["loss_threshold_n"] = min(task.loss_threshold_n, contact)
        if contact >= task.force_n:
            raise ValueError(f"contact_n of {contact:g} N must be below task.force_n of {task.force_n:g} N")
    return replace(task, **changes) if changes else task


def _tighten(limits: Limits, own: StepLimits) -> Limits:
    changes = {}
    for name in own.__slots__:
        value = getattr(own, name)
        if value is None:
            continue
        if value > getattr(limits, name):
            raise ValueError(
                f"limits.{name} of {value:g} exceeds that of the run, {getattr(limits, name):g}: "
                "a step can only tighten a limit"
            )
        changes[name] = value
    return replace(limits, **changes) if changes else limits
