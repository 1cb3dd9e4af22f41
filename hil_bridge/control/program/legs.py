"""A program made ready: its steps in one row, each with the task that carries it out; checked before anything moves."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.parameters import TaskParameters
from hil_bridge.control.course.task import Task
from hil_bridge.control.words.paths import Line, Place, Way, way_of
from hil_bridge.control.words.steps import (
    Approach,
    ForceProfile,
    Hold,
    Move,
    Repeat,
    Retract,
    Seek,
    Step,
    StepLimits,
    Track,
    Zero,
)
from hil_bridge.errors import StepError

LEGS_MAX = 5000
"""Chosen: most steps of a program, passes counted."""
_NEAR_MM = 0.01
"""Chosen: a path that begins no farther from the tool begins there."""


@dataclass(frozen=True, slots=True)
class Leg:
    """One step, in one pass."""

    number: str
    """As a person counts: "3", or "3.1" within a repeat."""
    step: Any
    """Its settings."""
    stroke: Task
    """The task with the step's own parameters."""
    limits: Limits
    """Limits of the run, tightened by the step."""
    profile: tuple[tuple[float, float], ...]
    """Way in m and wanted force in N."""
    way: Way | None = None
    """Path of a track or seek, relative to where it begins; of a move, None."""
    leave_to: int | None = None
    """Number of the leg behind the repeat, at the last leg of a pass; None elsewhere."""
    removed: float | None = None
    """Depth removed, m, at which the repeat is left there; None where all passes are made."""
    first_of_repeat: bool = False
    """The first leg of the first pass: the depths are counted from here."""
    repeat: int = 0
    """Number of the repeat that it belongs to, as a person counts; 0 for none."""
    turn: int = 0
    """Its pass in that repeat, from 1; 0 for none."""

    @property
    def label(self) -> str:
        """Its number and its word: "3 (track)"."""
        return _label(self.number, self.step, self.turn)

    def reference(self, travel: float) -> float:
        """Wanted force at this length of the way, m; N."""
        profile = self.profile
        if len(profile) == 1 or travel <= profile[0][0]:
            return profile[0][1]
        for (begin, low), (end, high) in pairwise(profile):
            if travel < end:
                return low + (high - low) * (travel - begin) / (end - begin)
        return profile[-1][1]

    @property
    def presses(self) -> bool:
        """Whether the tool is in contact at its end."""
        step = self.step
        return isinstance(step, (Approach, Track, Hold)) or (isinstance(step, Seek) and step.until == "edge")


@dataclass(frozen=True, slots=True)
class Row:
    """The legs of a program, and where they lead."""

    legs: tuple[Leg, ...]
    places: tuple[Place | None, ...]
    """Where each leg begins in the work frame, mm; None where that is known in the run alone."""


def legs_of(
    steps: tuple[Step, ...], task: Task, limits: Limits, origin_known: bool, speed_mm_s: float
) -> Row:
    """The steps in one row. `task` has the run's own parameters. `origin_known`: paths count from a given place, not
    from the start point. `speed_mm_s` is the robot's path velocity.

    Raises ConfigError with the number of the first step that cannot be.
    """
    legs: list[Leg] = []
    places: list[Place | None] = []
    place: Place | None = None if origin_known else (0.0, 0.0)
    presses, back_mm = False, 0.0
    for number, step, more in _flat(steps):
        if len(legs) >= LEGS_MAX:
            raise StepError(f"more than {LEGS_MAX} steps, with the passes of a repeat")
        try:
            _check(step, presses, limits, speed_mm_s)
            leg = _leg(number, step, task, limits, place)
        except ValueError as error:
            raise StepError(str(error), _label(number, step, more.get("turn", 0))) from error
        if isinstance(step, Approach) and step.at_most_mm is None:
            leg = _reaching(leg, back_mm)
        back_mm = _measure_back(leg, back_mm)
        leg = replace(leg, **more)
        legs.append(leg)
        places.append(place)
        presses = leg.presses
        place = _end(leg, place)
    if presses or not legs:
        raise StepError("the last step must be a retract, so that no program ends pressing")
    return Row(tuple(legs), tuple(places))


