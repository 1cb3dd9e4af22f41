"""Events of a run outside its cycles: phases, checks, and causes with their tracebacks. Each is logged once."""

import math

from msgspec.structs import replace

from hil_bridge.clock import Clock, Heartbeat
from hil_bridge.errors import BridgeError, Cause, Reason
from hil_bridge.errors.failures import CodeFailed, traceback_of
from hil_bridge.record import EventKind, EventRecord
from hil_bridge.record.ending import Check
from hil_bridge.runs.ending import Ending, Stimulus
from hil_bridge.runs.watchers import Log


class Journal:
    """Events of one run, and the causes of its end."""

    def __init__(self, clock: Clock, log: Log, ending: Ending, cycle_s: float = math.inf) -> None:
        """Create the journal. `cycle_s` is the cycle time of the robot, s."""
        self.heart = Heartbeat(clock)
        self.phase = ""
        self.stopped_at: float | None = None
        """Time at which the run failed, s on the run's clock; None if it has not failed."""
        self.error: Exception | None = None
        """Error that the log raised for an event. The next cycle raises it again."""
        self._clock, self._log, self._ending, self._cycle_s = clock, log, ending, cycle_s
        self._traced: BaseException | None = None
        """Failure whose traceback has already been reported."""

    @property
    def late_s(self) -> float:
        """Recent lateness of the computer, s."""
        return self.heart.recent(self._cycle_s)

    def enter(self, phase: str) -> None:
        """Report the phase of the run if it has changed."""
        if phase != self.phase:
            self.phase = phase
            self.event(EventKind.PHASE, phase)

    def check(self, text: str, check: Check) -> None:
        """Report the figures of a check."""
        self.event(EventKind.CHECK, text, check=check)

    def blame(self, reason: Reason, stimulus: Stimulus = Stimulus.FAILED) -> None:
        """Stop the run for this reason, or record it as a consequence of an earlier one. A failure that has not
        been handled yet takes precedence.
        """
        ending = self._ending
        pending, ending.failed = ending.failed, None
        if pending is not None and pending != reason:
            self.blame(pending)
        if not ending.has_failed:
            self.stopped_at = self._clock.now()
            reason = replace(reason, late_s=self.late_s)
            ending.fail(reason, stimulus)
            self.event(EventKind.STOP, str(reason), reason.cause)
        elif ending.follow(reason):
            self.event(EventKind.THEN, str(reason), reason.cause)

    def trace(self, error: BridgeError) -> None:
        """Report the traceback of code that has failed, once per failure."""
        cause = error.__cause__ if isinstance(error, CodeFailed) else None
        if cause is not None and cause is not self._traced:
            self._traced = cause
            self.event(EventKind.TRACEBACK, traceback_of(cause))

    def event(self, kind: str, text: str, cause: Cause | None = None, *, check: Check | None = None) -> None:
        """Pass an event to the log. An error from the log is deferred to the next cycle, so that nothing delays a
        retraction after a failure.
        """
        try:
            self._log.event(EventRecord(self._clock.now(), kind, text, cause, check))
        except Exception as error:
            self.error = error
