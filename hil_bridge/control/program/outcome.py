"""Outcome of each step of a program, from its accumulated sums. Pure."""

from msgspec.structs import replace

from hil_bridge.control.course.state import Done
from hil_bridge.control.geometry.ways import ROUNDING
from hil_bridge.control.program.leg import Leg
from hil_bridge.control.program.state import ProgramState
from hil_bridge.errors.causes import Cause, Reason
from hil_bridge.errors.rounding import three_digits
from protocol.geometry import Vector


def outcome(state: ProgramState, leg: Leg, now: float, at: Vector | None = None) -> Done:
    """Return the outcome of a leg that ended at the given time (s on the run's clock) and tool position."""
    course, step, criterion = state.course, state.step, leg.step.criterion
    tally = step.tally
    share = tally.within / tally.total if tally.total and criterion is not None else None
    passed = criterion is None or (share is not None and share * 100 >= criterion.for_percent)
    text = step.text
    if criterion is not None:
        kept = "never in contact"
        if share is not None:
            percent = three_digits(100 * share, [criterion.for_percent])
            kept = f"{percent} % of the {'time' if leg.way is None else 'path'}"
        text = f"force within ±{criterion.within_n:g} N: {kept}, required {criterion.for_percent:g} %"
    (x, y, z), count = step.found
    position_sum = (x / count, y / count, z / count) if count else None
    if leg.step.finds_end:
        position_sum = at
    return Done(
        leg=course.leg,
        began=now if course.began is None else course.began,
        ended=now,
        way=step.local,
        force_mean=tally.force / tally.total if tally.total else None,
        within=share,
        passed=passed,
        found=position_sum if leg.step.name else None,
        text=text,
        resumable=tally.good,
    )


def cut(state: ProgramState, leg: Leg, now: float, reason: Reason | None) -> Done:
    """Return the outcome of a leg that was interrupted at the given time, s on the run's clock."""
    text = "" if reason is None else str(reason)
    return replace(outcome(state, leg, now), passed=False, text=text, found=None)


def ending(state: ProgramState, leg: Leg) -> Reason | None:
    """Return what ended a leg along the surface: its time or the end of its path; None for any other leg."""
    if leg.way is None:
        return None
    if leg.step.for_s is not None and state.step.local < leg.way.length - ROUNDING:
        return Reason(Cause.TIME_IS_UP)
    return Reason(Cause.TRAVELLED, f"travelled {leg.way.length * 1e3:g} mm")
