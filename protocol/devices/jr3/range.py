"""The end of a JR3 sensor's range, looked for in its counts behind a zero. Pure.

A zero moves the counts and not the end of the range. The device takes its offset off behind the converter. Counts that
leave 16 bits by that come round at the other end, with the wrong sign. So the end of the range is looked for in the
counts as they were before the zero. Counts that came round are beyond the range as well.
"""

from collections.abc import Sequence

from protocol.wrench import AXES

SATURATED_COUNTS = 32752
"""Counts from which an axis may be at the end of its range, whatever the converter.

Derived: 32768 − 2^(16 − bits), the manual's default, for the coarsest converter of 12 bits.
"""
NEAR_SATURATED_COUNTS = 26214
"""80 % of the range. Source: JR3 manual 5907E, default of near_sat_value."""

_CALM_COUNTS = NEAR_SATURATED_COUNTS * 9 // 10
"""Chosen: an axis below this is worth a new warning when it comes near again."""
_RANGE = 1 << 15
_OFFSET_COUNTS = 4
"""Chosen: how far the offset seen may be from the one taken, by noise and rounding."""


class Range:
    """The six axes of one sensor since it began."""

    __slots__ = ("_high", "_low", "_near", "_offset", "newest", "warnings")

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Follow a device that restarted without offsets."""
        self._offset: tuple[int, ...] = (0,) * len(AXES)
        self.newest: Sequence[int] | None = None
        """The newest sample since the zero."""
        self._near: set[str] = set()
        self.warnings: list[str] = []
        """Notices about the newest sample, each once, in words."""
        self._set_calm()

    def zeroed(self, before: Sequence[int] | None) -> None:
        """Note that the device took a zero at these counts; None: no sample was received, and nothing changes."""
        if before is not None:
            self._offset = tuple([a + b for a, b in zip(self._offset, before, strict=True)])
            self._set_calm()
        self.newest = None

    def saturated(self, counts: Sequence[int]) -> int:
        """Look at a sample; bit k is set where axis k is at the end of its range."""
        self.newest = counts
        # That no axis is or was anywhere near the end of its range costs little to see.
        if not self._near and self._low < min(counts) and max(counts) < self._high:
            return 0
        return self._look(counts)

    def _look(self, counts: Sequence[int]) -> int:
        bits, self.warnings = 0, []
        for k, (axis, count, offset) in enumerate(zip(AXES, counts, self._offset, strict=True)):
            reached = _reached(count, offset)
            if reached >= SATURATED_COUNTS - _OFFSET_COUNTS:
                bits |= 1 << k
            if reached >= NEAR_SATURATED_COUNTS and axis not in self._near:
                self._near.add(axis)
                self.warnings.append(f"{axis} is at {reached / _RANGE:.0%} of what the sensor can tell")
            elif reached < _CALM_COUNTS:
                self._near.discard(axis)
        return bits

    def _set_calm(self) -> None:
        """Between which counts every axis reaches less than `_CALM_COUNTS`; none come round there."""
        self._low, self._high = -_CALM_COUNTS - min(0, *self._offset), _CALM_COUNTS - max(0, *self._offset)


def _reached(count: int, offset: int) -> int:
    """How far an axis is from the middle of the converter's range or from the zero, whichever is more, in counts."""
    at_converter = (count + offset + _RANGE) % (2 * _RANGE) - _RANGE
    return max(abs(at_converter), abs(at_converter - offset))
