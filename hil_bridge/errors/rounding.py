"""Numbers as text, rounded so that the text agrees with every bound with which the number agrees."""

from collections.abc import Iterable

_DIGITS = range(3, 18)
"""Numbers of significant digits: three, and more as long as rounding would move the number onto or across a bound. 17
digits are exact.
"""


def three_digits(value: float, bounds: Iterable[float] = ()) -> str:
    """Format a number with three significant digits, and with more if it would otherwise reach or cross a bound.

    An integer has no decimals.
    """
    limits = tuple(bounds)
    sides = [_side(value, limit) for limit in limits]
    rounded = (float(f"{value:.{digits}g}") for digits in _DIGITS)
    nearest = next((one for one in rounded if [_side(one, limit) for limit in limits] == sides), value)
    shortest, padded = repr(nearest + 0.0).removesuffix(".0"), f"{nearest:#.3g}".rstrip(".")
    short = float(value).is_integer() or "e" in padded
    return (shortest if short else max(shortest, padded, key=len)).replace("-", "−")


def _side(value: float, bound: float) -> int:
    """Return -1, 0 or 1 for a value below, at or above a bound."""
    return (value > bound) - (value < bound)
