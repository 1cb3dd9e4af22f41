"""Work frame from three points that the tool touches under force control. Pure, except for the types of settings."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hil_bridge.errors import ConfigError
from protocol.geometry import Vector

HOLD_S = 1.0
"""Chosen: how long the tool presses at each place; the mean of the second half counts."""
BACK_MM = 5.0
"""Chosen: least way back from a place, mm. A retract ends no deeper than the start, where the next approach may begin:
its way is bounded.
"""
LEAST_MM = 5.0
"""Chosen: least distance of the third place from the line through the others."""
STEEPEST_DEG = 45.0
"""Chosen: largest angle of the found surface to the one that was assumed."""


def touches(places_mm: Sequence[tuple[float, float]], force_n: float) -> list[dict[str, Any]]:
    """Return steps of a program that touches these places, mm in the work frame, each with a force.

    Raises ConfigError for places that make no plane, before anything moves.
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
    """Name of a touched place."""
    return f"touch {number}"


def frame_of(found: Mapping[str, Sequence[float]], approach: Vector) -> dict[str, list[float]]:
    """Return settings of `[frame]` for a plane through three places, base frame, m.

    X leads from the first to the second.

    `approach` is the direction in which they were touched. Raises ConfigError for places on one line, and for a plane
    that stands too steep to have been touched this way.
    """
    try:
        first, second, third = (np.array(found[name_of(number)], dtype=float) for number in (1, 2, 3))
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
            "nearer to its normal, then touch again"
        )
    # + 0.0 makes 0.0 of -0.0
    return {
        "approach": [round(float(value), 9) + 0.0 for value in normal],
        "travel": [round(float(value), 9) + 0.0 for value in along / length],
        "origin_mm": [round(float(value) * 1e3, 3) + 0.0 for value in first],
    }


def _check_apart(length_mm: float, beside_mm: float) -> None:
    """Raise ConfigError for two places too near to each other, or a third one too near to the line through them."""
    if not (length_mm >= LEAST_MM and beside_mm >= LEAST_MM):
        raise ConfigError(
            f"the three points lie on one line, or are closer than {LEAST_MM:g} mm: touch points farther apart"
        )
