"""Event loop in virtual time. Nothing ever waits; time jumps to the next timer.

The loop is asyncio's loop except for its iteration, its timers and its `time()`. A simulated minute takes some tens
of thousands of iterations. An iteration of asyncio spends most of its time on files and clocks that do not exist
here. Two private names of asyncio's base loop are used because there is no public alternative: `_run_once`, and
`_ready`, the callbacks of the next iteration.
"""

import asyncio
import itertools
import math
from bisect import insort
from collections import deque
from collections.abc import Callable
from contextvars import Context
from heapq import heappop, heappush
from typing import Any, ClassVar, NoReturn

from hil_bridge.clock.order import OrderDraws, VirtualOrder, callback_name

VIRTUAL_EPOCH = 7919.3
"""Virtual time at the start of a loop, s.

It is not a round number, so that code which anchors its deadlines at 0 fails in tests. It is small, so that a float
resolves 0.9 ps and sums of microseconds stay exact to the nanosecond.
"""

VIRTUAL_WALL_NS = 1_600_000_000_000_000_000
"""UNIX time at VIRTUAL_EPOCH, ns. It is fixed, so that recordings made in virtual time are reproducible."""

TURNS_WITHOUT_TIME = 1_000_000
"""Number of iterations at the same virtual time above which the loop counts as endless."""


class VirtualTimeError(RuntimeError):
    """Error for a request that virtual time does not support, or for time that cannot advance."""


class VirtualDeadlock(VirtualTimeError):
    """Error for a loop in which nothing is ready and no timer is set, so that nothing can ever happen again."""


class VirtualTimer:
    """Callback that is scheduled for a time. It is lighter than asyncio's timer, without context and arguments."""

    __slots__ = ("_callback", "_cancelled")

    def __init__(self, callback: Callable[[], object]) -> None:
        self._callback: Callable[[], object] | None = callback
        self._cancelled = False

    def cancel(self) -> None:
        """Cancel the callback. Idempotent; does nothing after the callback was called."""
        self._cancelled = True
        self._callback = None

    def _run(self) -> None:
        """Run the callback. Called by the loop, like asyncio's own handles."""
        callback = self._callback
        if callback is None:
            return
        try:
            callback()
        except (SystemExit, KeyboardInterrupt):
            raise
        except BaseException as error:
            text = f"Exception in callback {getattr(callback, '__qualname__', callback)}"
            asyncio.get_running_loop().call_exception_handler({"message": text, "exception": error})


class DeferrableTimer(VirtualTimer):
    """Timer of a device whose next messages may be handed over together, when the last of them is due."""

    __slots__ = ("last_deadline", "may_wait", "when")

    def __init__(
        self,
        when: float,
        last_deadline: Callable[[float], float],
        may_wait: Callable[[], bool],
        callback: Callable[[], object],
    ) -> None:
        super().__init__(callback)
        self.when, self.last_deadline, self.may_wait = when, last_deadline, may_wait


