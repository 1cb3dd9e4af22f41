"""End of a run: a table of the effect of each stimulus in each state, and the first cause. Pure.

Every end of a run goes through `Ending`: signals, keys, the page, a program, the supervisor, a device, a plug-in,
an output that fails, an unhandled exception, and the cancellation of the task.
"""

import asyncio
from collections.abc import Mapping
from dataclasses import replace
from enum import StrEnum
from typing import NamedTuple

from hil_bridge.errors import BridgeError, Cause, DeviceError, Reason
from hil_bridge.errors.failures import explain_exception
from hil_bridge.record import Outcome
from hil_bridge.runs.result import RunResult

FOLLOWED_MAX = 5
"""Maximum number of causes that are kept after the first. Chosen."""


class RunState(StrEnum):
    """State of a run."""

    OPENING = "opening"
    """Devices connect and the sensor is checked. No order has been sent."""
    CLOSING = "closing"
    """The run ends before any order, and open devices are closed."""
    MOVING = "moving"
    """A movement sequence is in progress."""
    LEAVING = "leaving"
    """The tool retracts because an end was requested."""
    STOPPING = "stopping"
    """The tool retracts because of a failure."""
    ENDED = "ended"
    """The movement has ended. The tool stops, and outputs are written."""


class Stimulus(StrEnum):
    """Stimulus that may end a run."""

    ASKED = "asked"
    """Request by a signal, a key, the page or a program."""
    ASKED_AGAIN = "a further signal"
    HUNG_UP_AGAIN = "a further SIGHUP"
    """Second SIGHUP, because a shell that closes sends two."""
    FAILED = "a failure"
    """Failure of the supervisor, a device, a plug-in or an output, or an unhandled exception."""
    CANCELLED = "the task is cancelled"


class Act(StrEnum):
    """Effect of a stimulus."""

    CLOSE = "ends at once"
    RETRACT = "retracts and ends"
    NOTE = "continues, and reports it"
    CONTINUE = "continues"
    HURRY = "ends the process at once"


class Transition(NamedTuple):
    """Effect of a stimulus in one state."""

    act: Act
    state: RunState
    outcome: Outcome | None = None
    """Outcome of the run from now on; None to leave it unchanged."""


_S, _T, _A = RunState, Stimulus, Act
_STOPPED, _INTERRUPTED = Outcome.STOPPED, Outcome.INTERRUPTED

TRANSITIONS: Mapping[tuple[RunState, Stimulus], Transition] = {
    (_S.OPENING, _T.ASKED): Transition(_A.CLOSE, _S.CLOSING, _INTERRUPTED),
    (_S.OPENING, _T.ASKED_AGAIN): Transition(_A.CLOSE, _S.CLOSING, _INTERRUPTED),
    (_S.OPENING, _T.HUNG_UP_AGAIN): Transition(_A.CLOSE, _S.CLOSING, _INTERRUPTED),
    (_S.OPENING, _T.FAILED): Transition(_A.CLOSE, _S.CLOSING, _STOPPED),
    (_S.OPENING, _T.CANCELLED): Transition(_A.CLOSE, _S.CLOSING, _STOPPED),
    (_S.CLOSING, _T.ASKED): Transition(_A.CONTINUE, _S.CLOSING),
    (_S.CLOSING, _T.ASKED_AGAIN): Transition(_A.CONTINUE, _S.CLOSING),
    (_S.CLOSING, _T.HUNG_UP_AGAIN): Transition(_A.CONTINUE, _S.CLOSING),
    (_S.CLOSING, _T.FAILED): Transition(_A.NOTE, _S.CLOSING, _STOPPED),
    (_S.CLOSING, _T.CANCELLED): Transition(_A.CONTINUE, _S.CLOSING),
    (_S.MOVING, _T.ASKED): Transition(_A.RETRACT, _S.LEAVING, _INTERRUPTED),
    (_S.MOVING, _T.ASKED_AGAIN): Transition(_A.RETRACT, _S.LEAVING, _INTERRUPTED),
    (_S.MOVING, _T.HUNG_UP_AGAIN): Transition(_A.RETRACT, _S.LEAVING, _INTERRUPTED),
    (_S.MOVING, _T.FAILED): Transition(_A.RETRACT, _S.STOPPING, _STOPPED),
    (_S.MOVING, _T.CANCELLED): Transition(_A.RETRACT, _S.STOPPING, _STOPPED),
    (_S.LEAVING, _T.ASKED): Transition(_A.CONTINUE, _S.LEAVING),
    (_S.LEAVING, _T.ASKED_AGAIN): Transition(_A.CONTINUE, _S.LEAVING),
    (_S.LEAVING, _T.HUNG_UP_AGAIN): Transition(_A.CONTINUE, _S.LEAVING),
    (_S.LEAVING, _T.FAILED): Transition(_A.RETRACT, _S.STOPPING, _STOPPED),
    (_S.LEAVING, _T.CANCELLED): Transition(_A.RETRACT, _S.STOPPING, _STOPPED),
    (_S.STOPPING, _T.ASKED): Transition(_A.CONTINUE, _S.STOPPING),
    (_S.STOPPING, _T.ASKED_AGAIN): Transition(_A.CONTINUE, _S.STOPPING),
    (_S.STOPPING, _T.HUNG_UP_AGAIN): Transition(_A.CONTINUE, _S.STOPPING),
    (_S.STOPPING, _T.FAILED): Transition(_A.NOTE, _S.STOPPING),
    (_S.STOPPING, _T.CANCELLED): Transition(_A.NOTE, _S.STOPPING),
    (_S.ENDED, _T.ASKED): Transition(_A.CONTINUE, _S.ENDED),
    (_S.ENDED, _T.ASKED_AGAIN): Transition(_A.HURRY, _S.ENDED),
    (_S.ENDED, _T.HUNG_UP_AGAIN): Transition(_A.CONTINUE, _S.ENDED),
    (_S.ENDED, _T.FAILED): Transition(_A.NOTE, _S.ENDED, _STOPPED),
    (_S.ENDED, _T.CANCELLED): Transition(_A.CONTINUE, _S.ENDED),
}
"""Effect of every stimulus in every state. A request to end keeps its cause, a failure replaces the request, and
the first failure is kept. Nothing shortens a retraction. `docs/explanation/safety.md` prints this table.
"""


