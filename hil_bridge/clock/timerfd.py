"""Precise timers on Linux: one timerfd with a heap of deadlines.

Asyncio rounds every wait up to the next millisecond, because epoll does. A timerfd wakes the loop with microsecond
precision. Reference: timerfd_create(2).
"""

import asyncio
import ctypes
import heapq
import itertools
import math
import os
import sys
import time
from collections.abc import Callable
from contextlib import suppress

_CLOCK_MONOTONIC = 1
_TFD_TIMER_ABSTIME = 1
_COMPACT_FROM = 64
"""Number of cancelled deadlines above which the heap is compacted."""


class Deadline:
    """Callback that is scheduled for a time."""

    __slots__ = ("_timers", "callback")

    def __init__(self, timers: "PreciseTimers", callback: Callable[[], object]) -> None:
        self._timers = timers
        self.callback: Callable[[], object] | None = callback

    def cancel(self) -> None:
        """Cancel the callback. Idempotent; does nothing after the callback was called."""
        if self.callback is not None:
            self.callback = None
            self._timers.count_cancelled()


class PreciseTimers:
    """Timers on the monotonic clock, which is also the clock of asyncio's loop."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._heap: list[tuple[float, int, Deadline]] = []
        self._order = itertools.count()
        self._cancelled = 0
        self._expiring = False
        self._fd = _create()
        self._loop_timer: asyncio.TimerHandle | None = None
        """Timer of the loop itself, which is used if other code has closed the file."""
        self._lost = False
        loop.add_reader(self._fd, self._expired)

    def call_at(self, when: float, callback: Callable[[], object]) -> Deadline:
        """Call back at `when`, s. If that time has passed, call back at once, but not before returning to the loop."""
        if self._fd < 0:
            raise RuntimeError("the clock is closed")
        deadline = Deadline(self, callback)
        heapq.heappush(self._heap, (when, next(self._order), deadline))
        if self._heap[0][2] is deadline and not self._expiring:
            self._arm()
        return deadline

    def count_cancelled(self) -> None:
        """Count a cancelled deadline. Keep the heap small if most deadlines are cancelled, as time-outs are."""
        self._cancelled += 1
        if self._cancelled > _COMPACT_FROM and 2 * self._cancelled > len(self._heap):
            self._heap = [entry for entry in self._heap if entry[2].callback is not None]
            heapq.heapify(self._heap)
            self._cancelled = 0

    def close(self) -> None:
        """Drop all deadlines. Idempotent."""
        if self._fd >= 0:
            self._loop.remove_reader(self._fd)
            if self._loop_timer is not None:
                self._loop_timer.cancel()
            if not self._lost:
                with suppress(OSError):  # closed by other code
                    os.close(self._fd)
            self._fd = -1
            self._heap.clear()

    def _arm(self) -> None:
        when = self._heap[0][0]
        if not self._lost:
            try:
                # rounded up, so that it never wakes early; 0 would disarm the timer
                _set_absolute(self._fd, max(1, math.ceil(when * 1e9)))
                return
            except OSError:
                self._lose()
        if self._loop_timer is not None:
            self._loop_timer.cancel()
        self._loop_timer = self._loop.call_at(when, self._expire)

    def _lose(self) -> None:
        """Continue with the timers of the loop, with a resolution of 1 ms, so that nothing hangs because the file
        was closed.
        """
        self._lost = True
        self._loop.remove_reader(self._fd)
        message = "other code has closed the file of the timers; timers now have a resolution of 1 ms"
        self._loop.call_exception_handler({"message": message})

    def _expired(self) -> None:
        try:
            os.read(self._fd, 8)
        except BlockingIOError:
            return
        except OSError:
            self._lose()
        self._expire()

    def _expire(self) -> None:
        """Call back all deadlines that are due, and wait for the next one."""
        now = time.monotonic()
        self._expiring = True
        try:
            # a deadline that a callback sets waits for the next iteration of the loop; otherwise wires would starve
            while self._heap and self._heap[0][0] <= now:
                deadline = heapq.heappop(self._heap)[2]
                callback, deadline.callback = deadline.callback, None
                if callback is None:
                    self._cancelled = max(0, self._cancelled - 1)
                    continue
                try:
                    callback()
                except (SystemExit, KeyboardInterrupt):
                    raise
                except BaseException as error:
                    self._loop.call_exception_handler(
                        {"message": f"Exception in timer {callback!r}", "exception": error}
                    )
        finally:
            self._expiring = False
            if self._heap and self._fd >= 0:
                self._arm()


if sys.version_info >= (3, 13):

    def _create() -> int:
        return os.timerfd_create(_CLOCK_MONOTONIC, flags=os.TFD_NONBLOCK | os.TFD_CLOEXEC)

    def _set_absolute(fd: int, when_ns: int) -> None:
        os.timerfd_settime_ns(fd, flags=_TFD_TIMER_ABSTIME, initial=when_ns)

else:
    _LIBC = ctypes.CDLL(None, use_errno=True)

    class _TimerSpec(ctypes.Structure):
        """struct itimerspec: interval, then first expiry."""

        _fields_ = (
            ("interval_s", ctypes.c_long),
            ("interval_ns", ctypes.c_long),
            ("s", ctypes.c_long),
            ("ns", ctypes.c_long),
        )

    def _create() -> int:
        # TFD_NONBLOCK and TFD_CLOEXEC are O_NONBLOCK and O_CLOEXEC
        return _checked(_LIBC.timerfd_create(_CLOCK_MONOTONIC, os.O_NONBLOCK | os.O_CLOEXEC))

    def _set_absolute(fd: int, when_ns: int) -> None:
        spec = _TimerSpec(0, 0, *divmod(when_ns, 1_000_000_000))
        _checked(_LIBC.timerfd_settime(fd, _TFD_TIMER_ABSTIME, ctypes.byref(spec), None))

    def _checked(result: int) -> int:
        if result < 0:
            number = ctypes.get_errno()
            raise OSError(number, os.strerror(number))
        return result
