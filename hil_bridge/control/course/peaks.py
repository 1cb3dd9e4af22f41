"""The extremes of every sensor frame between two decisions, so that no peak passes unjudged."""

import math
from collections.abc import Sequence

from hil_bridge.control.geometry.wrist import NO_WRENCH, WristAtOrientation


class Peaks:
    """Takes every frame as it arrives and keeps the largest forces and moment until it is asked for them.

    Forces are judged twice: from the zero, and with what the zero took off, so that a zero hides no force.
    """

    __slots__ = (
        "_direction",
        "_force",
        "_matrix",
        "_moment",
        "_offset",
        "_own",
        "_resultant",
        "_zero",
        "saturated",
    )

    def __init__(
        self, wrist: WristAtOrientation, scales: Sequence[float], zero: Sequence[float] = NO_WRENCH
    ) -> None:
        """`wrist` is the wrist at the orientation that the tool keeps, its first direction the approach. `scales`
        are those of the sensor's facts, `zero` is the contact wrench that was taken for zero, N and N·m.
        """
        self.turn(wrist, scales)
        self._zero = tuple(zero)
        self._own: Sequence[float] = NO_WRENCH
        self._force = self._resultant = self._moment = 0.0
        self.saturated = False
        """An axis was at the end of its range in one of the frames since `take`."""

    def turn(self, wrist: WristAtOrientation, scales: Sequence[float]) -> None:
        """Note that the tool has another orientation from now on."""
        rows = [[value * scale for value, scale in zip(row, scales, strict=True)] for row in wrist.matrix]
        self._matrix = tuple(map(tuple, rows))
        self._offset = wrist.offset
        self._direction = wrist.directions[0]

    def frame(self, values: Sequence[float]) -> None:
        """Add the six values of a frame. In single numbers, for this runs for every frame of a stream."""
        fx, fy, fz, mx, my, mz = values
        (a, b, c, _, _, _), (d, e, f, _, _, _), (g, h, i, _, _, _), r, s, t = self._matrix
        ox, oy, oz, ou, ov, ow = self._offset
        x, y, z = a * fx + b * fy + c * fz + ox, d * fx + e * fy + f * fz + oy, g * fx + h * fy + i * fz + oz
        nx, ny, nz = self._direction
        p, q, w, _, _, _ = self._zero
        force, at_zero = -(nx * x + ny * y + nz * z), -(nx * p + ny * q + nz * w)
        for value in (force, force + at_zero):
            if abs(value) > abs(self._force):
                self._force = value
        square = max(x * x + y * y + z * z, (x + p) * (x + p) + (y + q) * (y + q) + (z + w) * (z + w))
        if square > self._resultant:
            self._resultant = square
        u = r[0] * fx + r[1] * fy + r[2] * fz + r[3] * mx + r[4] * my + r[5] * mz + ou
        v = s[0] * fx + s[1] * fy + s[2] * fz + s[3] * mx + s[4] * my + s[5] * mz + ov
        w = t[0] * fx + t[1] * fy + t[2] * fz + t[3] * mx + t[4] * my + t[5] * mz + ow
        square = u * u + v * v + w * w
        if square > self._moment:
            self._moment = square

    def rezero(self, wrench: Sequence[float]) -> None:
        """Take this contact wrench, N and N·m, as the zero of a program; only `resultant` counts from there."""
        self._own = tuple(wrench)

    def resultant(self, values: Sequence[float]) -> float:
        """Length of the contact force of one frame from the newest zero, N."""
        rows = zip(self._matrix[:3], self._offset[:3], self._own[:3], strict=True)
        return math.hypot(
            *(sum(m * n for m, n in zip(row, values, strict=True)) + o - p for row, o, p in rows)
        )

    def along(self, values: Sequence[float]) -> float:
        """Contact force of one frame along the approach from the newest zero, N, positive while pressing."""
        rows = zip(self._matrix[:3], self._offset[:3], self._own[:3], self._direction, strict=True)
        return -sum(
            n * (sum(m * v for m, v in zip(row, values, strict=True)) + o - p) for row, o, p, n in rows
        )

    def take(self) -> tuple[float, float, float, bool]:
        """Force along the approach farthest from 0, N, largest resultant, N, and moment, N·m, of all frames since the
        call before; zeros where none came. The last value is whether one was saturated.
        """
        found = self._force, math.sqrt(self._resultant), math.sqrt(self._moment), self.saturated
        self._force = self._resultant = self._moment = 0.0
        self.saturated = False
        return found
