"""Promises about the course of a run: orders, speed, guard model, replay and end."""

import math
from collections.abc import Iterator, Mapping

import numpy as np

from hil_bridge.errors.cause_row import COMPLETED, CRITERION, INTERRUPTED, STOPPED
from hil_bridge.errors.causes import Cause
from hil_bridge.lab.invariants.evidence import Evidence, Promise, Violation
from hil_bridge.lab.invariants.model import GuardModel
from hil_bridge.lab.invariants.tracing import ROUNDING_M, Unaccepted, first_unaccepted
from hil_bridge.record import EventKind, Outcome
from hil_bridge.runs.replay import replay

LONGEST_S = 400.0
"""Chosen: allowed time of a run beyond its tracking, s: the sum of its timeouts for robot and sensor."""
EXIT_CODES = {
    Outcome.COMPLETED: (COMPLETED, CRITERION),
    Outcome.STOPPED: (STOPPED,),
    Outcome.INTERRUPTED: (INTERRUPTED,),
}
"""Exit codes for each outcome; 4 if a program step did not meet its criterion."""
FASTER_SHARE = 1.5
"""Chosen: allowed speed factor of a servo that catches up; the guard judges reported positions by the same."""
WINDOW_S = 0.1
"""Chosen: shortest averaging time of the speed, s: a servo rings in less."""
_MODEL = GuardModel()


def deeper_orders(evidence: Evidence) -> Iterator[Violation]:
    """Yield the deepest order after the stop, if any went deeper."""
    recording = evidence.recording
    stopped = next((event.at for event in recording.events if event.kind == EventKind.STOP), math.inf)
    after = [cycle for cycle in recording.cycles if cycle.answered_at >= stopped]
    worst, lowest = None, math.inf
    for cycle in after:
        deeper = cycle.depth_commanded - lowest
        if deeper > ROUNDING_M and (worst is None or deeper > worst[0]):
            worst = deeper, cycle.sent_at
        lowest = min(lowest, cycle.depth_commanded)
    if worst is not None:
        deeper, at = worst
        yield Violation(Promise.ORDERS, at, {"deeper_mm": deeper * 1e3, "after_s": at - stopped})


def too_fast(evidence: Evidence) -> Iterator[Violation]:
    """Yield the fastest true motion of the tool, if it was too fast."""
    truth = evidence.truth
    if truth is None or truth.positions is None or len(truth.times) < 2:
        return
    later = np.searchsorted(truth.times, truth.times + WINDOW_S)
    first = np.flatnonzero(later < len(truth.times))
    if not len(first):
        return
    way = np.linalg.norm(truth.positions[later[first]] - truth.positions[first], axis=1)
    speeds = way / (truth.times[later[first]] - truth.times[first])
    place, allowed = int(np.argmax(speeds)), evidence.config.robot.velocity_mm_s * 1e-3 * FASTER_SHARE
    if speeds[place] > allowed:
        figures = {"true_mm_s": float(speeds[place]) * 1e3, "allowed_mm_s": allowed * 1e3}
        yield Violation(Promise.SPEED, float(truth.times[first[place]]), figures)


def gate_stops(evidence: Evidence) -> Iterator[Violation]:
    """Yield the first order that the last gate stopped."""
    for event in evidence.recording.events:
        if event.cause is Cause.GATE:
            yield Violation(Promise.GATE, event.at, {})
            return


def bugs(evidence: Evidence) -> Iterator[Violation]:
    """Yield the first unexpected exception."""
    for event in evidence.recording.events:
        if event.kind == EventKind.BUG:
            yield Violation(Promise.BUG, event.at, {})
            return


def unwhole(evidence: Evidence) -> Iterator[Violation]:
    """Yield a truncated recording, and a run that did not end in time."""
    recording = evidence.recording
    times = [event.at for event in recording.events]
    lasted = times[-1] - times[0] if times else 0.0
    program = bool(evidence.config.task.step)  # its own time is not known from here
    late = not program and lasted > evidence.config.run.duration_s + LONGEST_S
    if recording.truncated or not recording.end or late:
        yield Violation(Promise.WHOLE, math.nan, {"lasted_s": lasted})


def unfit_codes(evidence: Evidence) -> Iterator[Violation]:
    """Yield an exit code that contradicts the recording."""
    code, outcome = evidence.exit_code, evidence.recording.end.get("outcome")
    if code is None or outcome is None:
        return
    if code not in EXIT_CODES[Outcome(outcome)]:
        yield Violation(Promise.EXIT, math.nan, {"code": float(code)})


def other_decisions(evidence: Evidence) -> Iterator[Violation]:
    """Yield the first cycle whose replay differs, with their number."""
    others = [
        cycle.record
        for cycle in replay(evidence.recording, evidence.config, forced=False)
        if cycle.differences
    ]
    if others:
        yield Violation(Promise.REPLAY, others[0].started_at, {"cycles": float(len(others))})


def unaccepted_cycles(evidence: Evidence) -> Iterator[Violation]:
    """Yield the first cycle, or the end, that the model does not accept, and what the recording shows there."""
    found = first_unaccepted(evidence.recording, _MODEL)
    if found is not None:
        detail = _detail(found, evidence.recording.end)
        yield Violation(Promise.MODEL, found.at, {"cycle": float(found.cycle)}, detail=detail)


def _detail(found: Unaccepted, end: Mapping[str, str]) -> str:
    """Return the phase, the causes and the order of a cycle, or the outcome and the cause of the end, as text."""
    shown = found.shown
    if shown is None:
        outcome, cause = end["outcome"], end.get("cause") or "none"
        return f"the end of the run after {found.cycle} cycles (outcome: {outcome}; cause: {cause})"
    causes = ", ".join(shown.causes) or "none"
    order = f"{shown.way.name.lower()}, clamped" if shown.held else shown.way.name.lower()
    return f"cycle {found.cycle} (phase: {shown.phase}; causes: {causes}; order: {order})"
