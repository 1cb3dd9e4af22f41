"""Clock that is passed to all other parts of the project. No other part reads a clock."""

import asyncio
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from typing import Protocol

from hil_bridge.clock.order import VirtualOrder
from hil_bridge.clock.virtual import VIRTUAL_EPOCH, VIRTUAL_WALL_NS, VirtualLoop

if sys.platform == "linux":
    from hil_bridge.clock.timerfd import PreciseTimers


def wall_time() -> datetime:
    """Return the local date and time, for display and for names."""
    return datetime.now().astimezone()


class Timer(Protocol):
    """Callback that is scheduled for a time."""

    def cancel(self) -> None:
        """Cancel the callback. Idempotent; does nothing after the callback was called."""


@dataclass(frozen=True, slots=True)
class WallTime:
    """Conversion of a clock's times to UNIX time. It is anchored once, so that differences are the differences of
    the clock.
    """

    anchor: float
    """Time of the clock at the anchor, s."""
    anchor_ns: int
    """UNIX time at the anchor, ns."""

    def __call__(self, when: float) -> int:
        """Return the UNIX time of the clock time `when`, ns."""
        return self.anchor_ns + round((when - self.anchor) * 1e9)


class Clock:
    """Time of one event loop: precise in real time on Linux, exact in virtual time."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.loop = loop
        self.is_virtual = isinstance(loop, VirtualLoop)
        """Whether time is virtual: nothing waits, and callbacks run exactly at their time."""
        self.now: Callable[[], float] = loop.time if self.is_virtual else time.monotonic
        """Return the present time, s. In real time this is the clock of asyncio's loop, which other loops may
        report with a resolution of 1 ms only.
        """
        self.call_at: Callable[[float, Callable[[], object]], Timer] = loop.call_at
        """Call back at a time, s on this clock. If the time has passed, call back soon, but never before this
        returns.

        In real time, callbacks with the same time run in no particular order.
        """
        self.call_soon: Callable[[Callable[[], object]], Timer] = loop.call_soon
        """Call back in the next iteration of the loop."""
        self.may_defer = False
        """Whether the data of a deferrable timer may come late, because no task waits for them. A reader sets it."""
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
        """Return a clock for the running loop. The caller closes the clock."""
        return cls(asyncio.get_running_loop())

    def draw_order(self, order: VirtualOrder) -> None:
        """Run callbacks in this order from now on, or in that with which the loop was created. Does nothing in real
        time.
        """
        if not isinstance(self.loop, VirtualLoop):
            return
        if self.loop.order is None:
            self.loop.order = order.draws()
        else:
            self.loop.order.active = True

    def call_deferrable(
        self, when: float, last_deadline: Callable[[float], float], callback: Callable[[], object]
    ) -> Timer:
        """Call back at a time, s, as `call_at` does. In virtual time, while `may_defer` is set, call back only once
        for everything that is due before the next other callback.

        `last_deadline` maps the time of that callback to the time of the last deadline until then, s.
        """
        if isinstance(self.loop, VirtualLoop):
            return self.loop.deferrable(when, last_deadline, self._defers, callback)
        return self.call_at(when, callback)

    def _defers(self) -> bool:
        return self.may_defer

    async def sleep_until(self, when: float) -> None:
        """Return at `when`, s on this clock, or after one iteration of the loop if `when` has passed."""
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
        """Return this clock's time for a UNIX time stamp, s, that a kernel or device made shortly before.

        A stamp that is in the future, or more than a second in the past, is implausible. The result is then the
        present time.
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
