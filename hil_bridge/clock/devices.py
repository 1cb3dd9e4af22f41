"""Clock of emulated devices. An event has the time at which it was due, not the time of a late wake-up.

A computer calls back some time after the deadline and then needs time to compute. A real device has neither of
these delays. If an answer were calculated from the wake-up time, it would begin later on its line by that delay. A
chain of deadlines would fall further behind with each deadline.
"""

import copy
from collections.abc import Callable

from hil_bridge.clock.clock import Clock, Timer

EARLY_S = 60e-6
"""Lead time of the wake-up before a deadline, s. The remaining time is spent polling the clock, so that a device is
never early.

Chosen: approximately the time that a processor needs to wake from idle, so that the polling is short. An emulated
cell then needs as much processor time as without the lead. Without the lead, bytes of a paced line would reach
their client later.
"""


def device_clock(clock: Clock) -> Clock:
    """Return a clock for emulated devices and their lines, based on the loop and the timers of `clock`.

    Within a callback of `call_at`, its `now` is the requested time of the callback; elsewhere it is the time of the
    loop. It never goes back. In virtual time, in which nothing is late, `clock` itself is returned.
    """
    if clock.is_virtual:
        return clock
    due = _DueTime(clock.now, clock.call_at)
    devices = copy.copy(clock)
    devices.now, devices.call_at = due.now, due.call_at
    return devices


class _DueTime:
    """Time of the event that is being handled."""

    __slots__ = ("_call_at", "_due", "_newest", "_time")

    def __init__(
        self, time: Callable[[], float], call_at: Callable[[float, Callable[[], object]], Timer]
    ) -> None:
        self._time = time
        self._call_at = call_at
        self._newest = float("-inf")
        """Time of the newest event. A deadline may be handled after a later event."""
        self._due: float | None = None
        """Time of the deadline that is being handled."""

    def now(self) -> float:
        if self._due is None:
            self._newest = self._time()
            return self._newest
        return self._due

    def call_at(self, when: float, callback: Callable[[], object]) -> Timer:
        def handle() -> None:
            while self._time() < when:
                pass
            self._due = self._newest = max(when, self._newest)
            try:
                callback()
            finally:
                self._due = None

        return self._call_at(when - EARLY_S, handle)
