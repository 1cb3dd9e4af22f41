"""Clock of an emulated KUKA controller: its cycles, and the IPOC of its telegrams."""

import math

from emulators.devices.rsi.profile import RsiProfile
from protocol.devices.rsi.telegram import LARGEST_IPOC

_ROUNDING_S = 1e-9


class Clock:
    """Cycle times of a controller, counted from its power-up."""

    def __init__(self, profile: RsiProfile, now: float) -> None:
        self._profile, self._powered_at, self._cycles = profile, now, 0
        self.restart()

    def restart(self) -> None:
        """Restart the numbering of telegrams."""
        self.ipoc = self._profile.ipoc_start - self._profile.cycle_ms
        """IPOC of the newest telegram, ms."""

    @property
    def next_cycle_time(self) -> float:
        """Return the time of the next cycle, s."""
        return self._powered_at + self._cycles * self._profile.period

    def take_due_cycle(self, now: float) -> float:
        """Return the time of the newest cycle that is due at `now`, s. Earlier cycles are skipped."""
        missed = math.floor((now - self.next_cycle_time) / self._profile.period + _ROUNDING_S)
        self._cycles += missed
        self.advance(missed)
        cycle_time = self.next_cycle_time
        self._cycles += 1
        return cycle_time

    def advance(self, cycles: int) -> None:
        """Advance the IPOC by a number of cycles."""
        self.ipoc = (self.ipoc + cycles * self._profile.cycle_ms) & LARGEST_IPOC

    def jump(self, time_ms: int) -> None:
        """Shift the IPOC, but not below zero."""
        self.ipoc = max(0, self.ipoc + time_ms)
