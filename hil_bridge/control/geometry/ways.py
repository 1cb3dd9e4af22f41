"""Paths in the plane of the work frame, as chains of straight segments.

Points are relative to the start of the path, m, along x (the travel direction) and y (across it).
"""

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

Place: TypeAlias = tuple[float, float]
"""Point (x, y) in the plane of the work frame; mm in settings, m elsewhere."""

PIECES_MAX = 100_000
"""Maximum number of segments in a path. Chosen."""
ROUNDING = 1e-9
"""Tolerance for the rounding error of summed steps, m."""


@dataclass(frozen=True, slots=True)
class Way:
    """Path as a chain of straight segments. Points are relative to its start, m."""

    points: tuple[Place, ...]
    headings: tuple[Place, ...]
    """Unit vector of each segment."""
    begins: tuple[float, ...]
    """Path length at the start of each segment, m, followed by the total length."""
    length: float = field(init=False, repr=False, compare=False)
    """Length of the path, m."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "length", self.begins[-1])

    def piece(self, travel: float) -> int:
        """Return the index of the segment at the given path length."""
        return bisect_right(self.begins, travel, 1, len(self.headings)) - 1

    def at(self, travel: float) -> Place:
        """Return the point at the given path length, m. Beyond its end, the path continues straight."""
        return self.place_and_heading(travel)[0]

    def place_and_heading(self, travel: float) -> tuple[Place, Place]:
        """Return the point at the given path length, m, as `at` does, and the unit vector of its segment."""
        number = self.piece(travel) if len(self.headings) > 1 else 0
        (x, y), heading, rest = self.points[number], self.headings[number], travel - self.begins[number]
        return (x + rest * heading[0], y + rest * heading[1]), heading

    def points_until(self, travel: float) -> tuple[Place, ...]:
        """Return the corners up to the given path length, m, followed by the point at that length."""
        if travel >= self.length:
            return self.points
        return (*self.points[: self.piece(travel) + 1], self.at(travel))

    def along(self, low: float, high: float, place: Place) -> float:
        """Return the path length of the point nearest to a given point, m, between two path lengths."""
        if len(self.headings) == 1:
            return self._on(0, place)
        first, last = self.piece(low), self.piece(high)
        if first == last:
            return self._on(first, place)
        best, nearest = math.inf, high
        for number in range(first, last + 1):
            begin, end = max(self.begins[number], low), min(self.begins[number + 1], high)
            length = min(max(self._on(number, place), begin), end)
            (x, y), (u, v) = self.points[number], self.headings[number]
            rest = length - self.begins[number]
            apart = math.hypot(place[0] - x - rest * u, place[1] - y - rest * v)
            if apart < best:
                best, nearest = apart, length
        return nearest

    def _on(self, number: int, place: Place) -> float:
        """Return the path length at which the given point projects onto the segment."""
        (x, y), (u, v) = self.points[number], self.headings[number]
        return self.begins[number] + ((place[0] - x) * u + (place[1] - y) * v)


def way_of(corners_mm: Sequence[Place]) -> Way:
    """Return the path through the given points, mm, relative to the first point. Raises ValueError if the path has
    no length.
    """
    x0, y0 = corners_mm[0]
    places = [((x - x0) * 1e-3, (y - y0) * 1e-3) for x, y in corners_mm]
    points, headings, begins = [places[0]], [], [0.0]
    for x, y in places[1:]:
        u, v = x - points[-1][0], y - points[-1][1]
        length = math.hypot(u, v)
        if length < 1e-9:
            continue
        points.append((x, y))
        headings.append((u / length, v / length))
        begins.append(begins[-1] + length)
    if not headings:
        raise ValueError("the path has no length")
    if len(headings) > PIECES_MAX:
        raise ValueError(f"a path of {len(headings)} pieces; {PIECES_MAX} are the most")
    return Way(tuple(points), tuple(headings), tuple(begins))
