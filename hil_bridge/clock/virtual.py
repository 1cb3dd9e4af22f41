"""An event loop in virtual time: nothing ever waits, time jumps to the next timer.

The loop is asyncio's own; only its selector and its `time()` differ. Two private names of asyncio's base loop
are used because there is no public way to make a jump exact: `_scheduled`, the heap of timers, and
`_clock_resolution`, the span within which timers run together.
"""

import asyncio
import math
import selectors
from typing import Any, NoReturn

VIRTUAL_EPOCH = 7919.3
"""Virtual time when a loop begins, s.

Odd, so that code which anchors its deadlines at 0 fails in tests; small, so that a float resolves 0.9 ps and
sums of microseconds stay exact to the nanosecond.
"""

VIRTUAL_WALL_NS = 1_600_000_000_000_000_000
"""UNIX time at VIRTUAL_EPOCH, ns: fixed, so that recordings made in virtual time repeat."""

TURNS_WITHOUT_TIME = 1_000_000
"""How often the loop may turn at one instant before it is taken to go round in circles."""


class VirtualTimeError(RuntimeError):
    """Something was asked for that virtual time does not have, or time cannot go on."""


class VirtualDeadlock(VirtualTimeError):
    """Nothing is ready and no timer is set: without a wire to wait for, nothing can ever happen again."""


class VirtualLoop(asyncio.SelectorEventLoop):
    """asyncio's loop in virtual time. File descriptors and threads belong to real time and are refused."""

    _scheduled: list[asyncio.TimerHandle]
    _clock_resolution: float

    def __init__(self) -> None:
        self._now = VIRTUAL_EPOCH
        self._turns = 0
        super().__init__(_JumpingSelector(self))
        self._clock_resolution = math.ulp(self._now)

    def time(self) -> float:
        """Virtual time, s."""
        return self._now

    def pass_time(self, timeout: float | None) -> None:
        """Called where a real loop would wait: jump to the next timer if nothing is ready."""
        if timeout is None:
            raise VirtualDeadlock(
                f"nothing can happen any more at {self._now:.9f} s: no timer is set and nothing is ready; "
                f"waiting: {describe_tasks(asyncio.all_tasks(self))}"
            )
        if timeout > 0:
            self._now = self._scheduled[0].when()
            # asyncio runs the timers before `time() + resolution`: one step of a float is this instant alone
            self._clock_resolution = math.ulp(self._now)
            self._turns = 0
            return
        self._turns += 1
        if self._turns > TURNS_WITHOUT_TIME:
            self._turns = 0
            raise VirtualTimeError(
                f"time stands still at {self._now:.9f} s after {TURNS_WITHOUT_TIME} turns of the loop; "
                f"something asks to be called again at once, for ever; "
                f"waiting: {describe_tasks(asyncio.all_tasks(self))}"
            )

    def run_in_executor(self, executor: Any, func: Any, *args: Any) -> NoReturn:  # type: ignore[override]
        """Threads take real time: always raises VirtualTimeError."""
        raise VirtualTimeError(f"no threads in virtual time: {getattr(func, '__qualname__', func)}")

    def add_reader(self, fd: Any, callback: Any, *args: Any) -> None:  # type: ignore[override]
        """Nobody waits for a file descriptor here: always raises VirtualTimeError."""
        raise VirtualTimeError("no file descriptors in virtual time: use memory wires, or real time")

    def add_writer(self, fd: Any, callback: Any, *args: Any) -> None:  # type: ignore[override]
        """Nobody waits for a file descriptor here: always raises VirtualTimeError."""
        raise VirtualTimeError("no file descriptors in virtual time: use memory wires, or real time")


class _JumpingSelector(selectors.SelectSelector):
    """A selector that never looks at its files (the loop keeps one of its own) and never blocks."""

    def __init__(self, loop: VirtualLoop) -> None:
        super().__init__()
        self._loop = loop

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        self._loop.pass_time(timeout)
        return []


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
