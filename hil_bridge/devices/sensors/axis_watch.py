"""Detection of dead axes of a sensor, from its values alone, frame by frame. Pure.

A quiet axis cannot be distinguished from a dead one while nothing moves: behind a slow filter it may repeat its value
for minutes. But a live axis changes now and then after a zero, by noise alone. No real axis stays constant while
another moves by a tenth of its full scale. So an axis counts as dead if it has not changed once since the zero, for
long, although another moved that far.
"""

from collections.abc import Sequence

from protocol.wrench import AXES, SensorFacts

DEAD_AFTER_S = 3.9
"""Chosen: a quiet live axis was observed to change within 0.4 s of a zero; ten times that, less a little."""
DEAD_WHILE_MOVED_SHARE = 0.1
"""Share of full scale. Chosen: far more than one axis of a real sensor can move without affecting the others."""
DEAD_WHILE_MOVED = (10.0, 10.0, 10.0, 0.5, 0.5, 0.5)
"""The same in N and N·m for a sensor that does not report its full scales. Chosen: a tenth of a small sensor's, because
a threshold that is too low stops a run too early.
"""


class AxisWatch:
    """Watch over the six axes of one sensor."""

    def __init__(self, facts: SensorFacts) -> None:
        far = (
            DEAD_WHILE_MOVED
            if facts.full_scales is None
            else [DEAD_WHILE_MOVED_SHARE * full_scale for full_scale in facts.full_scales]
        )
        self._far = [reach / scale for reach, scale in zip(far, facts.scales, strict=True)]
        """Distance from its first value that an axis must move, in counts."""
        self._first: Sequence[float] | None = None
        self._unchanged = set(range(len(AXES)))
        self._first_at = self._for = 0.0
        self._moved = False

    def zeroed(self) -> None:
        """Restart, because a zero was taken."""
        self._first = None

    def frame(self, values: Sequence[float], at: float) -> None:
        """Check a frame that arrived at that time, s."""
        first = self._first
        if first is None:
            first = self._first = values
            self._unchanged = set(range(len(AXES)))
            self._first_at, self._moved = at, False
        self._for = at - self._first_at
        if self._unchanged:
            self._unchanged = {k for k in self._unchanged if values[k] == first[k]}
            self._moved = self._moved or any(
                abs(a - b) >= far for a, b, far in zip(values, first, self._far, strict=True)
            )

    @property
    def dead(self) -> tuple[int, ...]:
        """Numbers of the axes that have not changed since the zero although they should have."""
        reason = self._for >= DEAD_AFTER_S and self._moved
        return tuple(sorted(self._unchanged)) if reason else ()
