"""Signals that end a run, and their effect, which depends on the state of the run."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

ASKING = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP")
"""Signals that request an end: Ctrl-C, `kill`, a closing terminal, Ctrl-\\, and Ctrl-Z, because a suspended process
controls no force.
"""
OTHERS = (
    *("SIGUSR1", "SIGUSR2", "SIGALRM", "SIGVTALRM", "SIGPROF", "SIGXCPU", "SIGIO", "SIGPWR", "SIGSTKFLT"),
    *("SIGABRT", "SIGTRAP", "SIGSYS"),
)
"""Signals that end a process, but that operators do not send to end a run.

Source: Linux, signal(7), default actions Term and Core. SIGPIPE and SIGXFSZ are missing, because Python ignores
them. SIGSEGV, SIGBUS, SIGFPE and SIGILL are missing, because the failed instruction would be repeated endlessly
after a handler.
"""
BACKGROUND = ("SIGTTIN", "SIGTTOU")
"""Signals that stop a background process when it uses its terminal. They are ignored, so that the process continues."""


def _present(names: tuple[str, ...]) -> tuple[int, ...]:
    """Return the numbers of the signals that this system has."""
    return tuple(int(getattr(signal, name)) for name in names if hasattr(signal, name))


def _real_time() -> tuple[int, ...]:
    """Return the numbers of the real-time signals, which also end a process; empty if the system has none."""
    lowest, highest = getattr(signal, "SIGRTMIN", 1), getattr(signal, "SIGRTMAX", 0)
    return tuple(range(lowest, highest + 1))


ENDING = (*_present(ASKING), *_present(OTHERS), *_real_time())
"""Numbers of all signals that end a run: all signals that end or stop a process and that a program can handle."""

React = Callable[[int], object]


def signal_name(number: int) -> str:
    """Return the name of a signal, for example `SIGTERM` or `SIGRTMIN+2`."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"SIGRTMIN+{number - signal.SIGRTMIN}"


class Signals:
    """Handler of the signals in `ENDING`.

    It uses Python's own handlers, because a loop in virtual time has none. They run in the main thread between two
    instructions, so a reaction may only set a flag, notify the loop, or raise.
    """

    def __init__(self) -> None:
        self.first: int | None = None
        """First signal received, or None."""
        self.count = 0
        """Number of signals received."""
        self._react: React = at_once

    @contextmanager
    def installed(self) -> Iterator[None]:
        """Handle signals while the context is open, and restore the previous handlers afterwards. Outside the main
        thread, this does nothing.

        SIGHUP stays ignored if it was ignored before (nohup). A signal of `OTHERS` keeps a handler that another
        part of the program has set for it, and stays ignored if it was ignored.
        """
        if threading.current_thread() is not threading.main_thread():  # handlers can only be set there
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
    def reacting_with(self, react: React) -> Iterator[None]:
        """Call `react` with the number of each signal while the context is open."""
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
    """Return whether a signal keeps the handler that it already has."""
    handler = signal.getsignal(number)
    if number == signal.SIGHUP:
        return handler is signal.SIG_IGN
    return number not in _present(ASKING) and handler not in (signal.SIG_DFL, None)


def at_once(number: int) -> None:
    """Interrupt the main thread by raising KeyboardInterrupt."""
    raise KeyboardInterrupt


def unless_hung_up(number: int) -> None:
    """Raise KeyboardInterrupt, except if the terminal was closed, so that files are still written."""
    if number != signal.SIGHUP:
        raise KeyboardInterrupt


@contextmanager
def as_ctrl_c() -> Iterator[None]:
    """Treat every other signal of `ENDING` as Ctrl-C while the context is open. An event loop then ends its task in
    order.

    A second Ctrl-C ends the task at once. A second SIGHUP, which a shell that closes sends, does not. Ctrl-C stays
    ignored if it was ignored (a command in the background of a script); the other signals then raise KeyboardInterrupt.
    """
    signals = Signals()

    def react(number: int) -> None:
        if signals.count > 1 and number == signal.SIGHUP:
            return
        if before is signal.SIG_IGN:
            raise KeyboardInterrupt
        signal.raise_signal(signal.SIGINT)

    before = signal.getsignal(signal.SIGINT)
    with signals.installed(), signals.reacting_with(react):
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, before)
        yield
