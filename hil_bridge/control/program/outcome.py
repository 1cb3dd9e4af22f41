"""The outcome of each step of a program: sums over its samples, and what they say when it ends. Pure."""

from msgspec.structs import replace

from hil_bridge.control.course.task import TaskState
from hil_bridge.control.program.legs import Leg
from hil_bridge.control.program.state import CourseState, Done, Tally
from hil_bridge.control.types import Measurement
from hil_bridge.errors.causes import Reason
from protocol.geometry import Vector

_BAND_SHARE = 0.1
"""Chosen: share of the wanted force by which it may be off and still counts as held, where no criterion is given."""


def added(found: tuple[Vector, int], place: Vector) -> tuple[Vector, int]:
    (x, y, z), count = found
    return (x + place[0], y + place[1], z + place[2]), count + 1


def count_sample(
    course: CourseState, leg: Leg, before: TaskState, after: TaskState, measurement: Measurement
) -> CourseState:
    """The sums over a leg, with one more sample."""
    if not after.in_contact:
        return course
    moved = after.travel - before.travel
    amount = measurement.dt if leg.way is None else max(moved, 0.0)
    local = after.travel - course.base
    criterion = getattr(leg.step, "criterion", None)
    reference = leg.reference(max(local, 0.0))
    band = reference * _BAND_SHARE if criterion is None else criterion.within_n
    within = abs(measurement.force - reference) <= band
    tally = course.tally
    tally = Tally(
        tally.total + amount,
        tally.within + (amount if within else 0.0),
        tally.force + amount * measurement.force,
        tally.deep + amount * measurement.position,
        local if within else tally.good,
    )
    deep, way = course.this_pass
    if leg.way is not None:
        deep, way = deep + amount * measurement.position, way + amount
    return replace(course, tally=tally, this_pass=(deep, way))


def done(course: CourseState, leg: Leg, now: float, at: Vector | None = None) -> Done:
    """Outcome of a leg that has ended at this time, s on the run's clock, with the tool at this place."""
    tally, criterion = course.tally, getattr(leg.step, "criterion", None)
    share = tally.within / tally.total if tally.total and criterion is not None else None
    passed = criterion is None or (share is not None and share * 100 >= criterion.for_percent)
    text = ""
    if criterion is not None:
        kept = (
            "never in contact"
            if share is None
            else f"{100 * share:.1f} % of the {'time' if leg.way is None else 'way'}"
        )
        text = f"force within ±{criterion.within_n:g} N: {kept}, wanted {criterion.for_percent:g} %"
    (x, y, z), count = course.found
    found = (x / count, y / count, z / count) if count else None
    if leg.step.do == "approach" and leg.step.name:
        found = at
    return Done(
        course.leg,
        now if course.began is None else course.began,
        now,
        course.local,
        tally.force / tally.total if tally.total else None,
        share,
        passed,
        found if getattr(leg.step, "name", "") else None,
        text,
        tally.good,
    )


def cut(course: CourseState, leg: Leg, now: float, reason: Reason | None) -> Done:
    """Outcome of a leg that was cut at this time, s on the run's clock."""
    text = "" if reason is None else str(reason)
    return replace(done(course, leg, now), passed=False, text=text, found=None)
