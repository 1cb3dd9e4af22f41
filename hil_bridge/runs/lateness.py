"""Lateness of a process that emulates devices, whose clients then observe late or missing packets."""

from collections.abc import Callable

from hil_bridge.clock import Clock, Heartbeat
from hil_bridge.clock.heartbeat import RECENT_S


class Lateness:
    """Counts the seconds in which the process was late; reports the first one and each new maximum."""

    def __init__(self, cycle_s: float, tell: Callable[[str], None]) -> None:
        """`cycle_s` is the cycle of the emulated robot, s; infinite if it has none."""
        self._cycle = cycle_s
        self._tell = tell
        self._seconds = self._late = 0
        self._longest = 0.0

    async def watch(self, clock: Clock) -> None:
        """Check once a second until cancelled."""
        heart = Heartbeat(clock)
        heart.start()
        try:
            while True:
                await clock.sleep_until(clock.now() + RECENT_S)
                self.add(heart.recent(self._cycle))
        finally:
            heart.stop()

    def add(self, late_s: float) -> None:
        """Count a second in which the process was late by up to so much, s; 0 for one in which it was in time."""
        self._seconds += 1
        self._late += late_s > 0.0
        if late_s > self._longest:
            self._longest = late_s
            self._tell(f"this process was late by up to {late_s * 1e3:.0f} ms, and its devices with it")

    def describe(self) -> str:
        """Summary in one line; empty for a process that was on time."""
        if not self._late:
            return ""
        often = f"late in {self._late} of {self._seconds} s, by up to {self._longest * 1e3:.0f} ms"
        return f"this process was {often}: end other programs on this computer, or see [realtime]"
