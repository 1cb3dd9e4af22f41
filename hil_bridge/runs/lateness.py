"""Lateness of a process that emulates devices, whose clients observe it as late or missing packets."""

from collections.abc import Callable

from hil_bridge.clock import Clock, Heartbeat
from hil_bridge.clock.heartbeat import RECENT_S


class Lateness:
    """Counter of the seconds in which the process was late. It reports the first such second and each new maximum."""

    def __init__(self, cycle_s: float, report: Callable[[str], None]) -> None:
        """Create the counter. `cycle_s` is the cycle time of the emulated robot, s; infinite if it has no cycle."""
        self._cycle = cycle_s
        self._report = report
        self._seconds = self._late = 0
        self._longest = 0.0

    async def watch(self, clock: Clock) -> None:
        """Check the lateness once a second until the task is cancelled."""
        heart = Heartbeat(clock)
        heart.start()
        try:
            while True:
                await clock.sleep_until(clock.now() + RECENT_S)
                self.add(heart.recent(self._cycle))
        finally:
            heart.stop()

    def add(self, late_s: float) -> None:
        """Add one second in which the process was late by up to `late_s`, s; 0 if it was on time."""
        self._seconds += 1
        self._late += late_s > 0.0
        if late_s > self._longest:
            self._longest = late_s
            self._report(f"this process was late by up to {late_s * 1e3:.0f} ms, and its devices with it")

    def describe(self) -> str:
        """Return a one-line summary; empty if the process was on time."""
        if not self._late:
            return ""
        often = f"late in {self._late} of {self._seconds} s, by up to {self._longest * 1e3:.0f} ms"
        return f"this process was {often}: end other programs on this computer, or see [realtime]"
