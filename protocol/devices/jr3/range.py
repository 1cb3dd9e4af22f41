"""Saturation of a JR3 sensor, detected from its counts relative to a zero.

A zero shifts the counts but not the end of the range, because the device subtracts its offset after the converter.
Counts that exceed 16 bits as a result wrap around, with the wrong sign. Saturation is therefore determined from the
counts before the zero. Counts that wrapped around are out of range as well.
"""

from collections.abc import Sequence

from protocol.wrench import AXES

SATURATED_COUNTS = 32752
"""Number of counts from which an axis may be saturated, with any converter.

Derived: 32768 − 2^(16 − bits), the manual's default, for the coarsest converter of 12 bits.
"""
NEAR_SATURATED_COUNTS = 26214
"""Number of counts from which an axis is near saturation: 80 % of the range. Source: JR3 manual 5907E, default of
near_sat_value.
"""

_CALM_COUNTS = NEAR_SATURATED_COUNTS * 9 // 10
"""Number of counts below which an axis must fall before it causes another warning. Chosen."""
_RANGE = 1 << 15
_OFFSET_COUNTS = 4
"""Tolerance between the observed offset and the offset that the device took, in counts. Chosen for noise and
rounding.
"""


class Range:
    """Range monitor for the six axes of one sensor since it started."""

    __slots__ = ("_high", "_low", "_near", "_offset", "newest", "warnings")

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Reset the state after a restart of the device, which has then no offsets."""
        self._offset: tuple[int, ...] = (0,) * len(AXES)
        self.newest: Sequence[int] | None = None
        """Newest sample since the last zero."""
        self._near: set[str] = set()
        self.warnings: list[str] = []
        """Texts of the warnings about the newest sample, each reported once."""
        self._set_calm()

    def zeroed(self, before: Sequence[int] | None) -> None:
        """Record that the device took its zero when the counts were `before`. None means that no sample had been
        received; the offset then does not change.
        """
        if before is not None:
            self._offset = tuple([a + b for a, b in zip(self._offset, before, strict=True)])
            self._set_calm()
        self.newest = None

    def saturated(self, counts: Sequence[int]) -> int:
        """Process a sample and return its saturation bits. Bit k is set if axis k is at the end of its range."""
        self.newest = counts
        # Fast path: no axis is or was near the end of its range.
        if not self._near and self._low < min(counts) and max(counts) < self._high:
            return 0
        return self._evaluate(counts)

    def _evaluate(self, counts: Sequence[int]) -> int:
        bits, self.warnings = 0, []
        for k, (axis, count, offset) in enumerate(zip(AXES, counts, self._offset, strict=True)):
            reached = _reached(count, offset)
            if reached >= SATURATED_COUNTS - _OFFSET_COUNTS:
                bits |= 1 << k
            if reached >= NEAR_SATURATED_COUNTS and axis not in self._near:
                self._near.add(axis)
                self.warnings.append(f"{axis} is at {reached / _RANGE:.0%} of the sensor's range")
            elif reached < _CALM_COUNTS:
                self._near.discard(axis)
        return bits

    def _set_calm(self) -> None:
        """Compute the limits of the counts within which every axis stays below `_CALM_COUNTS` and no axis wraps
        around.
        """
        self._low, self._high = -_CALM_COUNTS - min(0, *self._offset), _CALM_COUNTS - max(0, *self._offset)


def _reached(count: int, offset: int) -> int:
    """Return the distance of an axis from the middle of the converter's range or from the zero, whichever is
    larger, in counts.
    """
    at_converter = (count + offset + _RANGE) % (2 * _RANGE) - _RANGE
    return max(abs(at_converter), abs(at_converter - offset))
