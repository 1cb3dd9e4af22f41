"""Requests from outside that end a run: signals, keys, the page, and unhandled exceptions."""

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

SIGNALS_TOLD = 16
"""Signals that the record names. Chosen: a flood of them must not fill it."""


class Stopping:
    """Lets the run of a process retract and end, or ends one that has not moved yet."""

    def __init__(self, signals: Signals, log: RunLog) -> None:
        self._signals, self._log = signals, log
        self.ending = Ending()
        """Shared with the run, once its devices are open."""
        self.hurried = False
        """Another signal came after the movement had ended: the process must end at once."""
        self._asked: Cause | None = None
        """How an operator requested the end, other than by a signal."""
        self._task: asyncio.Task[Any] | None = None
        """The task of the run, once the record can be written."""
        self._stray: BaseException | None = None
        """Exception that left a callback of the loop, the first one."""
        self._cancelled = False

    def end_by_hand(self, cause: Cause, text: str, key: str = "") -> None:
        """End in the same way as by Ctrl-C."""
        self._asked = self._asked or cause
        os.kill(os.getpid(), signal.SIGINT)
        # after the notice of the signal, which a small view would otherwise show in its place
        tell = partial(self._log.tell, EventKind.OPERATOR, text, cause=cause, by=key)
        asyncio.get_running_loop().call_soon(tell)

    @contextmanager
    def interruptible(self) -> Iterator[None]:
        """Handle signals by the table of `ending` while the context is open."""
        loop, self._task = asyncio.get_running_loop(), asyncio.current_task()

        def interrupted(number: int) -> None:
            stimulus = Stimulus.ASKED
            if self._signals.count > 1:
                stimulus = Stimulus.HUNG_UP_AGAIN if number == signal.SIGHUP else Stimulus.ASKED_AGAIN
            act = self.ending.ask(self._asked or Cause.SIGNAL, stimulus)
            self.hurried |= act is Act.HURRY
            if self.ending.state is RunState.ENDED:
                return
            if self._signals.count <= SIGNALS_TOLD:
                name = signal_name(number)
                tell = partial(self._log.tell, EventKind.SIGNAL, name, cause=Cause.SIGNAL, by=name)
                loop.call_soon_threadsafe(tell)
            if act is Act.CLOSE:
                loop.call_soon_threadsafe(self._close)

        with self._signals.leading_to(interrupted):
            yield

    def _close(self) -> None:
        """Cancel the run, unless a movement has begun since; once, for what is being closed is closed in order."""
        if self._task is not None and self.ending.state is RunState.CLOSING and not self._cancelled:
            self._cancelled = True
            self._task.cancel()

    def take_stray(self, error: BaseException) -> bool:
        """Handle an exception of a loop's callback, which asyncio does not propagate: the run retracts and ends.

        Return False if there is nothing that could end in order.
        """
        if is_interrupt(error) or self._task is None:
            return False
        if self._stray is None:
            self._stray = error
            self._log.notice(*failure_event(error))
        if self.ending.fail_beside(explain_exception(error)) is Act.CLOSE:
            self.ending.close()
            self._close()
        return True

    def ended_by(self, error: BaseException, bugs: list[str]) -> RunResult:
        """Return the result of a run that this exception ended, or that it came after; its traceback goes to `bugs`.
        Raises the exception else.
        """
        result = self.ending.result
        if result is None:
            return self.ending.result_before(error, self._stray)
        if not isinstance(error, (BridgeError, asyncio.CancelledError)):
            bugs.append(traceback_of(error))
        return result_after(result, error)
