"""Reports on the steps of a program: one record and one line of text for each."""

from collections.abc import Callable
from typing import Protocol

from hil_bridge.clock import Clock
from hil_bridge.control.course.state import Done
from hil_bridge.control.program.leg import Leg
from hil_bridge.control.program.outcome import cut
from hil_bridge.control.program.program import Program
from hil_bridge.control.program.state import ProgramState
from hil_bridge.errors.causes import Reason
from hil_bridge.record import EventKind
from hil_bridge.record.records import StepRecord


class StepLog(Protocol):
    """Part of a run's log that steps need."""

    def step(self, record: StepRecord) -> None:
        """Report a step of a program that has ended."""


class StepReporter:
    """Reporter of each completed step of a program. It reports nothing for a run without a user's program."""

    def __init__(
        self, program: Program, clock: Clock, log: StepLog, event: Callable[[str, str], None]
    ) -> None:
        """Create the reporter. `event` is called with the kind and the text of an event."""
        self.legs: tuple[Leg, ...] = program.row.legs if program.row.written else ()
        """All steps of the user's program, including every pass of a repeat; empty without a program."""
        self._clock, self._log, self._event = clock, log, event
        self._count = 0
        """Number of steps reported so far."""

    def number(self, leg: int) -> int:
        """Return the number of a step in the record, from 1; 0 for a step that the user did not write."""
        return leg + 1 if self.legs else 0

    def ended(self, state: ProgramState) -> None:
        """Report the steps that have ended since the last cycle."""
        if not self.legs or len(state.course.done) == self._count:
            return
        for done in state.course.done[self._count :]:
            self._report(done)
        self._count = len(state.course.done)

    def cut(self, state: ProgramState, reason: Reason | None, at: float | None = None) -> None:
        """Report the step that was in progress when the run could no longer decide. `at` is the time, s; None
        stands for the current time.
        """
        if self.legs and state.course.began is not None:
            now = self._clock.now() if at is None else at
            self._report(cut(state, self.legs[state.course.leg], now, reason))

    def _report(self, done: Done) -> None:
        leg = self.legs[done.leg]
        self._log.step(step_record(leg, done))
        self._event(EventKind.STEP, describe_step(leg, done))


def step_record(leg: Leg, done: Done) -> StepRecord:
    """Return the record of a step that has ended."""
    criterion = leg.step.criterion
    return StepRecord(
        at=done.ended,
        step=done.leg + 1,
        label=leg.label,
        began_at=done.began,
        way=done.way,
        force_mean=done.force_mean,
        within=done.within,
        wanted=None if criterion is None else criterion.for_percent / 100,
        passed=done.passed,
        name=leg.step.name,
        found=done.found or (),
        text=done.text,
        resumable=done.resumable,
        word=leg.step.do,
        repeat=leg.repeat.number,
        turn=leg.repeat.turn,
        number=leg.number,
    )


def describe_step(leg: Leg, done: Done) -> str:
    """Return a one-line description of a step that has ended."""
    parts = [f"{done.ended - done.began:.1f} s"]
    if done.way:
        parts.append(f"{done.way * 1e3:.1f} mm")
    if done.force_mean is not None and leg.way is not None:
        parts.append(f"{done.force_mean:.2f} N on average")
    if done.found is not None:
        x, y, z = (part * 1e3 for part in done.found)
        parts.append(f"{leg.step.name} at {x:.2f} {y:.2f} {z:.2f} mm")
    if done.text:
        parts.append(done.text)
    verdict = "done" if done.passed else "FAILED"
    return f"{leg.label} {verdict}: {', '.join(parts)}"
