"""Number of programs that have a file open, determined by means of inotify on Linux."""

import asyncio
import ctypes
import os
import struct
import sys
from collections.abc import Callable
from contextlib import suppress

_EVENT = struct.Struct("@iIII")
_OPENED, _CLOSED, _TOO_MANY = 0x20, 0x08 | 0x10, 0x4000
"""Event masks of inotify: opening, both kinds of closing, and lost events. Source: Linux, sys/inotify.h."""
_READ_BYTES = 4096


def _no_matter() -> None:
    """Do nothing."""


class OpenCount:
    """Count of the programs that have opened a file since this object was created and still have it open."""

    def __init__(self, path: str) -> None:
        self.count: int | None = None
        """Number of times that the file is open; None if unknown."""
        self._fd = -1
        self._on_emptied: Callable[[], object] = _no_matter
        self._loop: asyncio.AbstractEventLoop | None = None
        if sys.platform != "linux":
            return
        library = ctypes.CDLL(None)
        self._fd = library.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC)
        if self._fd < 0:
            return  # the user has too many watches
        if library.inotify_add_watch(self._fd, os.fsencode(path), _OPENED | _CLOSED) < 0:
            self.close()
        else:
            self.count = 0

    def watch(self, loop: asyncio.AbstractEventLoop, on_emptied: Callable[[], object]) -> None:
        """Call `on_emptied` whenever the last program has closed the file from now on."""
        if self.count is not None:
            self._loop, self._on_emptied = loop, on_emptied
            loop.add_reader(self._fd, self.update)

    def update(self) -> None:
        """Process pending events."""
        emptied = False
        while self.count is not None:
            try:
                events = os.read(self._fd, _READ_BYTES)
            except BlockingIOError:
                break
            except OSError:  # other code has closed it
                self.close()
                break
            for _, mask, _, _ in _EVENT.iter_unpack(events):
                if mask & _TOO_MANY:
                    self.close()
                    break
                if mask & _OPENED:
                    self.count += 1
                elif mask & _CLOSED:
                    self.count = max(0, self.count - 1)
                    emptied = emptied or not self.count
        if emptied:
            self._on_emptied()

    def close(self) -> None:
        """Stop counting."""
        self.count = None
        if self._loop is not None:
            self._loop.remove_reader(self._fd)
            self._loop = None
        if self._fd >= 0:
            with suppress(OSError):  # other code has already closed it
                os.close(self._fd)
            self._fd = -1
