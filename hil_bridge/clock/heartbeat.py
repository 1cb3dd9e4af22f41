"""Pauses of the computer: a timer that should have come, and came late."""

from collections import deque

from hil_bridge.clock.clock import Clock, Timer

BEAT_S = 0.01
"""Chosen: how often the loop is looked at; a stop that is shorter than this may not show."""
RECENT_S = 1.0
"""Chosen: a pause that is older than this has no part in what happens now."""
LEAST_S, MOST_S = 0.01, 0.05
"""Chosen: a pause below the first one is usual on a healthy computer; one above the second one always counts."""
CYCLES = 2
"""Chosen: between them a pause counts from so many cycles of the robot on."""


class Heartbeat:
    """Beats in the loop's thread in real time; virtual time stands still for nothing."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._longest = 0.0
        self._due = 0.0
        self._timer: Timer | None = None
        self._pauses: deque[tuple[float, float]] = deque(maxlen=round(RECENT_S / BEAT_S))
        """When a beat came that was late, s on the clock, and by how much, s."""

    def start(self) -> None:
        """Begin to beat. Harmless when called again."""
        if self._timer is None and not self._clock.is_virtual:
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

    def recent(self, cycle_s: float) -> float:
        """Longest time by which a beat of the last second was late, s; 0 where it does not matter to such a robot."""
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
