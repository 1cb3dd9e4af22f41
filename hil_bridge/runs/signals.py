"""Signals that end a run, and what they lead to, which depends on what the run is doing."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

ASKING = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP")
"""Ctrl-C, `kill`, a terminal that closes, Ctrl-\\, and Ctrl-Z: a suspended process controls no force."""
OTHERS = (
    *("SIGUSR1", "SIGUSR2", "SIGALRM", "SIGVTALRM", "SIGPROF", "SIGXCPU", "SIGIO", "SIGPWR", "SIGSTKFLT"),
    *("SIGABRT", "SIGTRAP", "SIGSYS"),
)
"""Signals that no person sends to end a run, and that end a process by themselves.

Source: Linux, signal(7), default actions Term and Core. SIGPIPE and SIGXFSZ are missing, which Python ignores. So are
SIGSEGV, SIGBUS, SIGFPE and SIGILL: after a handler the failed instruction would be done again for ever.
"""
BACKGROUND = ("SIGTTIN", "SIGTTOU")
"""A background process that reads from its terminal, or writes to it, is not stopped for that: they are ignored."""


def _present(names: tuple[str, ...]) -> tuple[int, ...]:
    """Numbers of the signals that this system has."""
    return tuple(int(getattr(signal, name)) for name in names if hasattr(signal, name))


def _real_time() -> tuple[int, ...]:
    """Numbers of the real-time signals, which end a process too; none where the system has none."""
    lowest, highest = getattr(signal, "SIGRTMIN", 1), getattr(signal, "SIGRTMAX", 0)
    return tuple(range(lowest, highest + 1))


ENDING = (*_present(ASKING), *_present(OTHERS), *_real_time())
"""Numbers of all signals that end a run: each one that ends or stops a process, and that a program can take."""

React = Callable[[int], object]


def signal_name(number: int) -> str:
    """Name of a signal, as `SIGTERM` or `SIGRTMIN+2`."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"SIGRTMIN+{number - signal.SIGRTMIN}"


class Signals:
    """Hears the signals of `ENDING` and hands them on.

    It uses Python's own handlers, since a loop in virtual time has none. They run in the main thread between two of its
    instructions, so a reaction may only set a flag, tell the loop, or raise.
    """

    def __init__(self) -> None:
        self.first: int | None = None
        """The one that came first, if any."""
        self.count = 0
        """Number of signals."""
        self._react: React = at_once

    @contextmanager
    def hearing(self) -> Iterator[None]:
        """Inside, signals react; outside, they are what they were. Elsewhere than in the main thread nothing changes.

        SIGHUP stays ignored where it was (nohup). One of `OTHERS` stays with a handler that another part of the
        program has set for it, and stays ignored where it was.
        """
        if threading.current_thread() is not threading.main_thread():  # only there may handlers be set
            yield
            return
        before: dict[int, Any] = {}
        for number in ENDING:
            if not _is_of_others(number):
                before[number] = signal.signal(number, self._take)
        for number in _present(BACKGROUND):
            before[number] = signal.signal(number, signal.SIG_IGN)
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
        self.count += 1
        if self.first is None:
            self.first = number
        self._react(number)


def _is_of_others(number: int) -> bool:
    """Whether a signal is left to the handler that it has."""
    handler = signal.getsignal(number)
    if number == signal.SIGHUP:
        return handler is signal.SIG_IGN
    return number not in _present(ASKING) and handler not in (signal.SIG_DFL, None)


def at_once(number: int) -> None:
    """End what the main thread does. Raises KeyboardInterrupt."""
    raise KeyboardInterrupt


def unless_hung_up(number: int) -> None:
    """Raise KeyboardInterrupt, except for a closed terminal, so that files are still written."""
    if number != signal.SIGHUP:
        raise KeyboardInterrupt


@contextmanager
def as_ctrl_c() -> Iterator[None]:
    """Inside, every other signal of `ENDING` is taken for Ctrl-C, on which an event loop ends its task in order.

    A second Ctrl-C ends it at once; a second SIGHUP, which a shell that closes sends, does not.
    """
    signals = Signals()

    def react(number: int) -> None:
        if signals.count == 1 or number != signal.SIGHUP:
            signal.raise_signal(signal.SIGINT)

    before = signal.getsignal(signal.SIGINT)
    with signals.hearing(), signals.leading_to(react):
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, before)
        yield
