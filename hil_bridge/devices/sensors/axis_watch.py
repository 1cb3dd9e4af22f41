"""Detection of dead axes of a sensor from its values alone, frame by frame. Pure.

A quiet axis cannot be distinguished from a dead one while nothing moves: behind a slow filter it may repeat its
value for minutes. But a live axis changes occasionally after a zero, by noise alone. No real axis stays constant
while another axis moves by a tenth of its full scale. Therefore an axis counts as dead if it has not changed for a
long time since the zero although another axis moved that far.
"""

from collections.abc import Sequence

from protocol.wrench import AXES, SensorFacts

DEAD_AFTER_S = 3.9
"""Time without a change after which an axis may count as dead, s. Chosen: slightly less than ten times the observed
0.4 s within which a quiet live axis changes after a zero.
"""
DEAD_WHILE_MOVED_SHARE = 0.1
"""Movement of another axis at which an unchanged axis counts as dead, as a share of full scale. Chosen: far more
than one axis of a real sensor can move without affecting the others.
"""
DEAD_WHILE_MOVED = (10.0, 10.0, 10.0, 0.5, 0.5, 0.5)
"""Movement of another axis at which an unchanged axis counts as dead, N and N·m, for a sensor that does not report
its full scales. Chosen: a tenth of the full scale of a small sensor, because a threshold that is too low stops a
run too early.
"""


class AxisWatch:
    """Watch for dead axes among the six axes of one sensor."""

    def __init__(self, facts: SensorFacts) -> None:
        far = (
            DEAD_WHILE_MOVED
            if facts.full_scales is None
            else [DEAD_WHILE_MOVED_SHARE * full_scale for full_scale in facts.full_scales]
        )
        self._far = [reach / scale for reach, scale in zip(far, facts.scales, strict=True)]
        """Distance that each axis must move from its first value, counts."""
        self._first: Sequence[float] | None = None
        self._unchanged = set(range(len(AXES)))
        self._first_at = self._for = 0.0
        self._moved = False

    def zeroed(self) -> None:
        """Restart because a zero was taken."""
        self._first = None

    def frame(self, values: Sequence[float], at: float) -> None:
        """Check a frame that arrived at time `at`, s."""
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
        """Numbers of the axes that have not changed since the zero although they should have changed."""
        reason = self._for >= DEAD_AFTER_S and self._moved
        return tuple(sorted(self._unchanged)) if reason else ()