def _reaching(leg: Leg, back_mm: float) -> Leg:
    """An approach that goes deeper by the way that the tool has come back before it, mm."""
    parameters = leg.stroke.parameters
    deeper = replace(parameters, approach_depth_limit_mm=parameters.approach_depth_limit_mm + back_mm)
    return replace(leg, stroke=replace(leg.stroke, parameters=deeper))


def _measure_back(leg: Leg, back_mm: float) -> float:
    """How far the tool has come back from the surface behind this leg, at most, mm."""
    parameters = leg.stroke.parameters
    match leg.step:
        case Retract():
            return parameters.retract_mm
        case Move():
            return max(back_mm, parameters.safe_height_mm)
        case _:
            return 0.0 if leg.presses else back_mm


def _flat(steps: tuple[Step, ...]) -> Iterator[tuple[str, Any, dict[str, Any]]]:
    """Each step of each pass with its number, and what a leg must know of its repeat."""
    count = 0
    for number, step in enumerate(steps, 1):
        if not isinstance(step, Repeat):
            yield f"{number}", step, {}
            count += 1
            continue
        inner = len(step.step)
        behind = count + step.times * inner
        removed = None if step.until_removed_mm is None else step.until_removed_mm * 1e-3
        for turn in range(step.times):
            for place, one in enumerate(step.step):
                last = place == inner - 1
                more = {
                    "leave_to": behind if last else None,
                    "removed": removed,
                    "first_of_repeat": not turn and not place,
                    "repeat": number,
                    "turn": turn + 1,
                }
                yield f"{number}.{place + 1}", one, more
                count += 1


def _label(number: str, step: Any, turn: int) -> str:
    return f"{number} ({step.do}{(turn and f', pass {turn}') or ''})"


def _leg(number: str, step: Any, task: Task, limits: Limits, place: Place | None) -> Leg:
    way = None
    if isinstance(step, Track):
        corners = step.path.corners(place)
        _check_begin(corners[0], place, step)
        way = way_of(corners)
    elif isinstance(step, Seek):
        way = way_of(Line(length_mm=step.at_most_mm, direction_deg=step.direction_deg).corners((0.0, 0.0)))
    parameters = _parameters(task.parameters, step, way)
    given: ForceProfile | None = getattr(step, "force_n", None)
    pairs = ((0.0, parameters.force_n),) if not isinstance(given, tuple) else given
    profile = tuple((mm * 1e-3, newton) for mm, newton in pairs)
    if way is not None and len(profile) > 1 and profile[-1][0] < way.length - 1e-9:
        end, length = profile[-1][0] * 1e3, way.length * 1e3
        raise ValueError(
            f"force_n ends at {end:g} mm, but the path is {length:.1f} mm long: give the force of its end"
        )
    tight = _tighten(limits, step.limits)
    controls = isinstance(step, (Track, Hold)) or getattr(step, "until", "") == "edge"
    for newton in (force for _, force in profile if controls):
        if newton <= parameters.contact_threshold_n:
            raise ValueError(
                f"force_n of {newton:g} N must be above task.contact_threshold_n of "
                f"{parameters.contact_threshold_n:g} N: with less the tool does not touch"
            )
        if newton >= tight.force_limit_n:
            raise ValueError(
                f"force_n of {newton:g} N must be below its force limit of {tight.force_limit_n:g} N"
            )
    stroke = replace(task, parameters=parameters, force_limit_n=tight.force_limit_n)
    return Leg(number, step, stroke, tight, profile, way)


def _parameters(task: TaskParameters, step: Any, way: Way | None) -> TaskParameters:
    """The task's parameters with those of the step."""
    changes: dict[str, Any] = {}

    def take(name: str, value: object) -> None:
        if value is not None:
            changes[name] = value

    match step:
        case Approach():
            take("approach_speed_mm_s", step.speed_mm_s)
            take("contact_threshold_n", step.contact_n)
            take("approach_depth_limit_mm", step.at_most_mm)
        case Track():
            take("speed_mm_s", step.speed_mm_s)
        case Hold():
            take("speed_mm_s", 0.0)
        case Seek():
            take("speed_mm_s", step.speed_mm_s or task.approach_speed_mm_s)
            take("contact_threshold_n", step.contact_n)
        case Retract():
            take("retract_mm", step.back_mm)
            take("retract_speed_mm_s", step.speed_mm_s)
    if way is not None:
        take("travel_limit_mm", way.length * 1e3)
    force: ForceProfile | None = getattr(step, "force_n", None)
    if force is not None:
        take("force_n", max(newton for _, newton in force) if isinstance(force, tuple) else force)
    if (contact := changes.get("contact_threshold_n")) is not None:
        take("loss_threshold_n", min(task.loss_threshold_n, contact))
        if contact >= task.force_n:
            raise ValueError(f"contact_n of {contact:g} N must be below task.force_n of {task.force_n:g} N")
    return replace(task, **changes)


