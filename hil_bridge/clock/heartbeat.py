"""Pauses of the computer: a timer that should have come, and came late."""

from hil_bridge.clock.clock import Clock, Timer

BEAT_S = 0.1
"""Chosen: how often the loop is looked at; a stop that is shorter than this may not show."""


class Heartbeat:
    """Beats in the loop's thread in real time; virtual time stands still for nothing."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._longest = 0.0
        self._due = 0.0
        self._timer: Timer | None = None

    def start(self) -> None:
        """Begin to beat."""
        if not self._clock.is_virtual:
            self._arm()

    def stop(self) -> None:
        """Beat no more. Harmless when called again."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def take(self) -> float:
        """Longest time by which a beat was late since the call before, s; one that is due now counts."""
        if self._timer is None:
            return 0.0
        late = max(self._longest, self._clock.now() - self._due)
        self._longest = 0.0
        return late

    def _arm(self) -> None:
        self._due = self._clock.now() + BEAT_S
        self._timer = self._clock.call_at(self._due, self._beat)

    def _beat(self) -> None:
        self._longest = max(self._longest, self._clock.now() - self._due)
        self._arm()
