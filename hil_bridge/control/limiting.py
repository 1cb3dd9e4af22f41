"""Clamping of a number. It runs in every cycle, and `min` and `max` would take four times as long."""


def within(value: float, low: float, high: float) -> float:
    """Return the value clamped to both bounds. NaN stays NaN."""
    return low if value < low else high if value > high else value
