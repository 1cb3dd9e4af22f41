"""Shapes of a surface: depth of a point below it, and its outward normal.

Shapes use a frame of their own: `along` is the path coordinate, `across` is horizontal to the left of the path, and
height is base z. All are in m; angles are in rad. A normal consists of three arrays: along, across and up.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Normal: TypeAlias = tuple[Floats, Floats, Floats]


class Shape(Protocol):
    """Solid below a surface."""

    @property
    def narrows_below(self) -> float:
        """Height below which the solid narrows again, m: the axis of a cylinder.

        Minus infinity for all other shapes.
        """

    def depth_and_normal(self, along: Floats, across: Floats, height: Floats) -> tuple[Floats, Normal]:
        """Return the depth (n,) below the surface along its normal, m, negative outside, and the outward unit normal.

        `along`, `across` and `height` (n,) are the coordinates of the points, m.
        """


@dataclass(frozen=True, slots=True)
class Plane:
    """Plane that may rise along the path."""

    height: float
    """Height at path coordinate 0, m."""
    slope: float = 0.0
    """Slope, rad, positive if the surface rises along the path."""

    narrows_below: ClassVar[float] = -math.inf

    def depth_and_normal(self, along: Floats, across: Floats, height: Floats) -> tuple[Floats, Normal]:
        sine, cosine = math.sin(self.slope), math.cos(self.slope)
        depth = (self.height - height) * cosine + along * sine
        return depth, (np.full_like(along, -sine), np.zeros_like(along), np.full_like(along, cosine))


@dataclass(frozen=True, slots=True)
class Sinusoidal:
    """Sine wave along the path about a mean height. It rises through the mean height at path coordinate 0.

    The depth is measured from the tangent below the tip, which is exact to first order in depth times curvature.
    """

    height: float
    """Mean height, m."""
    amplitude: float
    """Amplitude, m."""
    period: float
    """Wavelength along the path, m."""

    narrows_below: ClassVar[float] = -math.inf

    def depth_and_normal(self, along: Floats, across: Floats, height: Floats) -> tuple[Floats, Normal]:
        wave_number = 2.0 * math.pi / self.period
        phase = wave_number * along
        rise = self.amplitude * wave_number * np.cos(phase)
        cosine = 1.0 / np.sqrt(1.0 + rise * rise)
        depth = (self.height + self.amplitude * np.sin(phase) - height) * cosine
        return depth, (-rise * cosine, np.zeros_like(along), cosine)


@dataclass(frozen=True, slots=True)
class SinusoidalBoth:
    """Sum of a sine wave along the path and a sine wave across it.

    Both rise through the mean height at coordinate 0. The depth is measured from the tangent plane below the tip,
    as in `Sinusoidal`.
    """

    height: float
    """Mean height, m."""
    amplitude: float
    """Amplitude of each wave, m."""
    period: float
    """Wavelength along the path, m."""
    period_across: float
    """Wavelength across the path, m."""

    narrows_below: ClassVar[float] = -math.inf

    def depth_and_normal(self, along: Floats, across: Floats, height: Floats) -> tuple[Floats, Normal]:
        number, number_across = 2.0 * math.pi / self.period, 2.0 * math.pi / self.period_across
        surface = self.height + self.amplitude * (np.sin(number * along) + np.sin(number_across * across))
        rise = self.amplitude * number * np.cos(number * along)
        rise_across = self.amplitude * number_across * np.cos(number_across * across)
        return below_tangent(surface - height, rise, rise_across)


def _normal_parts(up: Floats, distance: Floats) -> tuple[Floats, Floats]:
    """Return the distance to the centre of a round solid, usable as a divisor, and the upward component of the
    normal.

    The centre itself has no normal. The result there is up, which is the limit from above.
    """
    safe = np.where(distance > 0.0, distance, 1.0)
    return safe, np.where(distance > 0.0, up / safe, 1.0)


@dataclass(frozen=True, slots=True)
class CircularArc:
    """Horizontal cylinder across the path with its crest at path coordinate 0."""

    height: float
    """Height of the crest, m."""
    radius: float
    """Radius, m."""

    @property
    def narrows_below(self) -> float:
        return self.height - self.radius

    def depth_and_normal(self, along: Floats, across: Floats, height: Floats) -> tuple[Floats, Normal]:
        up = height - self.narrows_below
        distance = np.hypot(along, up)
        safe, upward = _normal_parts(up, distance)
        return self.radius - distance, (along / safe, np.zeros_like(along), upward)


@dataclass(frozen=True, slots=True)
class Sphere:
    """Sphere with its crest at path coordinate 0 and across coordinate 0."""

    height: float
    """Height of the crest, m."""
    radius: float
    """Radius, m."""

    @property
    def narrows_below(self) -> float:
        return self.height - self.radius

    def depth_and_normal(self, along: Floats, across: Floats, height: Floats) -> tuple[Floats, Normal]:
        up = height - self.narrows_below
        distance = np.sqrt(along * along + across * across + up * up)
        safe, upward = _normal_parts(up, distance)
        return self.radius - distance, (along / safe, across / safe, upward)


@dataclass(frozen=True, slots=True)
class HeightMap:
    """Grid of heights with bicubic interpolation. Its centre is at path coordinate 0 and across coordinate 0.

    The surface passes through the heights, and its normal is continuous. Beyond the edge, the height remains as at
    the edge. The depth is measured from the tangent plane below the tip, as in `Sinusoidal`. Source of the weights:
    Catmull and Rom, A class of local interpolating splines, 1974.
    """

    height: float
    """Height that corresponds to the value 0 in the grid, m."""
    heights: Floats
    """Heights (rows, columns), m. Rows follow the path, and columns cross it."""
    spacing: float
    """Distance between adjacent rows or columns, m."""

    narrows_below: ClassVar[float] = -math.inf

    def depth_and_normal(self, along: Floats, across: Floats, height: Floats) -> tuple[Floats, Normal]:
        rows, columns = self.heights.shape
        row, weights, slopes = _spline(along / self.spacing + 0.5 * (rows - 1), rows)
        column, weights_across, slopes_across = _spline(across / self.spacing + 0.5 * (columns - 1), columns)
        surface, rise, rise_across = (np.zeros_like(along) for _ in range(3))
        for k in range(4):
            line, line_across = np.zeros_like(along), np.zeros_like(along)
            for m in range(4):
                node = self.heights[row[k], column[m]]
                line += weights_across[m] * node
                line_across += slopes_across[m] * node
            surface += weights[k] * line
            rise += slopes[k] * line
            rise_across += weights[k] * line_across
        return below_tangent(self.height + surface - height, rise / self.spacing, rise_across / self.spacing)


def below_tangent(below: Floats, rise: Floats, rise_across: Floats) -> tuple[Floats, Normal]:
    """Return depth and normal of a point relative to the tangent plane of a surface.

    The arguments are the vertical distance below the surface, m, and the two dimensionless slopes of the surface.
    """
    cosine = 1.0 / np.sqrt(1.0 + rise * rise + rise_across * rise_across)
    return below * cosine, (-rise * cosine, -rise_across * cosine, cosine)


def _spline(index: Floats, count: int) -> tuple[NDArray[np.intp], Floats, Floats]:
    """Return the coefficients of a Catmull-Rom spline through `count` points at fractional indices (n,).

    The coefficients are the indices (4, n) of the four relevant points, their weights (4, n), and their weights in
    the slope per step (4, n).
    """
    # At a distance of two steps or more outside, all four points are identical.
    index = index.clip(-2.0, count + 1.0)
    first = np.floor(index)
    t = index - first
    t2, t3 = t * t, t * t * t
    weights = 0.5 * np.stack((-t3 + 2 * t2 - t, 3 * t3 - 5 * t2 + 2, -3 * t3 + 4 * t2 + t, t3 - t2))
    slopes = 0.5 * np.stack((-3 * t2 + 4 * t - 1, 9 * t2 - 10 * t, -9 * t2 + 8 * t + 1, 3 * t2 - 2 * t))
    points = first.astype(np.intp) + np.arange(-1, 3)[:, None]
    return points.clip(0, count - 1), weights, slopes
