"""Standard output and standard error of a process that must continue if its terminal is paused or closed.

A write blocks for as long as a terminal is paused (Ctrl-S) or a pipe is not read. A separate thread therefore
writes, and no other thread waits for it longer than it chooses to. Source: Linux, termios(3) and pipe(7).
"""

import logging
import os
import queue
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from types import TracebackType
from typing import NoReturn, Self, TextIO

from hil_bridge.errors.text_files import harmless

CLOSE_SECONDS = 2.0
"""Longest wait for a screen when nothing else may be delayed, s. Chosen: a slow terminal takes far less."""
LEAVE_SECONDS = 0.5
"""Longest wait of the ending process for the last output, s. Chosen: the user has requested the end."""


class Screen:
    """Output stream with a thread that writes to it. Output to a closed stream is dropped silently."""

    def __init__(self, stream: TextIO | None) -> None:
        """Create a screen. `stream` is None if the process was started with this stream closed."""
        self.stream = stream
        self._steps: queue.Queue[Callable[[], object] | None] = queue.Queue()
        threading.Thread(target=self._work, name="screen", daemon=True).start()

    @property
    def busy(self) -> bool:
        """Whether some output has not been written yet."""
        return self._steps.unfinished_tasks > 0

    def say(self, text: str) -> None:
        """Write a line after all earlier lines. Returns at once."""
        self.do(lambda: print(harmless(text), file=self.stream, flush=True))

    def do(self, step: Callable[[], object]) -> None:
        """Let the thread execute a step, such as drawing. Returns at once. If the stream is closed, the step ends
        silently.
        """
        if self.stream is not None:
            self._steps.put(step)

    def wait(self, seconds: float | None = CLOSE_SECONDS) -> bool:
        """Wait until all output has been written, indefinitely with None. Return whether it has been written."""
        steps = self._steps
        with steps.all_tasks_done:
            return steps.all_tasks_done.wait_for(lambda: not steps.unfinished_tasks, seconds)

    def close(self) -> None:
        """Let the thread end after it has written all output."""
        self._steps.put(None)

    def _work(self) -> None:
        while (step := self._steps.get()) is not None:
            # SystemExit: rich raises it for a broken pipe
            with suppress(OSError, ValueError, SystemExit):
                step()
            self._steps.task_done()
        self._steps.task_done()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.wait()
        self.close()


class Terminal:
    """Standard output and standard error of this process inside the context. Log messages are written to them too."""

    def __init__(self) -> None:
        self.out = Screen(sys.stdout)
        self.err = Screen(sys.stderr)
        self._logged = _Logged(self.err)

    def print_last(self, errors: Sequence[str], lines: Sequence[str], seconds: float | None) -> bool:
        """Write lines of errors, then lines of output, after all earlier lines. Return whether this was done.

        Waits at most `seconds`, indefinitely with None. Ctrl-C ends the wait.
        """
        try:
            self.out.wait()
            for text in errors:
                self.err.say(text)
            self.err.wait()
            for text in lines:
                self.out.say(text)
            return self.out.wait(seconds) and self.err.wait(seconds)
        except KeyboardInterrupt:
            return False

    def __enter__(self) -> Self:
        logging.getLogger().addHandler(self._logged)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        logging.getLogger().removeHandler(self._logged)
        for screen in (self.out, self.err):
            screen.wait(LEAVE_SECONDS)
            screen.close()


class _Logged(logging.Handler):
    """Log handler that writes warnings and errors of libraries to a screen, such as asyncio's message about a
    failed callback.
    """

    def __init__(self, screen: Screen) -> None:
        super().__init__(logging.WARNING)
        self._screen = screen

    def emit(self, record: logging.LogRecord) -> None:
        """Write a log record. Returns at once."""
        self._screen.say(self.format(record))


def leave(code: int | str | None) -> NoReturn:
    """End the process with this code, regardless of the state of its terminal or of its pipe's reader."""
    settling = threading.Thread(target=_settle, name="settle", daemon=True)
    settling.start()
    settling.join(LEAVE_SECONDS)
    if settling.is_alive():  # the interpreter would wait for this output forever
        os._exit(code if isinstance(code, int) else 0 if code is None else 1)
    sys.exit(code)


def _settle() -> None:
    """Write pending output. Output without a reader is discarded, so that the interpreter does not fail on it."""
    for stream in (sys.stdout, sys.stderr):
        if stream is None:
            continue
        try:
            stream.flush()
        except (OSError, ValueError):
            with suppress(OSError, ValueError):
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, stream.fileno())
                os.close(nowhere)
