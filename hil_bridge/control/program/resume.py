"""A program that was cut, from where its force was last within its band. Pure."""

from collections.abc import Sequence
from dataclasses import replace

from hil_bridge.control.course.stroke import Stroke
from hil_bridge.control.geometry.ways import Place, Way
from hil_bridge.control.program.leg import Leg, Row
from hil_bridge.control.steps.approach import Approach
from hil_bridge.control.steps.move import Move
from hil_bridge.control.steps.seam import Step
from hil_bridge.control.steps.settings import ResumePoint
from hil_bridge.control.steps.zero import Zero
from hil_bridge.errors import ConfigError

OVERLAP_MM = 2.0
"""Chosen: part of the path that a resumed run covers once more."""
FIRST = 3
"""Legs that come before the step that was cut: move, zero, approach."""


def resume_row(row: Row, point: ResumePoint, stroke: Stroke) -> Row:
    """Return the rest of a program: over to the place, a zero, an approach, and on.

    Raises ConfigError for a point that is no part of it.
    """
    if not 0 <= point.leg < len(row.legs):
        raise ConfigError(
            f"task.resume: the program has {len(row.legs)} steps, and no number {point.leg + 1}"
        )
    first = row.legs[point.leg]
    move = Move(to_mm=point.place_mm)
    head = [
        _leg(replace(move, speed_mm_s=min(move.speed_mm_s, first.limits.travel_mm_s)), first, stroke),
        _leg(Zero(), first, stroke),
    ]
    if first.step.controls:
        before = next((leg for leg in row.legs[point.leg :: -1] if leg.step.do == "approach"), None)
        head.append(_leg(Approach(), first, stroke) if before is None else before)
    else:  # a zero more: the places of the rest stay the same
        head.append(_leg(Zero(), first, stroke))
    head = [replace(leg, repeat=leg.repeat._replace(leave_to=None, is_first=False)) for leg in head]
    shift = FIRST - point.leg
    rest = [
        leg
        if leg.repeat.leave_to is None
        else replace(leg, repeat=leg.repeat._replace(leave_to=leg.repeat.leave_to + shift))
        for leg in row.legs[point.leg :]
    ]
    rest[0] = _cut(first, point)
    return Row(
        (*head, *rest),
        (None, point.place_mm, point.place_mm, point.place_mm, *row.places[point.leg + 1 :]),
        row.written,
    )


def _leg(step: Step, like: Leg, stroke: Stroke) -> Leg:
    force = stroke.parameters.force_n
    profile = ((0.0, force),)
    return Leg(
        "resume", stroke, like.limits, profile, phase=step.phase, works_aside=step.works_aside, step=step
    )


def _cut(leg: Leg, point: ResumePoint) -> Leg:
    """Return the step without the finished part of its path."""
    done, step = point.way_mm * 1e-3, leg.step.resumed(point.spent_s)
    if leg.way is None or not done:
        return replace(leg, step=step)
    profile = ((0.0, leg.reference(done)), *((at - done, force) for at, force in leg.profile if at > done))
    return replace(leg, step=step, way=rest_of(leg.way, done), profile=profile)


def rest_of(way: Way, done: float) -> Way:
    """Return the path from this length of it on, m, relative to that place; at least its last hair."""
    done = min(done, way.length - 1e-6)
    number, (x, y) = way.piece(done), way.at(done)
    points = [(0.0, 0.0), *((u - x, v - y) for u, v in way.points[number + 1 :])]
    begins = [0.0, *(begin - done for begin in way.begins[number + 1 :])]
    return Way(tuple(points), way.headings[number:], tuple(begins))


def good_until(leg: Leg, samples: Sequence[tuple[Place, float, float]], band_share: float) -> float:
    """Way of a leg, m, until which the force was last within its band.

    `samples` are commanded places relative to its beginning, m, force and wanted force, N, of its cycles in contact.
    """
    if leg.way is None:
        return 0.0
    criterion = leg.step.criterion
    reached = good = 0.0
    for place, force, wanted in samples:
        ahead = min(reached + 0.05, leg.way.length)
        reached = max(reached, leg.way.along(reached, ahead, place))
        band = wanted * band_share if criterion is None else criterion.within_n
        if abs(force - wanted) <= band:
            good = min(reached, leg.way.length)
    return good