class VirtualLoop(asyncio.SelectorEventLoop):
    """Event loop of asyncio in virtual time. File descriptors and threads require real time and are refused.

    Callbacks with the same time run in the order in which they were requested, unless `order` draws another one.
    """

    usual_order: ClassVar[VirtualOrder] = VirtualOrder()
    """Order of every loop that is created without draws. pytest's option `--hil-order` sets it."""
    _ready: "deque[Any]"
    _stopping: bool

    def __init__(self, order: OrderDraws | None = None) -> None:
        self.order = order or self.usual_order.draws()
        """Draws of the order of callbacks; None for first in, first out."""
        self._now = VIRTUAL_EPOCH
        self._turns = 0
        self._numbers = itertools.count()
        self._timers: list[tuple[float, int, Any]] = []
        """Heap of timers: time, order, timer."""
        self._deferrable: list[DeferrableTimer] = []
        """Deferrable timers, by time."""
        super().__init__()

    def time(self) -> float:
        """Return the virtual time, s."""
        return self._now

    def call_at(  # type: ignore[override]
        self, when: float, callback: Callable[..., object], *args: Any, context: Context | None = None
    ) -> asyncio.TimerHandle:
        """Call back at a time, as in asyncio."""
        timer = asyncio.TimerHandle(when, callback, args, self, context)
        heappush(self._timers, (when, next(self._numbers), timer))
        return timer

    def call_later(  # type: ignore[override]
        self, delay: float, callback: Callable[..., object], *args: Any, context: Context | None = None
    ) -> asyncio.TimerHandle:
        """Call back after a delay, as in asyncio."""
        return self.call_at(self._now + delay, callback, *args, context=context)

    def timer(self, when: float, callback: Callable[[], object]) -> VirtualTimer:
        """Call back at this time, or in the next iteration if the time has passed."""
        timer = VirtualTimer(callback)
        heappush(self._timers, (when, next(self._numbers), timer))
        return timer

    def deferrable(
        self,
        when: float,
        last_deadline: Callable[[float], float],
        may_wait: Callable[[], bool],
        callback: Callable[[], object],
    ) -> VirtualTimer:
        """Call back at `when`, or later if `may_wait` returns True, but before any other callback with a later time.

        `last_deadline` maps the time of the next other callback to the time at which this one is then called.
        """
        timer = DeferrableTimer(when, last_deadline, may_wait, callback)
        insort(self._deferrable, timer, key=_due)
        return timer

    def soon(self, callback: Callable[[], object]) -> VirtualTimer:
        """Call back in the next iteration. Like `call_soon`, but lighter."""
        timer = VirtualTimer(callback)
        self._ready.append(timer)
        return timer

    def _run_once(self) -> None:
        """Run one iteration with all callbacks that are ready. Time advances only if none is ready."""
        ready, timers = self._ready, self._timers
        if ready or self._stopping:
            self._turns += 1
            if self._turns > TURNS_WITHOUT_TIME:
                self._turns = 0
                raise VirtualTimeError(
                    f"time does not advance at {self._now:.9f} s after {TURNS_WITHOUT_TIME} turns of the loop; "
                    f"a callback reschedules itself endlessly; "
                    f"waiting: {describe_tasks(asyncio.all_tasks(self))}"
                )
        while not ready and not self._stopping:
            while timers and timers[0][2]._cancelled:
                heappop(timers)
            if self._deferrable and self._run_deferrable(timers[0][0] if timers else None):
                continue
            if not timers:
                raise VirtualDeadlock(
                    f"nothing can happen any more at {self._now:.9f} s: no timer is set and nothing is ready; "
                    f"waiting: {describe_tasks(asyncio.all_tasks(self))}"
                )
            first = heappop(timers)
            when = first[0] if self.order is None else self.order.late(first[0])
            if when > self._now:
                self._now = when
            self._turns = 0
            if timers and timers[0][0] <= self._now:
                heappush(timers, first)
                break
            first[2]._run()  # usual case: a single callback at this time, which has a separate iteration
        now, untimed = self._now, len(ready)
        while timers and timers[0][0] <= now:
            ready.append(heappop(timers)[2])
        if self.order is not None:
            self._arrange(self.order, untimed)
        for _ in range(len(ready)):
            handle = ready.popleft()
            if not handle._cancelled:
                handle._run()

    def _arrange(self, order: OrderDraws, untimed: int) -> None:
        """Bring the ready callbacks into the drawn order: all, or only the timers, which follow the first `untimed`."""
        kept = 0 if order.shuffles_all else untimed
        callbacks = [handle for handle in itertools.islice(self._ready, kept, None) if not handle._cancelled]
        while len(self._ready) > kept:
            self._ready.pop()
        self._ready.extend(order.arranged(callbacks, self._now, callback_name))

    def _run_deferrable(self, until: float | None) -> bool:
        """Run the first deferrable timer up to the time of the next other timer. Return whether there was one."""
        first = self._deferrable[0]
        if first._cancelled:
            del self._deferrable[0]
            return True
        if until is None:
            due = first.when
        elif first.when > until:
            return False
        else:
            due = first.last_deadline(until) if first.may_wait() else first.when
            if due == until and self.order is not None:
                timer = self._timers[0][2]
                if self.order.arranged([first, timer], due, callback_name)[0] is timer:
                    before = math.nextafter(until, -math.inf)
                    if first.when > before:
                        return False
                    due = first.last_deadline(before)
        del self._deferrable[0]
        self._now = max(self._now, due)
        self._turns = 0
        first._run()
        return True

    def close(self) -> None:
        """Close the loop as asyncio does. Pending timers are dropped, together with all objects to which their
        callbacks refer.
        """
        self._timers.clear()
        self._deferrable.clear()
        super().close()

    def run_in_executor(self, executor: Any, func: Any, *args: Any) -> NoReturn:  # type: ignore[override]
        """Raise VirtualTimeError, because threads take real time."""
        raise VirtualTimeError(f"no threads in virtual time: {getattr(func, '__qualname__', func)}")

    def add_reader(self, fd: Any, callback: Any, *args: Any) -> None:  # type: ignore[override]
        """Raise VirtualTimeError, because virtual time does not wait for file descriptors."""
        raise VirtualTimeError("no file descriptors in virtual time: use memory wires, or real time")

    def add_writer(self, fd: Any, callback: Any, *args: Any) -> None:  # type: ignore[override]
        """Raise VirtualTimeError, because virtual time does not wait for file descriptors."""
        raise VirtualTimeError("no file descriptors in virtual time: use memory wires, or real time")


def _due(timer: DeferrableTimer) -> float:
    return timer.when


def describe_tasks(tasks: set[asyncio.Task[Any]]) -> str:
    """Return the name of each task and the position at which it waits, for error messages."""
    return ", ".join(sorted(f"{task.get_name()} ({_place(task)})" for task in tasks)) or "no task"


def _place(task: asyncio.Task[Any]) -> str:
    """Return the file, line and coroutine in which a task is suspended."""
    coroutine: Any = task.get_coro()
    while getattr(getattr(coroutine, "cr_await", None), "cr_frame", None) is not None:
        coroutine = coroutine.cr_await
    frame = getattr(coroutine, "cr_frame", None)
    if frame is None:
        return "not in a coroutine"
    return f"{frame.f_code.co_filename.rpartition('/')[2]}:{frame.f_lineno} in {frame.f_code.co_name}"
