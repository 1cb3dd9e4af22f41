"""The outcome of each step of a program: what its sums say when it ends. Pure."""

from msgspec.structs import replace

from hil_bridge.control.course.state import Done
from hil_bridge.control.geometry.ways import ROUNDING
from hil_bridge.control.program.leg import Leg
from hil_bridge.control.program.state import ProgramState
from hil_bridge.errors.causes import Cause, Reason
from protocol.geometry import Vector


def outcome(state: ProgramState, leg: Leg, now: float, at: Vector | None = None) -> Done:
    """Outcome of a leg that has ended at this time, s on the run's clock, with the tool at this place."""
    course, step, criterion = state.course, state.step, leg.step.criterion
    tally = step.tally
    share = tally.within / tally.total if tally.total and criterion is not None else None
    passed = criterion is None or (share is not None and share * 100 >= criterion.for_percent)
    text = step.text
    if criterion is not None:
        kept = (
            "never in contact"
            if share is None
            else f"{100 * share:.1f} % of the {'time' if leg.way is None else 'way'}"
        )
        text = f"force within ±{criterion.within_n:g} N: {kept}, wanted {criterion.for_percent:g} %"
    (x, y, z), count = step.found
    found = (x / count, y / count, z / count) if count else None
    if leg.step.finds_end:
        found = at
    return Done(
        leg=course.leg,
        began=now if course.began is None else course.began,
        ended=now,
        way=step.local,
        force_mean=tally.force / tally.total if tally.total else None,
        within=share,
        passed=passed,
        found=found if leg.step.name else None,
        text=text,
        resumable=tally.good,
    )


def cut(state: ProgramState, leg: Leg, now: float, reason: Reason | None) -> Done:
    """Outcome of a leg that was cut at this time, s on the run's clock."""
    text = "" if reason is None else str(reason)
    return replace(outcome(state, leg, now), passed=False, text=text, found=None)


def ending(state: ProgramState, leg: Leg) -> Reason | None:
    """Why a leg that leads along the surface ended: its time, or its way; None for another leg."""
    if leg.way is None:
        return None
    if leg.step.for_s is not None and state.step.local < leg.way.length - ROUNDING:
        return Reason(Cause.TIME_IS_UP)
    return Reason(Cause.TRAVELLED, f"travelled {leg.way.length * 1e3:g} mm")
