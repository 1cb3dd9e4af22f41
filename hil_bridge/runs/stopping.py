"""External requests that end a run: signals, keys, the page, and unhandled exceptions."""

import asyncio
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from hil_bridge.errors import BridgeError, Cause
from hil_bridge.errors.cancelling import is_interrupt
from hil_bridge.errors.failures import explain_exception, failure_event, traceback_of
from hil_bridge.record import EventKind
from hil_bridge.runs.ending import Act, Ending, RunState, Stimulus, result_after
from hil_bridge.runs.result import RunResult
from hil_bridge.runs.run_log import RunLog
from hil_bridge.runs.signals import Signals, signal_name

SIGNALS_RECORDED = 16
"""Maximum number of signals in the recording. Chosen: a flood of signals must not fill it."""


class Stopping:
    """Handler that lets a run retract and end, or that ends a run that has not moved yet."""

    def __init__(self, signals: Signals, log: RunLog) -> None:
        self._signals, self._log = signals, log
        self.ending = Ending()
        """End of the run, shared with the run once its devices are open."""
        self.hurried = False
        """Whether another signal came after the movement had ended, so that the process must end at once."""
        self._requested: Cause | None = None
        """Source of an operator's request to end other than by a signal."""
        self._task: asyncio.Task[Any] | None = None
        """Task of the run, once the recording can be written."""
        self._stray: BaseException | None = None
        """First exception that escaped from a callback of the loop."""
        self._cancelled = False

    def end_by_hand(self, cause: Cause, text: str, key: str = "") -> None:
        """End the run, like Ctrl-C."""
        self._requested = self._requested or cause
        os.kill(os.getpid(), signal.SIGINT)
        # after the notice of the signal, which would replace it in a small view
        report = partial(self._log.tell, EventKind.OPERATOR, text, cause=cause, by=key)
        asyncio.get_running_loop().call_soon(report)

    @contextmanager
    def interruptible(self) -> Iterator[None]:
        """Handle signals by the table in `ending` while the context is open."""
        loop, self._task = asyncio.get_running_loop(), asyncio.current_task()

        def interrupted(number: int) -> None:
            stimulus = Stimulus.ASKED
            if self._signals.count > 1:
                stimulus = Stimulus.HUNG_UP_AGAIN if number == signal.SIGHUP else Stimulus.ASKED_AGAIN
            act = self.ending.ask(self._requested or Cause.SIGNAL, stimulus)
            self.hurried |= act is Act.HURRY
            if self.ending.state is RunState.ENDED:
                return
            if self._signals.count <= SIGNALS_RECORDED:
                name = signal_name(number)
                report = partial(self._log.tell, EventKind.SIGNAL, name, cause=Cause.SIGNAL, by=name)
                loop.call_soon_threadsafe(report)
            if act is Act.CLOSE:
                loop.call_soon_threadsafe(self._close)

        with self._signals.reacting_with(interrupted):
            yield

    def _close(self) -> None:
        """Cancel the run unless a movement has begun. This is done only once, because everything is closed in order."""
        if self._task is not None and self.ending.state is RunState.CLOSING and not self._cancelled:
            self._cancelled = True
            self._task.cancel()

    def take_stray(self, error: BaseException) -> bool:
        """Handle an exception from a loop callback, which asyncio does not propagate: the run retracts and ends.

        Returns False if there is no run that could end in order.
        """
        if is_interrupt(error) or self._task is None:
            return False
        if self._stray is None:
            self._stray = error
            self._log.notice(*failure_event(error))
        if self.ending.fail_outside_cycles(explain_exception(error)) is Act.CLOSE:
            self.ending.close()
            self._close()
        return True

    def ended_by(self, error: BaseException, bugs: list[str]) -> RunResult:
        """Return the result of a run that `error` ended, or that had ended before it. The traceback of the error is
        added to `bugs`. Otherwise, an exception is raised.
        """
        result = self.ending.result
        if result is None:
            return self.ending.result_before(error, self._stray)
        if not isinstance(error, (BridgeError, asyncio.CancelledError)):
            bugs.append(traceback_of(error))
        return result_after(result, error)
