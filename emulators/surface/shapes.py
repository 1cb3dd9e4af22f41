"""Shapes of a surface: how deep a place lies below it, and where its outward normal points.

Shapes have a frame of their own: `along` is the path coordinate, `across` lies level to the left of the path, and
height is base z. All are m; angles are rad. A normal is three arrays: along, across and up.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Normal: TypeAlias = tuple[Floats, Floats, Floats]


class Shape(Protocol):
    """A solid below a surface."""

    @property
    def narrows_below(self) -> float:
        """Height below which the solid narrows again, m: that of the axis of a cylinder. Minus infinity for others."""

    def depth_and_normal(self, along: Floats, across: Floats, height: Floats) -> tuple[Floats, Normal]:
        """Depth (n,) below the surface along its normal, m, negative outside, and the outward unit normal.

        `along`, `across` and `height` (n,) are the places, m.
        """


@dataclass(frozen=True, slots=True)
class Plane:
    """A plane that rises along the path."""

    height: float
    """Height at path coordinate 0, m."""
    slope: float = 0.0
    """rad, positive where the surface rises along the path."""

    narrows_below: ClassVar[float] = -math.inf

    def depth_and_normal(self, along: Floats, across: Floats, height: Floats) -> tuple[Floats, Normal]:
        sine, cosine = math.sin(self.slope), math.cos(self.slope)
        depth = (self.height - height) * cosine + along * sine
        return depth, (np.full_like(along, -sine), np.zeros_like(along), np.full_like(along, cosine))


@dataclass(frozen=True, slots=True)
class Sinusoidal:
    """Waves about a height, rising through it at path coordinate 0.

    The depth is that below the tangent under the tip: exact to first order in depth times curvature.
    """

    height: float
    """m"""
    amplitude: float
    """m"""
    period: float
    """Length of a wave along the path, m."""

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
    """Waves along the path plus waves across it; both rise through the height where their coordinate is 0.

    The depth is that below the tangent plane under the tip, as of `Sinusoidal`.
    """

    height: float
    """m"""
    amplitude: float
    """Of either waves, m."""
    period: float
    """Length of a wave along the path, m."""
    period_across: float
    """Length of a wave across the path, m."""

    narrows_below: ClassVar[float] = -math.inf

    def depth_and_normal(self, along: Floats, across: Floats, height: Floats) -> tuple[Floats, Normal]:
        number, number_across = 2.0 * math.pi / self.period, 2.0 * math.pi / self.period_across
        surface = self.height + self.amplitude * (np.sin(number * along) + np.sin(number_across * across))
        rise = self.amplitude * number * np.cos(number * along)
        rise_across = self.amplitude * number_across * np.cos(number_across * across)
        return below_tangent(surface - height, rise, rise_across)


def _normal_parts(up: Floats, distance: Floats) -> tuple[Floats, Floats]:
    """Distance to the middle of a round solid, as a divisor, and the normal's upward part.

    The middle itself has no normal. Any would do; up is the limit of the others from above.
    """
    safe = np.where(distance > 0.0, distance, 1.0)
    return safe, np.where(distance > 0.0, up / safe, 1.0)


@dataclass(frozen=True, slots=True)
class CircularArc:
    """A lying cylinder with its crest at path coordinate 0."""

    height: float
    """Height of the crest, m."""
    radius: float
    """m"""

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
    """A ball with its crest at path coordinate 0, across 0."""

    height: float
    """Height of the crest, m."""
    radius: float
    """m"""

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
    """Heights on a grid, with a bicubic surface between them; its middle is at path coordinate 0, across 0.

    The surface goes through the heights, and its normal has no jumps. Beyond the edge it continues as at the edge. The
    depth is that below the tangent plane under the tip, as of `Sinusoidal`. Source of the weights: Catmull and Rom, A
    class of local interpolating splines, 1974.
    """

    height: float
    """Height of a 0 of the grid, m."""
    heights: Floats
    """Heights (rows, columns), m: rows follow each other along the path, columns across it."""
    spacing: float
    """Distance from a row or column to the next, m."""

    narrows_below: ClassVar[float] = -math.inf

    def depth_and_normal(self, along: Floats, across: Floats, height: Floats) -> tuple[Floats, Normal]:
        rows, columns = self.heights.shape
        row, weights, slopes = _spline(along / self.spacing + 0.5 * (rows - 1), rows)
        column, weights_across, slopes_across = _spline(across / self.spacing + 0.5 * (columns - 1), columns)
        surface, rise, rise_across = (np.zeros_like(along) for _ in range(3))
        for k in range(4):
            line, line_across = np.zeros_like(along), np.zeros_like(along)
            for m in range(4):
                found = self.heights[row[k], column[m]]
                line += weights_across[m] * found
                line_across += slopes_across[m] * found
            surface += weights[k] * line
            rise += slopes[k] * line
            rise_across += weights[k] * line_across
        return below_tangent(self.height + surface - height, rise / self.spacing, rise_across / self.spacing)


def below_tangent(below: Floats, rise: Floats, rise_across: Floats) -> tuple[Floats, Normal]:
    """Depth and normal for a vertical distance below a surface, m, and its slopes, both without unit."""
    cosine = 1.0 / np.sqrt(1.0 + rise * rise + rise_across * rise_across)
    return below * cosine, (-rise * cosine, -rise_across * cosine, cosine)


def _spline(place: Floats, count: int) -> tuple[NDArray[np.intp], Floats, Floats]:
    """Catmull-Rom spline through `count` points: for places (n,) in steps from the first, the four points (4, n) that
    matter, their weights (4, n), and their weights in the slope per step (4, n).
    """
    # Two steps outside all four points are the same one, however far it is.
    place = place.clip(-2.0, count + 1.0)
    first = np.floor(place)
    t = place - first
    t2, t3 = t * t, t * t * t
    weights = 0.5 * np.stack((-t3 + 2 * t2 - t, 3 * t3 - 5 * t2 + 2, -3 * t3 + 4 * t2 + t, t3 - t2))
    slopes = 0.5 * np.stack((-3 * t2 + 4 * t - 1, 9 * t2 - 10 * t, -9 * t2 + 8 * t + 1, 3 * t2 - 2 * t))
    points = first.astype(np.intp) + np.arange(-1, 3)[:, None]
    return points.clip(0, count - 1), weights, slopes
