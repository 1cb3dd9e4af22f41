"""How a run ended where closing its devices, or something beside it, raised an exception."""

import asyncio
from dataclasses import replace

from hil_bridge.errors import BridgeError, Cause, DeviceError, Reason
from hil_bridge.errors.failures import explain_exception
from hil_bridge.record import Outcome
from hil_bridge.runs.result import RunResult


def ended_before(error: BaseException, by: Cause | None, stray: BaseException | None) -> RunResult:
    """Result of a run that ended before its movement began, by a person or a signal; `by` is None for neither.

    `stray` is the exception that left a callback of the loop before, if any. Raises what else ended it.
    """
    if stray is not None:
        raise _stopped(explain_exception(stray)) from stray
    if isinstance(error, asyncio.CancelledError):
        if by is not None:
            return RunResult(Outcome.INTERRUPTED, Reason(by, "before the movement began"))
        text = "the run was cancelled before the movement began"
        raise DeviceError(text, cause=Cause.CANCELLED) from error
    raise error


def ended_after(result: RunResult, error: BaseException) -> RunResult:
    """Result of a run whose movement had ended when this was raised: how the tool was left stays known."""
    if isinstance(error, asyncio.CancelledError):
        return result
    reason = error.reason(Cause.OUTPUT) if isinstance(error, BridgeError) else explain_exception(error)
    if result.outcome is Outcome.COMPLETED:
        return replace(result, outcome=Outcome.STOPPED, reason=reason)
    return replace(result, followed=(*result.followed, reason))


def _stopped(reason: Reason) -> DeviceError:
    return DeviceError(reason.text, remedy=reason.remedy, cause=reason.cause)
