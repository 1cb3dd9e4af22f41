"""Keeps a number between two others. This runs in every cycle, and `min` and `max` take four times as long."""


def within(value: float, low: float, high: float) -> float:
    """Limit the value to both bounds. NaN stays NaN."""
    return low if value < low else high if value > high else value
