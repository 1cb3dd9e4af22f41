"""Paths along the surface, as settings in mm in the work frame."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, TypeAlias

from pydantic import Discriminator

from hil_bridge.control.checks import FORBID_EXTRA, require_above_zero
from hil_bridge.control.geometry.ways import PIECES_MAX, Place
from protocol.marks import SettingError

CHORD_MM = 0.05
"""Largest distance between the straight segments of a bend and the exact curve, mm. Chosen."""
LONGEST_MM = 1e6
"""Largest allowed coordinate of a path, mm. Chosen."""


def check_finite(where: str, *places: Place) -> None:
    """Raise ValueError for a point, mm, that is not finite or too far away."""
    for x, y in places:
        if not (abs(x) <= LONGEST_MM and abs(y) <= LONGEST_MM):
            raise SettingError(where, f"must be finite points in mm, got {x:g}, {y:g}")


@dataclass(frozen=True, slots=True)
class Line:
    """Straight path."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    kind: Literal["line"] = "line"
    length_mm: float | None = None
    """Length along `direction_deg`; not set with `to_mm`."""
    direction_deg: float = 0.0
    """Direction in the plane, from x towards y."""
    to_mm: Place | None = None
    """Target point in the work frame; not set with `length_mm`."""

    def __post_init__(self) -> None:
        if (self.length_mm is None) == (self.to_mm is None):
            raise ValueError("a line needs length_mm or to_mm, and not both")
        if self.length_mm is not None:
            require_above_zero(self, "length_mm")
        if self.to_mm is not None:
            check_finite("to_mm", self.to_mm)
        if not math.isfinite(self.direction_deg):
            raise SettingError("direction_deg", "must be a number")

    def corners(self, begin: Place | None) -> list[Place]:
        """Return the corners of the path in the work frame, mm. `begin` is the position of the tool, or None if
        unknown.
        """
        if self.to_mm is not None:
            return [_require_begin(begin), self.to_mm]
        x, y = begin or (0.0, 0.0)
        assert self.length_mm is not None
        if not self.direction_deg:  # no rounding for the simplest direction
            return [(x, y), (x + self.length_mm, y)]
        angle = math.radians(self.direction_deg)
        return [(x, y), (x + self.length_mm * math.cos(angle), y + self.length_mm * math.sin(angle))]


@dataclass(frozen=True, slots=True)
class Arc:
    """Part of a circle, from the tool's position."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    kind: Literal["arc"] = "arc"
    centre_mm: Place = (0.0, 0.0)
    """Centre of the circle in the work frame."""
    angle_deg: float = 90.0
    """Angle of the arc, positive from x towards y; may exceed 360°."""

    def __post_init__(self) -> None:
        check_finite("centre_mm", self.centre_mm)
        if not (math.isfinite(self.angle_deg) and 0 < abs(self.angle_deg) <= 36000):
            raise SettingError(
                "angle_deg", f"must be a number up to ±36000 and not 0, got {self.angle_deg:g}"
            )

    def corners(self, begin: Place | None) -> list[Place]:
        x, y = _require_begin(begin)
        u, v = self.centre_mm
        radius = math.hypot(x - u, y - v)
        if radius < 1e-3:
            raise ValueError("the arc begins in its centre: its radius would be 0 mm")
        first, turn = math.atan2(y - v, x - u), math.radians(self.angle_deg)
        count = _pieces(radius, abs(turn))
        return [
            (x, y),
            *(
                (
                    u + radius * math.cos(first + turn * k / count),
                    v + radius * math.sin(first + turn * k / count),
                )
                for k in range(1, count + 1)
            ),
        ]


@dataclass(frozen=True, slots=True)
class Polyline:
    """Straight segments from point to point."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    kind: Literal["polyline"] = "polyline"
    points_mm: tuple[Place, ...] = ()
    """Points in the work frame; the first one must be the tool's position."""

    def __post_init__(self) -> None:
        if len(self.points_mm) < 2:
            raise SettingError("points_mm", "must have at least two points")
        check_finite("points_mm", *self.points_mm)

    def corners(self, begin: Place | None) -> list[Place]:
        return list(self.points_mm)


