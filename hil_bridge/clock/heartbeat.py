"""Detection of pauses of the computer, by a timer that comes late."""

from collections import deque

from hil_bridge.clock.clock import Clock, Timer

BEAT_S = 0.01
"""Chosen: interval of the beats; a pause that is shorter may not be detected."""
RECENT_S = 1.0
"""Chosen: age up to which a pause is related to present events."""
LEAST_S, MOST_S = 0.01, 0.05
"""Chosen: a pause below the first one is normal on a healthy computer; one above the second one always counts."""
CYCLES = 2
"""Chosen: robot cycles from which a pause between these two counts."""


class Heartbeat:
    """Heartbeat of the loop's thread in real time; virtual time has no pauses."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._longest = 0.0
        self._due = 0.0
        self._timer: Timer | None = None
        self._pauses: deque[tuple[float, float]] = deque(maxlen=round(RECENT_S / BEAT_S))
        """Times of late beats, s on the clock, and their delays, s."""

    def start(self) -> None:
        """Start the beats. Idempotent."""
        if self._timer is None and not self._clock.is_virtual:
            self._arm()

    def stop(self) -> None:
        """Stop the beats. Idempotent."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def take(self) -> float:
        """Return the longest delay of a beat since the last call, s; one that is due now counts."""
        if self._timer is None:
            return 0.0
        late = max(self._longest, self._clock.now() - self._due)
        self._longest = 0.0
        return late

    def recent(self, cycle_s: float) -> float:
        """Return the longest delay of a beat in the last second, s; 0 if it does not matter to such a robot."""
        now = self._clock.now()
        late = [seconds for at, seconds in self._pauses if now - at <= RECENT_S]
        if self._timer is not None:
            late.append(now - self._due)
        longest = max(late, default=0.0)
        return longest if longest >= min(MOST_S, max(LEAST_S, CYCLES * cycle_s)) else 0.0

    def _arm(self) -> None:
        self._due = self._clock.now() + BEAT_S
        self._timer = self._clock.call_at(self._due, self._beat)

    def _beat(self) -> None:
        now = self._clock.now()
        self._longest = max(self._longest, now - self._due)
        if now - self._due >= LEAST_S:
            self._pauses.append((now, now - self._due))
        self._arm()
