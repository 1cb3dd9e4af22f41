"""The course of a run: the last gate silent, no bug, ended in time with a whole recording, an exit code that fits."""

import math
from collections.abc import Iterator

from hil_bridge.errors.cause_row import COMPLETED, CRITERION, INTERRUPTED, STOPPED
from hil_bridge.errors.causes import Cause
from hil_bridge.lab.invariants.evidence import Evidence, Promise, Violation
from hil_bridge.record import EventKind, Outcome

LONGEST_S = 400.0
"""Chosen: a run may last so much longer than its tracking, s: all the patience that it has with robot and sensor."""
EXIT_CODES = {
    Outcome.COMPLETED: (COMPLETED, CRITERION),
    Outcome.STOPPED: (STOPPED,),
    Outcome.INTERRUPTED: (INTERRUPTED,),
}
"""Exit codes that fit an outcome; 4 where a step of a program did not meet its criterion."""


def gate_stops(evidence: Evidence) -> Iterator[Violation]:
    """The first order that the last gate stopped."""
    for event in evidence.recording.events:
        if event.cause is Cause.GATE:
            yield Violation(Promise.GATE, event.at, {})
            return


def bugs(evidence: Evidence) -> Iterator[Violation]:
    """The first exception that nothing expected."""
    for event in evidence.recording.events:
        if event.kind == EventKind.BUG:
            yield Violation(Promise.BUG, event.at, {})
            return


def unwhole(evidence: Evidence) -> Iterator[Violation]:
    """A recording that is cut, and a run that did not end in time."""
    recording = evidence.recording
    times = [event.at for event in recording.events]
    lasted = times[-1] - times[0] if times else 0.0
    program = bool(evidence.config.task.step)  # its own time is not known from here
    late = not program and lasted > evidence.config.run.duration_s + LONGEST_S
    if recording.truncated or not recording.end or late:
        yield Violation(Promise.WHOLE, math.nan, {"lasted_s": lasted})


def unfit_codes(evidence: Evidence) -> Iterator[Violation]:
    """An exit code that says something else than the recording."""
    code, outcome = evidence.exit_code, evidence.recording.end.get("outcome")
    if code is None or outcome is None:
        return
    if code not in EXIT_CODES[Outcome(outcome)]:
        yield Violation(Promise.EXIT, math.nan, {"code": float(code)})
