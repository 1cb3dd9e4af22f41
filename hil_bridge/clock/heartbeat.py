"""Detection of pauses of the computer by means of a timer that expires late."""

from collections import deque

from hil_bridge.clock.clock import Clock, Timer

BEAT_S = 0.01
"""Interval of the beats, s. Chosen: a shorter pause may not be detected."""
RECENT_S = 1.0
"""Age up to which a pause is related to present events, s. Chosen."""
LEAST_S, MOST_S = 0.01, 0.05
"""Limits of the duration of a pause, s. Chosen: a pause below `LEAST_S` is normal on a healthy computer; a pause
above `MOST_S` always counts.
"""
CYCLES = 2
"""Number of robot cycles above which a pause between `LEAST_S` and `MOST_S` counts. Chosen."""


class Heartbeat:
    """Heartbeat of the loop's thread in real time; virtual time has no pauses."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._longest = 0.0
        self._due = 0.0
        self._timer: Timer | None = None
        self._pauses: deque[tuple[float, float]] = deque(maxlen=round(RECENT_S / BEAT_S))
        """Times of late beats, s on the clock, with their delays, s."""

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
        """Return the longest delay of a beat since the last call, s. A beat that is due now counts too."""
        if self._timer is None:
            return 0.0
        late = max(self._longest, self._clock.now() - self._due)
        self._longest = 0.0
        return late

    def recent(self, cycle_s: float) -> float:
        """Return the longest delay of a beat in the last second, s, or 0 if the delay does not matter to a robot
        with this cycle.
        """
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
