"""Runs that begin just above the surface: at the defaults, most of a run is the way to the surface and back."""

from typing import Any

NEAR: dict[str, Any] = {
    "cell": {"start_position_mm": (900.0, -100.0, 592.0)},
    "task": {"retract_mm": 4.0},
}
"""Settings for a start 2 mm above a flat surface, and a short way back."""


def merged(settings: dict[str, Any], more: dict[str, Any]) -> dict[str, Any]:
    """Nested settings, with more of them laid over."""
    result = dict(settings)
    for key, value in more.items():
        both = isinstance(value, dict) and isinstance(result.get(key), dict)
        result[key] = merged(result[key], value) if both else value
    return result
