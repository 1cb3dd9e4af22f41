"""Remaining part of an interrupted program, from the point up to which its force was last within its band. Pure."""

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
"""Length of the path that a resumed run covers again, mm. Chosen."""
FIRST = 3
"""Number of legs before the interrupted step: move, zero and approach."""


def resume_row(row: Row, point: ResumePoint, stroke: Stroke) -> Row:
    """Return the remaining program: a move to the point, a zero, an approach, and the remaining steps.

    Raises ConfigError for a point that is not part of the program.
    """
    if not 0 <= point.leg < len(row.legs):
        raise ConfigError(
            f"task.resume: the program has {len(row.legs)} steps, but no number {point.leg + 1}"
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
    else:  # one more zero, so that the indices of the rest stay the same
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
    """Return the step without the part of its path that is already finished."""
    done, step = point.way_mm * 1e-3, leg.step.resumed(point.spent_s)
    if leg.way is None or not done:
        return replace(leg, step=step)
    profile = ((0.0, leg.reference(done)), *((at - done, force) for at, force in leg.profile if at > done))
    return replace(leg, step=step, way=rest_of(leg.way, done), profile=profile)


def rest_of(path: Way, done: float) -> Way:
    """Return the path from the given path length on, m, relative to the point there. At least a short last segment
    remains.
    """
    done = min(done, path.length - 1e-6)
    number, (x, y) = path.piece(done), path.at(done)
    points = [(0.0, 0.0), *((u - x, v - y) for u, v in path.points[number + 1 :])]
    begins = [0.0, *(begin - done for begin in path.begins[number + 1 :])]
    return Way(tuple(points), path.headings[number:], tuple(begins))


def good_until(leg: Leg, samples: Sequence[tuple[Place, float, float]], band_share: float) -> float:
    """Return the path length of a leg up to which the force was last within its band, m.

    `samples` holds, for each cycle in contact, the commanded position relative to the start of the leg, m, the
    force and the desired force, N.
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
