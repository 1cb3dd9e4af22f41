"""The outcome of each step of a program: sums over its samples, and what they say when it ends. Pure."""

from msgspec.structs import replace

from hil_bridge.control.course.stroke import StrokeState
from hil_bridge.control.program.leg import Leg
from hil_bridge.control.program.state import Done, ProgramState, Tally
from hil_bridge.control.types import Measurement
from hil_bridge.errors.causes import Cause, Reason
from protocol.geometry import Vector

ROUNDING = 1e-9
"""Slack for sums of steps, m."""
_BAND_SHARE = 0.1
"""Chosen: share of the wanted force by which it may be off and still counts as held, where no criterion is given."""


def added(found: tuple[Vector, int], place: Vector) -> tuple[Vector, int]:
    (x, y, z), count = found
    return (x + place[0], y + place[1], z + place[2]), count + 1


def count_sample(
    state: ProgramState, leg: Leg, stroke: StrokeState, measurement: Measurement, reference: float
) -> Tally:
    """The sums over a leg with one more sample. `stroke` is the state behind it, `reference` the wanted force, N."""
    tally = state.tally
    if not stroke.in_contact:
        return tally
    amount = measurement.dt if leg.way is None else stroke.travel - state.stroke.travel
    if amount < 0.0:
        amount = 0.0
    force, criterion = measurement.force, leg.step.criterion
    total, pressed = tally.total + amount, tally.force + amount * force
    deep = tally.deep + amount * measurement.position
    if abs(force - reference) <= (reference * _BAND_SHARE if criterion is None else criterion.within_n):
        return Tally(total, tally.within + amount, pressed, deep, stroke.travel - state.base)
    return Tally(total, tally.within, pressed, deep, tally.good)


def outcome(state: ProgramState, leg: Leg, now: float, at: Vector | None = None) -> Done:
    """Outcome of a leg that has ended at this time, s on the run's clock, with the tool at this place."""
    tally, criterion = state.tally, leg.step.criterion
    share = tally.within / tally.total if tally.total and criterion is not None else None
    passed = criterion is None or (share is not None and share * 100 >= criterion.for_percent)
    text = state.text
    if criterion is not None:
        kept = (
            "never in contact"
            if share is None
            else f"{100 * share:.1f} % of the {'time' if leg.way is None else 'way'}"
        )
        text = f"force within ±{criterion.within_n:g} N: {kept}, wanted {criterion.for_percent:g} %"
    (x, y, z), count = state.found
    found = (x / count, y / count, z / count) if count else None
    if leg.step.finds_end:
        found = at
    return Done(
        state.leg,
        now if state.began is None else state.began,
        now,
        state.local,
        tally.force / tally.total if tally.total else None,
        share,
        passed,
        found if leg.step.name else None,
        text,
        tally.good,
    )


def cut(state: ProgramState, leg: Leg, now: float, reason: Reason | None) -> Done:
    """Outcome of a leg that was cut at this time, s on the run's clock."""
    text = "" if reason is None else str(reason)
    return replace(outcome(state, leg, now), passed=False, text=text, found=None)


def ending(state: ProgramState, leg: Leg) -> Reason | None:
    """Why a leg that leads along the surface ended: its time, or its way; None for another leg."""
    if leg.way is None:
        return None
    if leg.step.for_s is not None and state.local < leg.way.length - ROUNDING:
        return Reason(Cause.TIME_IS_UP)
    return Reason(Cause.TRAVELLED, f"travelled {leg.way.length * 1e3:g} mm")
