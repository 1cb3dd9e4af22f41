"""Identified values as text."""

import math
from collections.abc import Iterator, Sequence
from itertools import groupby

from hil_bridge.lab.fidelity.units import prefixed_unit
from hil_bridge.lab.identification.values import Part, Value, Values

_VALUE, _WORDS = 18, 38
"""Widths of the columns of values and of descriptions, characters."""
_MOST_DECIMALS = 6


def describe(values: Values, methods: bool = True) -> Iterator[str]:
    """Yield the identified values as text lines, by part of the cell.

    Each value has its interval. Method and interval method follow once for all values that share them. The
    unidentified values come last, by reason.
    """
    yield f"{'':<{_WORDS + 2}}{'value':<{_VALUE}}95 % interval"
    for part in Part:
        rows = [value for value in values if value.part is part]
        yield part.value
        seen = [value for value in rows if value.why is None]
        for (method, interval), group in groupby(seen, key=lambda value: (value.method, value.interval)):
            for value in group:
                number, low, high = format_value(value)
                yield f"  {value.words:<{_WORDS}}{number:<{_VALUE}}{low} … {high}"
            if methods:
                yield f"      {method}; {interval}"
        for why in dict.fromkeys(value.why for value in rows if value.why is not None):
            missing = _combine_names([value.words for value in rows if value.why is why])
            yield f"  not identified in this recording: {missing}"
            yield f"      {why.value}"


def _combine_names(names: Sequence[str]) -> str:
    """Combine the names of several values into one text. Names that differ only in the axis share one entry that
    lists the axes.
    """
    axes: dict[str, list[str]] = {}
    for text in names:
        general, _, last = text.rpartition(" ")
        axes.setdefault(general, []).append(last)
    return "; ".join(f"{general} {', '.join(last)}" for general, last in axes.items())


def format_value(value: Value) -> tuple[str, str, str]:
    """Format a value and both ends of its interval in a common unit, with the digits that the interval justifies."""
    largest = max(abs(value.value), 0.5 * abs(value.high - value.low))
    size, unit = prefixed_unit(largest, value.unit)
    numbers = [number / size for number in (value.value, value.low, value.high)]
    half = 0.5 * (numbers[2] - numbers[1])
    decimals = 3 if half <= 0.0 else min(max(1 - math.floor(math.log10(half)), 0), _MOST_DECIMALS)
    number, low, high = (
        f"{round(number, decimals) + 0.0:.{decimals}f}".replace("-", "−") for number in numbers
    )
    return f"{number} {unit}".rstrip(), low, f"{high} {unit}".rstrip()
