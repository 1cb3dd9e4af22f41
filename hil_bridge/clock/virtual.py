"""An event loop in virtual time: nothing ever waits, time jumps to the next timer.

The loop is asyncio's own but for its turn, its timers and its `time()`. A simulated minute is some tens of thousands of
turns. Asyncio's turn spends most of its time on files and clocks that are not there. Two private names of asyncio's
base loop are used because there is no public way to turn it otherwise: `_run_once`, and `_ready`, the callbacks of the
next turn.
"""

import asyncio
import itertools
from collections import deque
from collections.abc import Callable
from contextvars import Context
from heapq import heappop, heappush
from typing import Any, NoReturn

VIRTUAL_EPOCH = 7919.3
"""Virtual time when a loop begins, s.

Odd, so that code which anchors its deadlines at 0 fails in tests. Small, so that a float resolves 0.9 ps and sums of
microseconds stay exact to the nanosecond.
"""

VIRTUAL_WALL_NS = 1_600_000_000_000_000_000
"""UNIX time at VIRTUAL_EPOCH, ns: fixed, so that recordings made in virtual time repeat."""

TURNS_WITHOUT_TIME = 1_000_000
"""How often the loop may turn at one instant before it is taken to go round in circles."""


class VirtualTimeError(RuntimeError):
    """Something was asked for that virtual time does not have, or time cannot continue."""


class VirtualDeadlock(VirtualTimeError):
    """Nothing is ready and no timer is set: without a wire to wait for, nothing can ever happen again."""


class VirtualTimer:
    """A callback that waits for its instant; lighter than asyncio's, for it has no context and no arguments."""

    __slots__ = ("_callback", "_cancelled")

    def __init__(self, callback: Callable[[], object]) -> None:
        self._callback: Callable[[], object] | None = callback
        self._cancelled = False

    def cancel(self) -> None:
        """Never call it. Harmless when it was called or cancelled before."""
        self._cancelled = True
        self._callback = None

    def _run(self) -> None:
        """Run the callback; the loop calls this as it calls asyncio's own handles."""
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


class VirtualLoop(asyncio.SelectorEventLoop):
    """asyncio's loop in virtual time. File descriptors and threads belong to real time and are refused.

    Callbacks of the same instant run in the order in which they were asked for.
    """

    _ready: "deque[Any]"
    _stopping: bool

    def __init__(self) -> None:
        self._now = VIRTUAL_EPOCH
        self._turns = 0
        self._numbers = itertools.count()
        self._timers: list[tuple[float, int, Any]] = []
        """Heap of when, in what order, what."""
        super().__init__()

    def time(self) -> float:
        """Virtual time, s."""
        return self._now

    def call_at(  # type: ignore[override]
        self, when: float, callback: Callable[..., object], *args: Any, context: Context | None = None
    ) -> asyncio.TimerHandle:
        """As in asyncio."""
        timer = asyncio.TimerHandle(when, callback, args, self, context)
        heappush(self._timers, (when, next(self._numbers), timer))
        return timer

    def call_later(  # type: ignore[override]
        self, delay: float, callback: Callable[..., object], *args: Any, context: Context | None = None
    ) -> asyncio.TimerHandle:
        """As in asyncio."""
        return self.call_at(self._now + delay, callback, *args, context=context)

    def timer(self, when: float, callback: Callable[[], object]) -> VirtualTimer:
        """Call back at this instant, or on the next turn when it has passed."""
        timer = VirtualTimer(callback)
        heappush(self._timers, (when, next(self._numbers), timer))
        return timer

    def soon(self, callback: Callable[[], object]) -> VirtualTimer:
        """Call back on the next turn: as `call_soon`, but lighter."""
        timer = VirtualTimer(callback)
        self._ready.append(timer)
        return timer

    def _run_once(self) -> None:
        """One turn: what is ready; time continues only when nothing is."""
        ready, timers = self._ready, self._timers
        if ready or self._stopping:
            self._turns += 1
            if self._turns > TURNS_WITHOUT_TIME:
                self._turns = 0
                raise VirtualTimeError(
                    f"time stands still at {self._now:.9f} s after {TURNS_WITHOUT_TIME} turns of the loop; "
                    f"something asks to be called again at once, for ever; "
                    f"waiting: {describe_tasks(asyncio.all_tasks(self))}"
                )
        while not ready and not self._stopping:
            while timers and timers[0][2]._cancelled:
                heappop(timers)
            if not timers:
                raise VirtualDeadlock(
                    f"nothing can happen any more at {self._now:.9f} s: no timer is set and nothing is ready; "
                    f"waiting: {describe_tasks(asyncio.all_tasks(self))}"
                )
            when, _, handle = heappop(timers)
            if when > self._now:
                self._now = when
            self._turns = 0
            if timers and timers[0][0] <= self._now:
                ready.append(handle)
            else:
                handle._run()  # alone at its instant, which is most often so: the turn is its own
        now = self._now
        while timers and timers[0][0] <= now:
            ready.append(heappop(timers)[2])
        for _ in range(len(ready)):
            handle = ready.popleft()
            if not handle._cancelled:
                handle._run()

    def close(self) -> None:
        """As in asyncio; timers that still wait are forgotten, and with them all that their callbacks hold."""
        self._timers.clear()
        super().close()

    def run_in_executor(self, executor: Any, func: Any, *args: Any) -> NoReturn:  # type: ignore[override]
        """Threads take real time: always raises VirtualTimeError."""
        raise VirtualTimeError(f"no threads in virtual time: {getattr(func, '__qualname__', func)}")

    def add_reader(self, fd: Any, callback: Any, *args: Any) -> None:  # type: ignore[override]
        """Raise VirtualTimeError: virtual time does not wait for file descriptors."""
        raise VirtualTimeError("no file descriptors in virtual time: use memory wires, or real time")

    def add_writer(self, fd: Any, callback: Any, *args: Any) -> None:  # type: ignore[override]
        """Raise VirtualTimeError: virtual time does not wait for file descriptors."""
        raise VirtualTimeError("no file descriptors in virtual time: use memory wires, or real time")


def describe_tasks(tasks: set[asyncio.Task[Any]]) -> str:
    """Name and waiting place of each task, for error messages."""
    return ", ".join(sorted(f"{task.get_name()} ({_place(task)})" for task in tasks)) or "no task"


def _place(task: asyncio.Task[Any]) -> str:
    """File, line and coroutine in which a task is suspended."""
    coroutine: Any = task.get_coro()
    while getattr(getattr(coroutine, "cr_await", None), "cr_frame", None) is not None:
        coroutine = coroutine.cr_await
    frame = getattr(coroutine, "cr_frame", None)
    if frame is None:
        return "not in a coroutine"
    return f"{frame.f_code.co_filename.rpartition('/')[2]}:{frame.f_lineno} in {frame.f_code.co_name}"
