"""Selectors of an event loop: a selector that detects files closed by other code, and one that polls before it
sleeps.
"""

import asyncio
import errno
import os
import selectors
import time
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

CHECK_S = 0.25
"""Time between two checks of the files, s. Chosen: well below the time-outs of a robot or a sensor."""

_Ready = list[tuple[selectors.SelectorKey, int]]


class WatchfulSelector(selectors.BaseSelector):
    """Platform selector that reports a file closed by other code as ready once, so that its reader receives the
    error.

    The platform's selector silently forgets such a file, and a wire that is only read would be silent forever. The
    selector's own file is recreated if it was closed.
    """

    def __init__(self) -> None:
        self._inner: selectors.BaseSelector = selectors.DefaultSelector()
        self._lost: list[selectors.BaseSelector] = []
        """Selectors whose own file was closed. They are kept because freeing a selector closes its file number,
        which by then belongs to another file.
        """
        self._checked = time.monotonic()
        self._reported: set[int] = set()
        """Closed files that have been reported as ready; each is reported once."""

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        """Register a file; see the base class."""
        key = self._inner.register(fileobj, events, data)
        self._reported.discard(key.fd)
        return key

    def unregister(self, fileobj: Any) -> selectors.SelectorKey:
        """Unregister a file; see the base class."""
        return self._inner.unregister(fileobj)

    def modify(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        """Modify a registration; see the base class."""
        return self._inner.modify(fileobj, events, data)

    def get_map(self) -> Mapping[Any, selectors.SelectorKey]:
        """Return the registered files; see the base class."""
        return self._inner.get_map()

    def select(self, timeout: float | None = None) -> _Ready:
        """Wait for ready files; see the base class. Also returns early, with no files, to check the files again."""
        try:
            ready = self._inner.select(CHECK_S if timeout is None else min(timeout, CHECK_S))
        except OSError as error:
            if error.errno not in (errno.EBADF, errno.EINVAL):
                raise
            return self._recreate()
        now = time.monotonic()
        if now - self._checked < CHECK_S:
            return ready
        self._checked = now
        known = {key.fd for key, _ in ready} | self._reported
        closed = [key for key in self.get_map().values() if key.fd not in known and not is_open(key.fd)]
        self._reported.update(key.fd for key in closed)
        return ready + [(key, key.events) for key in closed]

    def close(self) -> None:
        """Close the selector; see the base class."""
        with suppress(OSError):  # other code has closed the file of the selector
            self._inner.close()

    def _recreate(self) -> _Ready:
        """Watch the same files with a new selector. Closed files are ready."""
        keys = list(self.get_map().values())
        self._lost.append(self._inner)
        self._inner = selectors.DefaultSelector()
        closed: _Ready = []
        for key in keys:
            try:
                self._inner.register(key.fileobj, key.events, key.data)
            except (OSError, ValueError):
                closed.append((key, key.events))
        return closed


def is_open(fd: int) -> bool:
    """Return whether a file descriptor is open."""
    try:
        os.fstat(fd)
    except OSError:
        return False
    return True


class WatchfulLoop(asyncio.SelectorEventLoop):
    """Event loop of asyncio that also ends properly if other code has closed its files."""

    def __init__(self, selector: WatchfulSelector) -> None:
        super().__init__(selector)
        self._watching = selector

    def call_exception_handler(self, context: dict[str, Any]) -> None:
        """Handle an exception as asyncio does. A closed file is reported in one line."""
        error = context.get("exception")
        if isinstance(error, OSError) and error.errno == errno.EBADF:
            context = {"message": f"other code has closed a file of the event loop: {context['message']}"}
        super().call_exception_handler(context)

    def close(self) -> None:
        """Close the loop as asyncio does."""
        try:
            super().close()
        except (OSError, ValueError):
            asyncio.BaseEventLoop.close(self)
            self._watching.close()


class BusyPolling(WatchfulSelector):
    """Selector that polls for a while before it lets the operating system put the thread to sleep.

    A sleeping thread releases its processor, which then sleeps as well. Waking both takes tens of microseconds, and
    more in a virtual machine. A polling thread avoids this delay, but uses one processor fully.
    """

    def __init__(self, awake_s: float) -> None:
        """Create a selector. `awake_s` is the time for which it polls from the start of every wait, s."""
        super().__init__()
        self._awake_s = awake_s

    def select(self, timeout: float | None = None) -> _Ready:
        """Wait until a file is ready or the time is over; see the base class. A `timeout` of 0 or less polls once.

        Once asleep, it only wakes to check the files again. It does not resume polling within the same wait.
        """
        poll = super().select
        if timeout is not None and timeout <= 0:
            return poll(timeout)
        began = time.monotonic()
        ends = None if timeout is None else began + timeout
        while (now := time.monotonic()) < began + self._awake_s and (ends is None or now < ends):
            if ready := poll(0):
                return ready
        while True:
            ready = poll(None if ends is None else max(0.0, ends - time.monotonic()))
            if ready or (ends is not None and time.monotonic() >= ends):
                return ready
