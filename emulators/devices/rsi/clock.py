"""The clock of an emulated KUKA controller: its beats, and the number that its telegrams tell."""

import math

from emulators.devices.rsi.profile import RsiProfile
from protocol.devices.rsi.telegram import LARGEST_IPOC

_ROUNDING_S = 1e-9


class Clock:
    """Beats of a controller, one a cycle, from its power-up on."""

    def __init__(self, profile: RsiProfile, now: float) -> None:
        self._profile, self._powered_at, self._beats = profile, now, 0
        self.begin_anew()

    def begin_anew(self) -> None:
        """The next telegram is the first."""
        self.ipoc = self._profile.ipoc_start - self._profile.cycle_ms
        """Clock of the newest telegram, ms."""

    @property
    def next_beat(self) -> float:
        """s"""
        return self._powered_at + self._beats * self._profile.period

    def take_beat(self, now: float) -> float:
        """The newest beat that is due at `now`, s. Those before are skipped."""
        missed = math.floor((now - self.next_beat) / self._profile.period + _ROUNDING_S)
        self._beats += missed
        self.advance(missed)
        beat = self.next_beat
        self._beats += 1
        return beat

    def advance(self, cycles: int) -> None:
        """Count cycles on."""
        self.ipoc = (self.ipoc + cycles * self._profile.cycle_ms) & LARGEST_IPOC

    def jump(self, time_ms: int) -> None:
        """Go wrong by a time."""
        self.ipoc = max(0, self.ipoc + time_ms)
