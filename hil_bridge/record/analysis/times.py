"""Distributions of durations."""

import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Times:
    """Distribution of durations, s."""

    mean_s: float
    p50_s: float
    p90_s: float
    p99_s: float
    max_s: float

    def as_ms(self) -> Mapping[str, float]:
        """Return percentiles and largest value in ms, for a summary. The resolution of time stamps is 1 ns."""
        named = {"p50_ms": self.p50_s, "p90_ms": self.p90_s, "p99_ms": self.p99_s, "max_ms": self.max_s}
        return {name: round(value * 1e3, 6) for name, value in named.items()}


def in_ms(seconds: float) -> str:
    """Format a duration in ms, without decimals from 10 ms on."""
    milliseconds = seconds * 1e3
    return f"{milliseconds:.0f}" if abs(milliseconds) >= 9.95 else f"{milliseconds:.1f}"


def times_of(durations: Iterable[float]) -> Times | None:
    """Return the distribution of these values, ignoring NaN; None if no value remains."""
    known = sorted([duration for duration in durations if math.isfinite(duration)])
    if not known:
        return None
    p50, p90, p99 = (_quantile(known, share) for share in (0.5, 0.9, 0.99))
    return Times(statistics.fmean(known), p50, p90, p99, known[-1])


def _quantile(ascending: Sequence[float], share: float) -> float:
    """Interpolate linearly, bit for bit like `numpy.quantile`, which would import masked arrays."""
    place = (len(ascending) - 1) * share
    number = math.floor(place)
    low, high = ascending[number], ascending[min(number + 1, len(ascending) - 1)]
    part = place - number
    return high - (high - low) * (1.0 - part) if part >= 0.5 else low + (high - low) * part
