"""The clock of an emulated KUKA controller: its beats, and the IPOC of its telegrams."""

import math

from emulators.devices.rsi.profile import RsiProfile
from protocol.devices.rsi.telegram import LARGEST_IPOC

_ROUNDING_S = 1e-9


class Clock:
    """Beats of a controller, one a cycle, from its power-up on."""

    def __init__(self, profile: RsiProfile, now: float) -> None:
        self._profile, self._powered_at, self._beats = profile, now, 0
        self.restart()

    def restart(self) -> None:
        """Restart the numbers of telegrams."""
        self.ipoc = self._profile.ipoc_start - self._profile.cycle_ms
        """IPOC of the newest telegram, ms."""

    @property
    def next_beat(self) -> float:
        """Time of the next beat, s."""
        return self._powered_at + self._beats * self._profile.period

    def take_beat(self, now: float) -> float:
        """Return the time of the newest beat that is due at `now`, s, and skip those before."""
        missed = math.floor((now - self.next_beat) / self._profile.period + _ROUNDING_S)
        self._beats += missed
        self.advance(missed)
        beat = self.next_beat
        self._beats += 1
        return beat

    def advance(self, cycles: int) -> None:
        """Advance the IPOC by a number of cycles."""
        self.ipoc = (self.ipoc + cycles * self._profile.cycle_ms) & LARGEST_IPOC

    def jump(self, time_ms: int) -> None:
        """Shift the IPOC, not below zero."""
        self.ipoc = max(0, self.ipoc + time_ms)
