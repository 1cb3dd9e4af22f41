"""Values of a recording as text for people and for programs."""

import math
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Any

import msgspec

from hil_bridge.lab.identification.values import Part, Value, Values

_VALUE, _WORDS = 18, 38
"""Widths of columns."""
_MOST_DECIMALS = 6
_PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))
_PREFIXED = ("s", "m", "N", "N·m")
"""Units that take a prefix."""


def describe(values: Values, methods: bool = True) -> Iterator[str]:
    """Lines by part of the cell: values with their intervals; behind them method and interval, once for all values that
    share them; then what is not seen, by reason.
    """
    yield f"{'':<{_WORDS + 2}}{'found':<{_VALUE}}interval of 95 %"
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
            missing = _together([value.words for value in rows if value.why is why])
            yield f"  not seen in this recording: {missing}"
            yield f"      {why.value}"


def _together(words: Sequence[str]) -> str:
    """Words of several values; of those that differ in their axis, the axes alone."""
    axes: dict[str, list[str]] = {}
    for text in words:
        general, _, last = text.rpartition(" ")
        axes.setdefault(general, []).append(last)
    return "; ".join(f"{general} {', '.join(last)}" for general, last in axes.items())


def format_value(value: Value) -> tuple[str, str, str]:
    """The value and both ends of its interval, in one unit, with the digits that the interval leaves."""
    size, unit = _unit_of(value)
    numbers = [number / size for number in (value.value, value.low, value.high)]
    half = 0.5 * (numbers[2] - numbers[1])
    decimals = 3 if half <= 0.0 else min(max(1 - math.floor(math.log10(half)), 0), _MOST_DECIMALS)
    number, low, high = (
        f"{round(number, decimals) + 0.0:.{decimals}f}".replace("-", "−") for number in numbers
    )
    return f"{number} {unit}".rstrip(), low, f"{high} {unit}".rstrip()


def _unit_of(value: Value) -> tuple[float, str]:
    """Size of the unit in which a value is shown, and its name: with a prefix where the value is small."""
    if value.unit.partition("/")[0] not in _PREFIXED:
        return 1.0, value.unit
    largest = max(abs(value.value), 0.5 * abs(value.high - value.low))
    size, prefix = next((pair for pair in _PREFIXES if largest >= pair[0]), _PREFIXES[-1])
    return size, f"{prefix}{value.unit}"


def as_values(values: Values) -> list[dict[str, Any]]:
    """One object for each value; null where it is not seen."""
    rows = []
    for value in values:
        row = msgspec.to_builtins(value)
        row["why"] = None if value.why is None else value.why.value
        rows.append(
            {key: None if isinstance(item, float) and math.isnan(item) else item for key, item in row.items()}
        )
    return rows
