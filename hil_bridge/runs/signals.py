"""Signals that end a run, and what they lead to, which depends on what the run is doing."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP)
"""Ctrl-C, `kill`, a terminal that closes, Ctrl-\\, and Ctrl-Z: a process that stands still controls no force."""

React = Callable[[signal.Signals], object]


class Signals:
    """Hears the signals of `ENDING` and hands them on.

    It uses Python's own handlers, since a loop in virtual time has none. They run in the main thread between two of its
    instructions, so a reaction may only set a flag, tell the loop, or raise.
    """

    def __init__(self) -> None:
        self.first: signal.Signals | None = None
        """The one that came first, if any."""
        self.count = 0
        """Number of signals."""
        self._react: React = at_once

    @contextmanager
    def heard(self) -> Iterator[None]:
        """Inside, signals react; outside, they are what they were. Elsewhere than in the main thread nothing changes.

        SIGHUP stays ignored where it was (nohup). A background process that writes to its terminal is not stopped
        for that (SIGTTOU).
        """
        if threading.current_thread() is not threading.main_thread():  # only there may handlers be set
            yield
            return
        before: dict[signal.Signals, Any] = {}
        for number in ENDING:
            if number is not signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:
                before[number] = signal.signal(number, self._take)
        before[signal.SIGTTOU] = signal.signal(signal.SIGTTOU, signal.SIG_IGN)
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, signal.SIG_DFL if handler is None else handler)

    @contextmanager
    def leading_to(self, react: React) -> Iterator[None]:
        """Inside, a signal calls `react` with its number."""
        before, self._react = self._react, react
        try:
            yield
        finally:
            self._react = before

    def _take(self, number: int, frame: object) -> None:
        taken = signal.Signals(number)
        self.count += 1
        if self.first is None:
            self.first = taken
        self._react(taken)


def at_once(number: signal.Signals) -> None:
    """End what the main thread does. Raises KeyboardInterrupt."""
    raise KeyboardInterrupt


def unless_hung_up(number: signal.Signals) -> None:
    """The same, but a terminal that closes does not keep files from being written. Raises KeyboardInterrupt."""
    if number is not signal.SIGHUP:
        raise KeyboardInterrupt


@contextmanager
def as_ctrl_c() -> Iterator[None]:
    """Inside, every other signal of `ENDING` is taken for Ctrl-C, on which an event loop ends its task in order.

    A second Ctrl-C ends it at once; a second SIGHUP, which a shell that closes sends, does not.
    """
    signals = Signals()

    def react(number: signal.Signals) -> None:
        if signals.count == 1 or number is not signal.SIGHUP:
            signal.raise_signal(signal.SIGINT)

    before = signal.getsignal(signal.SIGINT)
    with signals.heard(), signals.leading_to(react):
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, before)
        yield
