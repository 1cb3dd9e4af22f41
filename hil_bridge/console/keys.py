"""Single key presses in the terminal from which a run was started, without Enter.

Keys that send signals, such as Ctrl-C, still do so. Source: Linux, termios(3): ICANON and ECHO off, ISIG on.
"""

import os
import select
import sys
import termios
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

_CLOSE_SECONDS = 0.5
"""Longest wait for the end of the thread, s. Chosen: the thread wakes at once."""
_BACKGROUND_SECONDS = 0.2
"""Interval at which the process checks whether it is in the foreground again, s. Chosen: not noticeable."""


def is_interactive() -> bool:
    """Return whether standard input is the terminal of this process. The process must be in the foreground to
    change the terminal.
    """
    try:
        return sys.stdin.isatty() and os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    except (AttributeError, OSError, ValueError):  # standard input is missing or closed
        return False


@contextmanager
def listen_for_keys(react: Callable[[str], object]) -> Iterator[None]:
    """Call `react` with each key inside the context, in a separate thread. Restore the terminal at the end."""
    if not is_interactive():
        yield
        return
    source = sys.stdin.fileno()
    before = termios.tcgetattr(source)
    single = termios.tcgetattr(source)
    single[3] &= ~(termios.ICANON | termios.ECHO)
    woken, wake = os.pipe()
    thread = threading.Thread(target=_read, args=(source, woken, react), name="keys", daemon=True)
    try:
        # not TCSADRAIN, which waits while the terminal is paused
        termios.tcsetattr(source, termios.TCSANOW, single)
        single = termios.tcgetattr(source)  # the settings are reported in another form than they were set
        thread.start()
        yield
    finally:
        os.close(wake)
        thread.join(_CLOSE_SECONDS)
        if not thread.is_alive():
            os.close(woken)
        with suppress(OSError, termios.error):  # the terminal is closed
            # in the background, the shell may have changed the terminal, which then belongs to the shell
            if is_interactive() or termios.tcgetattr(source) == single:
                termios.tcsetattr(source, termios.TCSANOW, before)


def _read(source: int, woken: int, react: Callable[[str], object]) -> None:
    """Pass on typed keys until the other end of `woken` is closed or the terminal is closed."""
    while True:
        ready, _, _ = select.select([source, woken], [], [])
        if woken in ready:
            return
        if not is_interactive():  # reading in the background would stop the process, SIGTTIN
            if select.select([woken], [], [], _BACKGROUND_SECONDS)[0]:
                return
            continue
        try:
            typed = os.read(source, 64)
        except OSError:
            return
        if not typed:
            return
        for key in typed.decode("ascii", "ignore"):
            react(key)
