"""How a run ended where closing its devices, or something beside it, raised an exception."""

import asyncio
from dataclasses import replace

from hil_bridge.errors import BridgeError, DeviceError
from hil_bridge.errors.failures import unexpected
from hil_bridge.record import Outcome
from hil_bridge.runs.cycle import RunResult


def ended_before(error: BaseException, by_signal: bool, stray: BaseException | None) -> RunResult:
    """Result of a run that ended before its movement began, by a signal.

    `stray` is the exception that left a callback of the loop before, if any. Raises what else ended it.
    """
    if stray is not None:
        raise DeviceError(unexpected(stray)) from stray
    if isinstance(error, asyncio.CancelledError):
        if by_signal:
            return RunResult(Outcome.INTERRUPTED, "before the movement began")
        raise DeviceError("the run was cancelled before the movement began") from error
    raise error


def ended_after(result: RunResult, error: BaseException) -> RunResult:
    """Result of a run whose movement had ended when this was raised: how the tool was left stays known."""
    if isinstance(error, asyncio.CancelledError):
        return result
    cause = str(error) if isinstance(error, BridgeError) else unexpected(error)
    if result.outcome is Outcome.COMPLETED:
        return replace(result, outcome=Outcome.STOPPED, cause=cause)
    return replace(result, followed=(*result.followed, cause))
