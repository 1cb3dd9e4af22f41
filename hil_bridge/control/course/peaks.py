"""Extremes over all sensor frames between two decisions, so that no peak is missed."""

import math
from collections.abc import Sequence

from hil_bridge.control.geometry.wrist import NO_WRENCH, WristAtOrientation


class Peaks:
    """Accumulator that receives every frame on arrival and keeps the largest forces and the largest moment until
    `take`.

    Each force is measured both relative to the zero and including the force removed by the zero, so that a zero
    hides no force.
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
        """Create the accumulator.

        `wrist` is the wrist at the orientation that the tool keeps; its first direction is the approach. `scales`
        are the scales from the sensor's facts. `zero` is the contact wrench used as the zero, N and N·m.
        """
        self.turn(wrist, scales)
        self._zero = tuple(zero)
        self._own: Sequence[float] = NO_WRENCH
        self._force = self._resultant = self._moment = 0.0
        self.saturated = False
        """Whether an axis has been at the end of its range in a frame since `take`."""

    def turn(self, wrist: WristAtOrientation, scales: Sequence[float]) -> None:
        """Set the orientation of the tool for the following frames."""
        rows = [[value * scale for value, scale in zip(row, scales, strict=True)] for row in wrist.matrix]
        self._matrix = tuple(map(tuple, rows))
        self._offset = wrist.offset
        self._direction = wrist.directions[0]

    def frame(self, values: Sequence[float]) -> None:
        """Add the six values of a frame, as plain numbers because this runs for every frame of a stream."""
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
        """Set the zero of a program to this contact wrench, N and N·m. Only `resultant` is measured relative to it."""
        self._own = tuple(wrench)

    def resultant(self, values: Sequence[float]) -> float:
        """Return the magnitude of the contact force of one frame relative to the newest zero, N."""
        rows = zip(self._matrix[:3], self._offset[:3], self._own[:3], strict=True)
        return math.hypot(
            *(sum(m * n for m, n in zip(row, values, strict=True)) + o - p for row, o, p in rows)
        )

    def along(self, values: Sequence[float]) -> float:
        """Return the contact force of one frame along the approach relative to the newest zero, N, positive while
        pressing.
        """
        rows = zip(self._matrix[:3], self._offset[:3], self._own[:3], self._direction, strict=True)
        return -sum(
            n * (sum(m * v for m, v in zip(row, values, strict=True)) + o - p) for row, o, p, n in rows
        )

    def take(self) -> tuple[float, float, float, bool]:
        """Return the extremes of all frames since the previous call: the force along the approach with the largest
        magnitude, N, the largest resultant, N, the largest moment, N·m, and whether a frame was saturated. The
        values are zeros if there were no frames.
        """
        peaks = self._force, math.sqrt(self._resultant), math.sqrt(self._moment), self.saturated
        self._force = self._resultant = self._moment = 0.0
        self.saturated = False
        return peaks
