"""Work frame from three points that the tool touches under force control. Pure, except for the types of settings."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hil_bridge.errors import ConfigError
from protocol.geometry import Vector

HOLD_S = 1.0
"""Time for which the tool presses at each point, s. The mean of the second half of this time is used. Chosen."""
BACK_MM = 5.0
"""Shortest retraction from a point, mm. Chosen.

A retraction ends no deeper than the start, where the next approach may begin. The distance of the next approach is
limited.
"""
LEAST_MM = 5.0
"""Smallest distance of the third point from the line through the other two, mm. Chosen."""
STEEPEST_DEG = 45.0
"""Largest angle between the measured and the assumed surface, °. Chosen."""


def touches(places_mm: Sequence[tuple[float, float]], force_n: float) -> list[dict[str, Any]]:
    """Return the steps of a program that touches these points, mm in the work frame, each with a force.

    Raises ConfigError before anything moves if the points do not define a plane.
    """
    (x, y), (p, q), (u, v) = places_mm
    length = math.hypot(p - x, q - y)
    _check_apart(length, abs((p - x) * (v - y) - (q - y) * (u - x)) / max(length, 1e-6))
    steps: list[dict[str, Any]] = []
    for number, place in enumerate(places_mm, 1):
        steps += [
            {"do": "move", "to_mm": place},
            {"do": "approach"},
            {"do": "hold", "for_s": HOLD_S, "force_n": force_n, "name": name_of(number)},
            {"do": "retract", "back_mm": BACK_MM},
        ]
    return steps


def name_of(number: int) -> str:
    """Return the name of a touched point."""
    return f"touch {number}"


def frame_of(points: Mapping[str, Sequence[float]], approach: Vector) -> dict[str, list[float]]:
    """Return the settings of `[frame]` for a plane through three points, base frame, m. The x axis points from the
    first to the second point.

    `approach` is the direction in which the points were touched. Raises ConfigError if the points are on one line,
    or if the plane is too steep to have been touched in this direction.
    """
    try:
        first, second, third = (np.array(points[name_of(number)], dtype=float) for number in (1, 2, 3))
    except KeyError as error:
        raise ConfigError(f"no contact {error.args[0]}: the run ended before it") from error
    along, aside = second - first, third - first
    length = float(np.linalg.norm(along))
    normal = np.cross(along, aside)
    size = float(np.linalg.norm(normal))
    _check_apart(length * 1e3, size / max(length, 1e-9) * 1e3)
    normal /= size
    if normal @ approach < 0:
        normal = -normal
    angle = math.degrees(math.acos(min(float(normal @ approach), 1.0)))
    if angle > STEEPEST_DEG:
        raise ConfigError(
            f"the plane is at {angle:.0f}° to frame.approach, more than {STEEPEST_DEG:g}°: set frame.approach "
            "closer to its normal, then touch again"
        )
    # adding 0.0 turns -0.0 into 0.0
    return {
        "approach": [round(float(value), 9) + 0.0 for value in normal],
        "travel": [round(float(value), 9) + 0.0 for value in along / length],
        "origin_mm": [round(float(value) * 1e3, 3) + 0.0 for value in first],
    }


def _check_apart(length_mm: float, distance_mm: float) -> None:
    """Raise ConfigError if two points are too close to each other, or the third point is too close to the line
    through them.
    """
    if not (length_mm >= LEAST_MM and distance_mm >= LEAST_MM):
        raise ConfigError(
            f"the three points lie on one line, or are closer than {LEAST_MM:g} mm: touch points farther apart"
        )