class Ending:
    """End of one run: its state, the request to end, and the causes so far."""

    def __init__(self) -> None:
        self.state = RunState.OPENING
        self.outcome = Outcome.COMPLETED
        self.reason: Reason | None = None
        """First failure, or otherwise the request to end; None while the run continues."""
        self.followed: list[Reason] = []
        """Failures after the first."""
        self.requested: Cause | None = None
        """Source of the request to end; None if there is no request."""
        self.failed: Reason | None = None
        """Failure outside the cycles that no cycle has handled yet."""
        self.result: RunResult | None = None
        """Result of a run that has ended, even if its task was cancelled while the tool moved."""

    @property
    def is_moving(self) -> bool:
        """Whether a movement sequence is in progress."""
        return self.state in (RunState.MOVING, RunState.LEAVING, RunState.STOPPING)

    def begin_movement(self) -> None:
        """Begin a movement sequence. Earlier requests remain valid."""
        self.state = RunState.MOVING if self.requested is None else RunState.LEAVING

    def end_movement(self) -> None:
        """End the movement sequence."""
        self.state = RunState.ENDED

    def ask(self, cause: Cause, stimulus: Stimulus = Stimulus.ASKED) -> Act:
        """Request the end, and return the effect. The first cause is kept. The method only sets flags, so that a
        signal handler may call it.
        """
        act, self.state, _ = TRANSITIONS[self.state, stimulus]
        if act in (Act.CLOSE, Act.RETRACT):
            self.requested = self.requested or cause
        return act

    def fail_outside_cycles(self, reason: Reason) -> Act:
        """Accept a failure outside the cycles, and return its effect. The next cycle handles the failure; before
        the first cycle, the caller must close the run.
        """
        self.failed = self.failed or reason
        return TRANSITIONS[self.state, Stimulus.FAILED].act

    def close(self) -> None:
        """End the run before any order."""
        self.state = RunState.CLOSING

    def end_as_requested(self) -> Reason:
        """Make the request the reason of the end, and return the reason."""
        assert self.requested is not None
        self.outcome, self.reason = Outcome.INTERRUPTED, Reason(self.requested)
        return self.reason

    @property
    def has_failed(self) -> bool:
        """Whether a failure is the reason of the end."""
        return self.outcome is Outcome.STOPPED

    def fail(self, reason: Reason, stimulus: Stimulus = Stimulus.FAILED) -> None:
        """Accept the first failure, which replaces a request as the reason."""
        transition = TRANSITIONS[self.state, stimulus]
        self.state, self.reason = transition.state, reason
        self.outcome = transition.outcome or self.outcome

    def follow(self, reason: Reason) -> bool:
        """Keep a failure after the first, and return whether its cause is new."""
        known = any(each is not None and each.text == reason.text for each in (self.reason, *self.followed))
        if known or len(self.followed) >= FOLLOWED_MAX:
            return False
        self.followed.append(reason)
        return True

    def result_before(self, error: BaseException, stray: BaseException | None) -> RunResult:
        """Return the result of a run that an operator ended before its movement.

        `stray` is the exception that previously escaped from a loop callback, if any. If anything else ended the
        run, its exception is raised.
        """
        if stray is not None:
            reason = explain_exception(stray)
            raise DeviceError(reason.text, remedy=reason.remedy, cause=reason.cause) from stray
        if not isinstance(error, asyncio.CancelledError):
            raise error
        if self.requested is None:
            text = "the run was cancelled before the movement began"
            raise DeviceError(text, cause=Cause.CANCELLED) from error
        return RunResult(Outcome.INTERRUPTED, Reason(self.requested, "before the movement began"))


def result_after(result: RunResult, error: BaseException) -> RunResult:
    """Return the result of a run whose movement had ended when `error` was raised. The final state of the tool
    remains known.
    """
    stimulus = Stimulus.CANCELLED if isinstance(error, asyncio.CancelledError) else Stimulus.FAILED
    act, _, outcome = TRANSITIONS[RunState.ENDED, stimulus]
    if act is not Act.NOTE:
        return result
    reason = error.reason(Cause.OUTPUT) if isinstance(error, BridgeError) else explain_exception(error)
    if outcome is not None and result.outcome is Outcome.COMPLETED:
        return replace(result, outcome=outcome, reason=reason)
    return replace(result, followed=(*result.followed, reason))
