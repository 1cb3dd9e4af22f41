"""Paths along the surface, as settings in millimetres of the work frame."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, TypeAlias

from pydantic import Discriminator

from hil_bridge.control.checks import FORBID_EXTRA, require_above_zero
from hil_bridge.control.geometry.ways import PIECES_MAX, Place
from protocol.marks import SettingError

CHORD_MM = 0.05
"""Chosen: how far the straight pieces of a bend may lie beside it, mm."""
LONGEST_MM = 1e6
"""Chosen: no coordinate of a path may be larger, mm."""


def check_finite(where: str, *places: Place) -> None:
    """Raise ValueError for a place, mm, that is not a number or too far away."""
    for x, y in places:
        if not (abs(x) <= LONGEST_MM and abs(y) <= LONGEST_MM):
            raise SettingError(where, f"must be finite places in mm, got {x:g}, {y:g}")


@dataclass(frozen=True, slots=True)
class Line:
    """Straight on."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    kind: Literal["line"] = "line"
    length_mm: float | None = None
    """Length along `direction_deg`; nothing where `to_mm` is given."""
    direction_deg: float = 0.0
    """Direction in the plane, from x towards y."""
    to_mm: Place | None = None
    """Place in the work frame to go to; nothing where `length_mm` is given."""

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
        """Corners of the way in the work frame, mm; `begin` is where the tool is, None where that is not known."""
        if self.to_mm is not None:
            return [_known(begin), self.to_mm]
        x, y = begin or (0.0, 0.0)
        assert self.length_mm is not None
        if not self.direction_deg:  # no rounding on the plainest way
            return [(x, y), (x + self.length_mm, y)]
        angle = math.radians(self.direction_deg)
        return [(x, y), (x + self.length_mm * math.cos(angle), y + self.length_mm * math.sin(angle))]


@dataclass(frozen=True, slots=True)
class Arc:
    """Part of a circle, from where the tool is."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    kind: Literal["arc"] = "arc"
    centre_mm: Place = (0.0, 0.0)
    """Centre of the circle in the work frame."""
    angle_deg: float = 90.0
    """Angle to go, positive from x towards y; may be more than a whole turn."""

    def __post_init__(self) -> None:
        check_finite("centre_mm", self.centre_mm)
        if not (math.isfinite(self.angle_deg) and 0 < abs(self.angle_deg) <= 36000):
            raise SettingError(
                "angle_deg", f"must be a number up to ±36000 and not 0, got {self.angle_deg:g}"
            )

    def corners(self, begin: Place | None) -> list[Place]:
        x, y = _known(begin)
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
    """Straight from place to place."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    kind: Literal["polyline"] = "polyline"
    points_mm: tuple[Place, ...] = ()
    """Places in the work frame; the first one is where the tool must be."""

    def __post_init__(self) -> None:
        if len(self.points_mm) < 2:
            raise SettingError("points_mm", "must hold at least two places")
        check_finite("points_mm", *self.points_mm)

    def corners(self, begin: Place | None) -> list[Place]:
        return list(self.points_mm)


@dataclass(frozen=True, slots=True)
class Raster:
    """Lines side by side over a rectangle or a polygon, forth and back."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    kind: Literal["raster"] = "raster"
    corner_mm: Place = (0.0, 0.0)
    """Corner of the rectangle with the smallest x and y; unused with `polygon_mm`."""
    size_mm: Place = (0.0, 0.0)
    """Size of the rectangle along x and y; unused with `polygon_mm`."""
    polygon_mm: tuple[Place, ...] = ()
    """Corners of a polygon instead of the rectangle; each line of the raster must cross it in one piece."""
    spacing_mm: float = 5.0
    """Distance of the lines, at most."""
    along: Literal["x", "y"] = "x"
    """Direction of the lines."""

    def __post_init__(self) -> None:
        require_above_zero(self, "spacing_mm")
        check_finite("corner_mm", self.corner_mm, self.size_mm, *self.polygon_mm)
        if self.polygon_mm and len(self.polygon_mm) < 3:
            raise SettingError("polygon_mm", "must hold at least three places")
        if not self.polygon_mm and not min(self.size_mm) > 0:
            raise SettingError(
                "size_mm", f"must be above 0 both ways, got {self.size_mm[0]:g}, {self.size_mm[1]:g}"
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
            # a hair inside, where a polygon's side or corner lies on the line
            level = low + (high - low) * k / count
            try:
                left, right = _crossing(outline, min(max(level, low + 1e-6), high - 1e-6))
            except ValueError as error:
                across = "x" if self.along == "y" else "y"
                raise ValueError(
                    f"the polygon is {error} by the line at {across} = {level:g} mm: every line must cross it in one "
                    "piece; try the other along, or several tracks"
                ) from None
            ends = [(left, level), (right, level)]
            places += ends if k % 2 == 0 else ends[::-1]
        distinct = [place for place, before in zip(places, [None, *places], strict=False) if place != before]
        return [(v, u) for u, v in distinct] if self.along == "y" else distinct


@dataclass(frozen=True, slots=True)
class Spiral:
    """A spiral out of its centre, or into it."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    kind: Literal["spiral"] = "spiral"
    centre_mm: Place = (0.0, 0.0)
    """Centre in the work frame."""
    radius_mm: float = 20.0
    """Radius of the outermost turn."""
    spacing_mm: float = 5.0
    """Distance of the turns."""
    inwards: bool = False
    """From the outermost turn to the centre."""

    def __post_init__(self) -> None:
        require_above_zero(self, "radius_mm", "spacing_mm")
        check_finite("centre_mm", self.centre_mm)
        if self.radius_mm / self.spacing_mm > 1000:
            raise ValueError("a spiral may have 1000 turns at most: change spacing_mm")

    def corners(self, begin: Place | None) -> list[Place]:
        u, v = self.centre_mm
        places, angle, whole = [(u, v)], 0.0, math.tau * self.radius_mm / self.spacing_mm
        while angle < whole and len(places) < PIECES_MAX:
            radius = max(self.spacing_mm * angle / math.tau, CHORD_MM)
            angle = min(angle + math.tau / _pieces(radius, math.tau), whole)
            radius = self.spacing_mm * angle / math.tau
            places.append((u + radius * math.cos(angle), v + radius * math.sin(angle)))
        return places[::-1] if self.inwards else places


Path: TypeAlias = Annotated[Line | Arc | Polyline | Raster | Spiral, Discriminator("kind")]
"""Path of a stroke, by its kind."""


def _pieces(radius: float, angle: float) -> int:
    """Return the number of straight pieces for a bend of this radius, mm, and angle, rad."""
    widest = 2.0 * math.acos(max(1.0 - CHORD_MM / radius, 0.0)) if radius > CHORD_MM else math.pi / 2
    return max(math.ceil(angle / widest), 2)


def _known(begin: Place | None) -> Place:
    if begin is None:
        raise ValueError(
            "where the path begins is not known: let a move come before, or use a line with length_mm"
        )
    return begin


def _crossing(outline: Sequence[Place], level: float) -> Place:
    """Where a line at this y crosses a polygon: the smallest and the largest x. Raises ValueError for more or fewer
    than two crossings.
    """
    crossings = []
    for (x, y), (u, v) in zip(outline, [*outline[1:], outline[0]], strict=True):
        if (y <= level < v) or (v <= level < y):
            crossings.append(x + (level - y) / (v - y) * (u - x))
    if len(crossings) != 2:
        raise ValueError(f"crossed {len(crossings)} times")
    return min(crossings), max(crossings)