@dataclass(frozen=True, slots=True)
class Raster:
    """Parallel lines over a rectangle or a polygon, back and forth."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    kind: Literal["raster"] = "raster"
    corner_mm: Place = (0.0, 0.0)
    """Corner of the rectangle with the smallest x and y; unused with `polygon_mm`."""
    size_mm: Place = (0.0, 0.0)
    """Size of the rectangle along x and y; unused with `polygon_mm`."""
    polygon_mm: tuple[Place, ...] = ()
    """Corners of a polygon instead of the rectangle; each line of the raster must cross it exactly once."""
    spacing_mm: float = 5.0
    """Largest distance between the lines."""
    along: Literal["x", "y"] = "x"
    """Direction of the lines."""

    def __post_init__(self) -> None:
        require_above_zero(self, "spacing_mm")
        check_finite("corner_mm", self.corner_mm, self.size_mm, *self.polygon_mm)
        if self.polygon_mm and len(self.polygon_mm) < 3:
            raise SettingError("polygon_mm", "must have at least three points")
        if not self.polygon_mm and not min(self.size_mm) > 0:
            raise SettingError(
                "size_mm", f"must be above 0 in both directions, got {self.size_mm[0]:g}, {self.size_mm[1]:g}"
            )

    def corners(self, begin: Place | None) -> list[Place]:
        (x, y), (w, h) = self.corner_mm, self.size_mm
        outline = self.polygon_mm or ((x, y), (x + w, y), (x + w, y + h), (x, y + h))
        if self.along == "y":
            outline = tuple((v, u) for u, v in outline)
        low, high = min(v for _, v in outline), max(v for _, v in outline)
        count = math.ceil((high - low) / self.spacing_mm - 1e-9)
        if not 1 <= count <= PIECES_MAX / 2:
            raise ValueError(f"a raster of {count} lines; it needs 1 … {PIECES_MAX // 2}: change spacing_mm")
        places: list[Place] = []
        for k in range(count + 1):
            # slightly inside, in case a side or corner of the polygon lies on the line
            level = low + (high - low) * k / count
            try:
                left, right = _find_crossings(outline, min(max(level, low + 1e-6), high - 1e-6))
            except ValueError as error:
                across = "x" if self.along == "y" else "y"
                raise ValueError(
                    f"the polygon is {error} by the line at {across} = {level:g} mm: every line must cross it exactly "
                    "once; try the other value of along, or several tracks"
                ) from None
            ends = [(left, level), (right, level)]
            places += ends if k % 2 == 0 else ends[::-1]
        distinct = [place for place, before in zip(places, [None, *places], strict=False) if place != before]
        return [(v, u) for u, v in distinct] if self.along == "y" else distinct


@dataclass(frozen=True, slots=True)
class Spiral:
    """Spiral out of its centre, or into it."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    kind: Literal["spiral"] = "spiral"
    centre_mm: Place = (0.0, 0.0)
    """Centre in the work frame."""
    radius_mm: float = 20.0
    """Radius of the outermost turn."""
    spacing_mm: float = 5.0
    """Distance between the turns."""
    inwards: bool = False
    """Whether it runs from the outermost turn to the centre."""

    def __post_init__(self) -> None:
        require_above_zero(self, "radius_mm", "spacing_mm")
        check_finite("centre_mm", self.centre_mm)
        if self.radius_mm / self.spacing_mm > 1000:
            raise ValueError("a spiral may have 1000 turns at most: change spacing_mm")

    def corners(self, begin: Place | None) -> list[Place]:
        u, v = self.centre_mm
        places, angle, total_angle = [(u, v)], 0.0, math.tau * self.radius_mm / self.spacing_mm
        while angle < total_angle and len(places) < PIECES_MAX:
            radius = max(self.spacing_mm * angle / math.tau, CHORD_MM)
            angle = min(angle + math.tau / _pieces(radius, math.tau), total_angle)
            radius = self.spacing_mm * angle / math.tau
            places.append((u + radius * math.cos(angle), v + radius * math.sin(angle)))
        return places[::-1] if self.inwards else places


Path: TypeAlias = Annotated[Line | Arc | Polyline | Raster | Spiral, Discriminator("kind")]
"""Path of a stroke, by its kind."""


def _pieces(radius: float, angle: float) -> int:
    """Return the number of straight segments for a bend with the given radius, mm, and angle, rad."""
    widest = 2.0 * math.acos(max(1.0 - CHORD_MM / radius, 0.0)) if radius > CHORD_MM else math.pi / 2
    return max(math.ceil(angle / widest), 2)


def _require_begin(begin: Place | None) -> Place:
    if begin is None:
        raise ValueError(
            "where the path begins is not known: insert a move before, or use a line with length_mm"
        )
    return begin


def _find_crossings(outline: Sequence[Place], level: float) -> Place:
    """Return the smallest and the largest x at which a line at the given y crosses a polygon. Raises ValueError
    unless there are exactly two crossings.
    """
    crossings = []
    for (x, y), (u, v) in zip(outline, [*outline[1:], outline[0]], strict=True):
        if (y <= level < v) or (v <= level < y):
            crossings.append(x + (level - y) / (v - y) * (u - x))
    if len(crossings) != 2:
        raise ValueError(f"crossed {len(crossings)} times")
    return min(crossings), max(crossings)
