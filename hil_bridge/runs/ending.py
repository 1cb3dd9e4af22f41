"""End of a run: one table of the effect of each stimulus in each state, and the first cause. Pure.

Every way to end a run goes through `Ending`: signals, keys, the page, a program, the guard, a device, a plug-in, an
output that fails, an exception that nothing takes, and the cancellation of the task.
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
"""Chosen: most causes that are kept after the first one."""


class RunState(StrEnum):
    """State of a run."""

    OPENING = "opening"
    """Devices connect, the sensor is checked: no order has been given."""
    CLOSING = "closing"
    """It ends before any order: open devices are closed."""
    MOVING = "moving"
    """A movement sequence is under way."""
    LEAVING = "leaving"
    """It retracts because an end was requested."""
    STOPPING = "stopping"
    """It retracts because something is wrong."""
    ENDED = "ended"
    """The movement has ended: the tool comes to a standstill, outputs are written."""


class Stimulus(StrEnum):
    """Stimulus that may end a run."""

    ASKED = "asked"
    """By a signal, a key, the page or a program."""
    ASKED_AGAIN = "a further signal"
    HUNG_UP_AGAIN = "a further SIGHUP"
    """A shell that closes sends two."""
    FAILED = "a failure"
    """Of guard, device, plug-in or output, or an unhandled exception."""
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
    """Outcome of the run from here on; None: unchanged."""


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
"""Every stimulus in every state. A request to end keeps its cause, a failure takes its place, and the first failure
stays. Nothing shortens a retraction. `docs/explanation/safety.md` prints this table.
"""


class Ending:
    """End of one run: its state, the request for it, and the causes so far."""

    def __init__(self) -> None:
        self.state = RunState.OPENING
        self.outcome = Outcome.COMPLETED
        self.reason: Reason | None = None
        """The first failure, else the request; None while the run continues."""
        self.followed: list[Reason] = []
        """Failures after the first one."""
        self.asked: Cause | None = None
        """Source of the request to end; None without one."""
        self.failed: Reason | None = None
        """Failure outside the cycles that no cycle has handled yet."""
        self.result: RunResult | None = None
        """Result of a run that has ended, also where its task was cancelled while the tool moved."""

    @property
    def is_moving(self) -> bool:
        """Whether a movement sequence is under way."""
        return self.state in (RunState.MOVING, RunState.LEAVING, RunState.STOPPING)

    def begin_movement(self) -> None:
        """Begin a movement sequence. Earlier requests still hold."""
        self.state = RunState.MOVING if self.asked is None else RunState.LEAVING

    def end_movement(self) -> None:
        """End the movement sequence."""
        self.state = RunState.ENDED

    def ask(self, cause: Cause, stimulus: Stimulus = Stimulus.ASKED) -> Act:
        """Request the end, and return the effect; the first cause stays. It only sets flags, so that a signal
        handler may call it.
        """
        act, self.state, _ = TRANSITIONS[self.state, stimulus]
        if act in (Act.CLOSE, Act.RETRACT):
            self.asked = self.asked or cause
        return act

    def fail_beside(self, reason: Reason) -> Act:
        """Accept a failure outside the cycles, and return its effect. The next cycle handles it; before the first
        one it is up to the caller to close.
        """
        self.failed = self.failed or reason
        return TRANSITIONS[self.state, Stimulus.FAILED].act

    def close(self) -> None:
        """End the run before any order."""
        self.state = RunState.CLOSING

    def end_as_asked(self) -> Reason:
        """Make the request the reason of the end; return it."""
        assert self.asked is not None
        self.outcome, self.reason = Outcome.INTERRUPTED, Reason(self.asked)
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
        """Keep a failure after the first one; return whether its fact is new."""
        known = any(each is not None and each.text == reason.text for each in (self.reason, *self.followed))
        if known or len(self.followed) >= FOLLOWED_MAX:
            return False
        self.followed.append(reason)
        return True

    def result_before(self, error: BaseException, stray: BaseException | None) -> RunResult:
        """Return the result of a run that ended before its movement, if an operator asked for that.

        `stray` is the exception that left a callback of the loop before, if any. Raises what else ended it.
        """
        if stray is not None:
            reason = explain_exception(stray)
            raise DeviceError(reason.text, remedy=reason.remedy, cause=reason.cause) from stray
        if not isinstance(error, asyncio.CancelledError):
            raise error
        if self.asked is None:
            text = "the run was cancelled before the movement began"
            raise DeviceError(text, cause=Cause.CANCELLED) from error
        return RunResult(Outcome.INTERRUPTED, Reason(self.asked, "before the movement began"))


def result_after(result: RunResult, error: BaseException) -> RunResult:
    """Return the result of a run whose movement had ended when this was raised: how the tool was left stays known."""
    stimulus = Stimulus.CANCELLED if isinstance(error, asyncio.CancelledError) else Stimulus.FAILED
    act, _, outcome = TRANSITIONS[RunState.ENDED, stimulus]
    if act is not Act.NOTE:
        return result
    reason = error.reason(Cause.OUTPUT) if isinstance(error, BridgeError) else explain_exception(error)
    if outcome is not None and result.outcome is Outcome.COMPLETED:
        return replace(result, outcome=outcome, reason=reason)
    return replace(result, followed=(*result.followed, reason))
