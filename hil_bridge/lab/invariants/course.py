"""Checkers of the promises about the course of a run: orders, speed, guard model, replay and end."""

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
"""Longest time of a run beyond its tracking, s. Chosen: the sum of the timeouts for robot and sensor."""
EXIT_CODES = {
    Outcome.COMPLETED: (COMPLETED, CRITERION),
    Outcome.STOPPED: (STOPPED,),
    Outcome.INTERRUPTED: (INTERRUPTED,),
}
"""Allowed exit codes for each outcome. The code is 4 if a program step did not meet its criterion."""
FASTER_SHARE = 1.5
"""Largest speed of a servo that catches up, as a multiple of its speed limit. Chosen: the guard applies the same
factor to reported positions.
"""
WINDOW_S = 0.1
"""Shortest averaging window of the speed, s. Chosen: longer than the ringing of a servo."""
_MODEL = GuardModel()


def deeper_orders(evidence: Evidence) -> Iterator[Violation]:
    """Yield the order after the stop that went deepest, if any order went deeper than the previous ones."""
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
    """Yield the fastest true motion of the tool if it exceeded the allowed speed."""
    truth = evidence.truth
    if truth is None or truth.positions is None or len(truth.times) < 2:
        return
    later = np.searchsorted(truth.times, truth.times + WINDOW_S)
    first = np.flatnonzero(later < len(truth.times))
    if not len(first):
        return
    distance = np.linalg.norm(truth.positions[later[first]] - truth.positions[first], axis=1)
    speeds = distance / (truth.times[later[first]] - truth.times[first])
    place, allowed = int(np.argmax(speeds)), evidence.config.robot.velocity_mm_s * 1e-3 * FASTER_SHARE
    if speeds[place] > allowed:
        figures = {"true_mm_s": float(speeds[place]) * 1e3, "allowed_mm_s": allowed * 1e3}
        yield Violation(Promise.SPEED, float(truth.times[first[place]]), figures)


def gate_stops(evidence: Evidence) -> Iterator[Violation]:
    """Yield the first order that the last gate stopped, if any."""
    for event in evidence.recording.events:
        if event.cause is Cause.GATE:
            yield Violation(Promise.GATE, event.at, {})
            return


def bugs(evidence: Evidence) -> Iterator[Violation]:
    """Yield the first unexpected exception, if any."""
    for event in evidence.recording.events:
        if event.kind == EventKind.BUG:
            yield Violation(Promise.BUG, event.at, {})
            return


def incomplete_recordings(evidence: Evidence) -> Iterator[Violation]:
    """Yield a violation if the recording is truncated, or the run did not end in time."""
    recording = evidence.recording
    times = [event.at for event in recording.events]
    lasted = times[-1] - times[0] if times else 0.0
    program = bool(evidence.config.task.step)  # the duration of a program is unknown here
    late = not program and lasted > evidence.config.run.duration_s + LONGEST_S
    if recording.truncated or not recording.end or late:
        yield Violation(Promise.WHOLE, math.nan, {"lasted_s": lasted})


def contradicting_exit_codes(evidence: Evidence) -> Iterator[Violation]:
    """Yield a violation if the exit code contradicts the recording."""
    code, outcome = evidence.exit_code, evidence.recording.end.get("outcome")
    if code is None or outcome is None:
        return
    if code not in EXIT_CODES[Outcome(outcome)]:
        yield Violation(Promise.EXIT, math.nan, {"code": float(code)})


def other_decisions(evidence: Evidence) -> Iterator[Violation]:
    """Yield the first cycle whose replay differs, with the number of all such cycles."""
    others = [
        cycle.record
        for cycle in replay(evidence.recording, evidence.config, forced=False)
        if cycle.differences
    ]
    if others:
        yield Violation(Promise.REPLAY, others[0].started_at, {"cycles": float(len(others))})


def unaccepted_cycles(evidence: Evidence) -> Iterator[Violation]:
    """Yield the first cycle that the model does not accept, or the end of the run, with what the recording contains
    there.
    """
    unaccepted = first_unaccepted(evidence.recording, _MODEL)
    if unaccepted is not None:
        detail = _detail(unaccepted, evidence.recording.end)
        yield Violation(Promise.MODEL, unaccepted.at, {"cycle": float(unaccepted.cycle)}, detail=detail)


def _detail(unaccepted: Unaccepted, end: Mapping[str, str]) -> str:
    """Describe a cycle by phase, causes and order, or the end of the run by outcome and cause."""
    cycle = unaccepted.shown
    if cycle is None:
        outcome, cause = end["outcome"], end.get("cause") or "none"
        return f"the end of the run after {unaccepted.cycle} cycles (outcome: {outcome}; cause: {cause})"
    causes = ", ".join(cycle.causes) or "none"
    order = f"{cycle.way.name.lower()}, clamped" if cycle.held else cycle.way.name.lower()
    return f"cycle {unaccepted.cycle} (phase: {cycle.phase}; causes: {causes}; order: {order})"
