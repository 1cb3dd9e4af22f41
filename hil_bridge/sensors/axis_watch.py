"""What a sensor's counts say about its six axes, frame by frame: near saturation, saturated, dead. Pure.

A zero moves the counts and not the end of the range: the device takes its offset off behind the converter, and counts
that leave 16 bits by that come round at the other end, with the wrong sign. So the end of the range is looked for in
the counts as they were before the zero, and counts that came round are beyond the range as well.

A quiet axis cannot be told from a dead one while nothing moves: behind a slow filter it may repeat its count for
minutes. But a living axis changes now and then after a zero, by noise alone, and no real axis stands still to one
count while another moves by a tenth of its full scale. So an axis is taken for dead when it has not changed once since
the zero, for long, although another moved that far.
"""

from collections.abc import Sequence

from protocol.jr3 import AXES, FULL_SCALE_COUNTS, SATURATED_COUNTS

NEAR_SATURATED_COUNTS = 26214
"""80 % of the range. Source: JR3 manual 5907E, default of near_sat_value."""
DEAD_AFTER_FRAMES = 400
"""Chosen: 4 s of the default stream; a living quiet axis was seen to change within 0.4 s of a zero."""
DEAD_WHILE_MOVED_COUNTS = FULL_SCALE_COUNTS // 10
"""Chosen: far more than one axis of a real sensor can move without the others feeling it."""

_CALM_COUNTS = NEAR_SATURATED_COUNTS * 9 // 10
"""Chosen: an axis below this is worth a new warning when it comes near again."""
_RANGE = 1 << 15
_OFFSET_COUNTS = 4
"""Chosen: how far the offset seen may be from the one taken, by noise and rounding."""


class AxisWatch:
    """The six axes of one sensor since it began."""

    def __init__(self) -> None:
        self.saturated: tuple[str, ...] = ()
        """Axes at the end of their range in the newest frame: their values may be anything above."""
        self._offset = (0,) * len(AXES)
        self._calm = _calm_counts(self._offset)
        """Between which counts no axis is near the end of any range."""
        self._near: set[str] = set()
        self._first: Sequence[int] | None = None
        self._unchanged = set(range(len(AXES)))
        self._frames = self._moved = 0

    def zeroed(self, before: Sequence[int] | None) -> None:
        """A zero was taken while the counts were these; None: nobody saw any, the zero is taken to move nothing."""
        if before is not None:
            self._offset = tuple(a + b for a, b in zip(self._offset, before, strict=True))
            self._calm = _calm_counts(self._offset)
        self._first = None

    def frame(self, counts: Sequence[int]) -> list[str]:
        """Look at a frame; warnings, each once, in words."""
        low, high = self._calm
        # That no axis is or was anywhere near the end of its range costs little to see.
        calm = not self._near and low < min(counts) and max(counts) < high
        warnings = [] if calm else self._look_at_range(counts)
        if self._first is None:
            self._first, self._unchanged = counts, set(range(len(AXES)))
            self._frames = self._moved = 0
        self._frames += 1
        if self._unchanged:
            self._unchanged = {k for k in self._unchanged if counts[k] == self._first[k]}
            self._moved = max(self._moved, *(abs(a - b) for a, b in zip(counts, self._first, strict=True)))
        return warnings

    def _look_at_range(self, counts: Sequence[int]) -> list[str]:
        warnings = []
        reached = [_reached(count, offset) for count, offset in zip(counts, self._offset, strict=True)]
        self.saturated = tuple(
            axis
            for axis, count in zip(AXES, reached, strict=True)
            if count >= SATURATED_COUNTS - _OFFSET_COUNTS
        )
        for axis, count in zip(AXES, reached, strict=True):
            if count >= NEAR_SATURATED_COUNTS and axis not in self._near:
                self._near.add(axis)
                warnings.append(f"{axis} is at {count / _RANGE:.0%} of what the sensor can tell")
            elif count < _CALM_COUNTS:
                self._near.discard(axis)
        return warnings

    @property
    def dead(self) -> tuple[int, ...]:
        """Numbers of the axes that did not change since the zero although they had reason to."""
        reason = self._frames >= DEAD_AFTER_FRAMES and self._moved >= DEAD_WHILE_MOVED_COUNTS
        return tuple(sorted(self._unchanged)) if reason else ()


def _calm_counts(offsets: Sequence[int]) -> tuple[int, int]:
    """Between which counts any axis with these offsets reaches less than `_CALM_COUNTS`; none come round there."""
    return -_CALM_COUNTS - min(0, *offsets), _CALM_COUNTS - max(0, *offsets)


def _reached(count: int, offset: int) -> int:
    """How far an axis is from the middle of the converter's range or from the zero, whichever is more, in counts."""
    at_converter = (count + offset + _RANGE) % (2 * _RANGE) - _RANGE
    return max(abs(at_converter), abs(at_converter - offset))
