"""Clock that is passed to everything else. No other part of the project reads one."""

import asyncio
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from typing import Protocol

from hil_bridge.clock.virtual import VIRTUAL_EPOCH, VIRTUAL_WALL_NS, VirtualLoop

if sys.platform == "linux":
    from hil_bridge.clock.timerfd import PreciseTimers


def wall_time() -> datetime:
    """Return the local date and time, for display and names."""
    return datetime.now().astimezone()


class Timer(Protocol):
    """Callback that waits for its time."""

    def cancel(self) -> None:
        """Cancel the callback. Idempotent, also after the callback was called."""


@dataclass(frozen=True, slots=True)
class WallTime:
    """Conversion of a clock's times to UNIX time, anchored once, so that differences are those of the clock."""

    anchor: float
    """Time of the clock, s."""
    anchor_ns: int
    """UNIX time of the same moment, ns."""

    def __call__(self, when: float) -> int:
        """Return the UNIX time of `when`, ns."""
        return self.anchor_ns + round((when - self.anchor) * 1e9)


class Clock:
    """Time of one event loop: precise in real time on Linux, exact in virtual time."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.loop = loop
        self.is_virtual = isinstance(loop, VirtualLoop)
        """Whether time is virtual: nothing waits, and callbacks run at their exact instant."""
        self.now: Callable[[], float] = loop.time if self.is_virtual else time.monotonic
        """Present time, s. In real time it is the clock of asyncio's loop, which other loops may report with 1
        ms only.
        """
        self.call_at: Callable[[float, Callable[[], object]], Timer] = loop.call_at
        """Call back at a time, s on this clock; soon, but never before this returns, if that has passed.

        In real time, callbacks of the same instant run in no particular order.
        """
        self.call_soon: Callable[[Callable[[], object]], Timer] = loop.call_soon
        """Call back on the loop's next turn."""
        self._close: Callable[[], None] | None = None
        if isinstance(loop, VirtualLoop):
            self.call_at, self.call_soon = loop.timer, loop.soon
            self.wall_ns = WallTime(VIRTUAL_EPOCH, VIRTUAL_WALL_NS)
            """UNIX time of a time of this clock, ns. It needs no loop."""
            return
        self.wall_ns = WallTime(self.now(), time.time_ns())
        if sys.platform == "linux":
            timers = PreciseTimers(loop)
            self.call_at, self._close = timers.call_at, timers.close

    @classmethod
    def running(cls) -> "Clock":
        """Return a clock for the running loop; the caller closes it."""
        return cls(asyncio.get_running_loop())

    async def sleep_until(self, when: float) -> None:
        """Return at `when`, s on this clock; if that has passed, after one turn of the loop."""
        if when <= self.now():
            await asyncio.sleep(0)
            return
        woken = self.loop.create_future()
        timer = self.call_at(when, lambda: None if woken.done() else woken.set_result(None))
        try:
            await woken
        finally:
            timer.cancel()

    def at_wall(self, wall: float) -> float:
        """Return this clock's time of a UNIX time stamp, s, that a kernel or device made moments ago.

        A stamp in the future or more than a second in the past is implausible: then it is the present time.
        """
        now = self.now()
        if self.is_virtual:
            return now
        age = time.time() - wall
        return now - age if 0.0 <= age <= 1.0 else now

    def close(self) -> None:
        """Release the timer; pending callbacks are dropped. Idempotent."""
        if self._close is not None:
            self._close()
