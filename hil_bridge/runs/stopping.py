"""Ends of a run from outside: signals of the process, keys, the page, and exceptions that nothing takes."""

import asyncio
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from hil_bridge.errors import BridgeError, Cause
from hil_bridge.errors.cancelling import is_asked
from hil_bridge.errors.failures import explain_exception, failure_event, traceback_of
from hil_bridge.record import EventRecord
from hil_bridge.runs.closing import ended_after, ended_before
from hil_bridge.runs.cycle import Run
from hil_bridge.runs.result import RunResult
from hil_bridge.runs.run_log import RunLog
from hil_bridge.runs.signals import Signals, signal_name

SIGNALS_TOLD = 16
"""Signals that the record names. Chosen: a flood of them must not fill it."""


class Stopping:
    """Lets the run of a process retract and end, or ends what has not moved yet."""

    def __init__(self, signals: Signals, log: RunLog) -> None:
        self._signals, self._log = signals, log
        self.run: Run | None = None
        """The run, once its devices are open."""
        self.result: RunResult | None = None
        self.hurried = False
        """A further signal came when the movement had ended already: the process shall end at once."""
        self._moved = False
        """The movement has begun, and may have ended."""
        self._cancelled: Cause | None = None
        """Cause by which the run ended before it moved."""
        self._asked: Cause | None = None
        """By which way a person has asked for the end, other than a signal."""
        self._task: asyncio.Task[Any] | None = None
        """The task of the run, once the record can be written."""
        self._stray: BaseException | None = None
        """Exception that left a callback of the loop, the first one."""

    @property
    def _moving(self) -> bool:
        return self.run is not None and self.run.moving

    def hear(self, record: EventRecord) -> None:
        """Something happened in the run."""
        self._moved = self._moved or self._moving

    def end_by_hand(self, cause: Cause, text: str, key: str = "") -> None:
        """End in the same way as by Ctrl-C."""
        self._asked = self._asked or cause
        os.kill(os.getpid(), signal.SIGINT)
        # behind the notice of the signal, which a small view would else show in its place
        tell = partial(self._log.tell, "operator", text, cause=cause, by=key)
        asyncio.get_running_loop().call_soon(tell)

    @contextmanager
    def interruptible(self) -> Iterator[None]:
        """A signal retracts while the robot moves, and ends at once before that. When the movement has ended, it waits
        until the tool has come to rest and the record is whole.
        """
        loop, task = asyncio.get_running_loop(), asyncio.current_task()
        assert task is not None
        self._task = task

        def ended() -> None:
            if self._moving and self.run is not None:  # the movement has begun since
                self.run.interrupt(self._asked or Cause.SIGNAL)
            elif not (self._moved or self._moving or self._cancelled):
                self._cancelled = self._asked or Cause.SIGNAL  # once: what is being closed is closed in order
                task.cancel()

        def interrupted(number: int) -> None:
            if self._moved and not self._moving:
                # a shell that closes sends SIGHUP a second time
                self.hurried |= self._signals.count > 1 and number != signal.SIGHUP
                return
            if self.run is not None and self._moving:
                self._moved = True
                self.run.interrupt(self._asked or Cause.SIGNAL)
            if self._signals.count <= SIGNALS_TOLD:
                name = signal_name(number)
                tell = partial(self._log.tell, "signal", name, cause=Cause.SIGNAL, by=name)
                loop.call_soon_threadsafe(tell)
            loop.call_soon_threadsafe(ended)

        with self._signals.leading_to(interrupted):
            yield

    def take_stray(self, error: BaseException) -> bool:
        """An exception has left a callback of the loop, which asyncio does not take: the run retracts and ends.

        False where nothing is there that could end in order.
        """
        if is_asked(error) or self._task is None:
            return False
        if self._stray is None:
            self._stray = error
            self._log.notice(*failure_event(error))
        if self.run is not None and self._moving:
            self.run.fail(explain_exception(error))
        elif not self._moved:
            self._task.cancel()
        return True

    def ended_by(self, error: BaseException, bugs: list[str]) -> RunResult:
        """Result of a run that this exception ended, or that it came after; its traceback is told to `bugs`. Raises
        the exception else.
        """
        result = self.result or (self.run.result if self.run is not None else None)
        if result is None:
            return ended_before(error, self._cancelled, self._stray)
        if not isinstance(error, (BridgeError, asyncio.CancelledError)):
            bugs.append(traceback_of(error))
        return ended_after(result, error)