def _tighten(limits: Limits, own: StepLimits) -> Limits:
    changes = {}
    for name in own.__slots__:
        value = getattr(own, name)
        if value is None:
            continue
        if value > getattr(limits, name):
            raise ValueError(
                f"limits.{name} of {value:g} is wider than that of the run, {getattr(limits, name):g}: "
                "a step can only be stricter"
            )
        changes[name] = value
    return replace(limits, **changes)


def _check(step: Any, presses: bool, limits: Limits, speed_mm_s: float) -> None:
    """Raise ValueError for a step that cannot follow the one before, or that is faster than it may be."""
    match step:
        case Track() | Hold():
            if not presses:
                raise ValueError("the tool does not press here: let an approach come before")
        case Seek(until="edge"):
            if not presses:
                raise ValueError("an edge is sought while pressing: let an approach come before")
        case Move() | Zero() | Seek() | Approach():
            if presses:
                raise ValueError("the tool presses here: let a retract come before")
    speed = getattr(step, "speed_mm_s", None)
    if speed is None:
        return
    if speed > speed_mm_s:
        raise ValueError(
            f"speed_mm_s of {speed:g} is faster than the robot's path velocity: lower it, or set "
            f"robot.velocity_mm_s, now {speed_mm_s:g}"
        )
    across = step.limits.travel_mm_s or limits.travel_mm_s
    if isinstance(step, (Track, Move, Seek)) and speed > across:
        raise ValueError(f"speed_mm_s of {speed:g} is above limits.travel_mm_s of {across:g}")
    if isinstance(step, Approach) and speed > (step.limits.correction_mm_s or limits.correction_mm_s):
        raise ValueError(f"speed_mm_s of {speed:g} is above limits.correction_mm_s")


def _check_begin(begin: Place, place: Place | None, step: Track) -> None:
    if isinstance(step.path, Line) and step.path.to_mm is None:
        return
    if place is None:
        raise ValueError(
            f"the path begins at {begin[0]:g}, {begin[1]:g} mm, but the tool's place is not known here: "
            "let a move come before"
        )
    if math.dist(begin, place) > _NEAR_MM:
        raise ValueError(
            f"the path begins at {begin[0]:g}, {begin[1]:g} mm, but the tool is at {place[0]:g}, {place[1]:g} mm: "
            "let a move come before"
        )


def _end(leg: Leg, place: Place | None) -> Place | None:
    """Where the tool is at the end of a leg, mm; None where only the run knows."""
    step = leg.step
    if isinstance(step, Move):
        return step.to_mm
    if isinstance(step, Seek) or (isinstance(step, Track) and (step.for_s or step.across != "position")):
        return None
    if leg.way is None or place is None:
        return place
    x, y = leg.way.points[-1]
    return place[0] + x * 1e3, place[1] + y * 1e3


def seconds(row: Row) -> list[float]:
    """Time that each leg takes about, s: without the corners that are taken slower."""
    taken = []
    for leg, place in zip(row.legs, row.places, strict=True):
        step, task = leg.step, leg.stroke.parameters
        match step:
            case Track():
                assert leg.way is not None
                speed = task.speed_mm_s * 1e-3
                along = leg.way.length / speed if speed else math.inf
                time = min(along, step.for_s or math.inf)
            case Hold():
                time = step.for_s
            case Seek():
                time = step.at_most_mm / task.speed_mm_s
            case Move():
                time = math.dist(place, step.to_mm) / step.speed_mm_s if place else 1.0
            case Zero():
                time = (step.settle_ms + step.for_ms) * 1e-3
            case Retract():
                time = task.retract_mm / task.retract_speed_mm_s
            case _:
                time = task.approach_depth_limit_mm / task.approach_speed_mm_s / 4
        if not math.isfinite(time):
            raise StepError("it never ends; give speed_mm_s above 0, or for_s", leg.label)
        taken.append(time)
    return taken
