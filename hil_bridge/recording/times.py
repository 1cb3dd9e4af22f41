"""Distributions of durations."""

import math
import statistics
from collections.abc import Iterable, Mapping

import numpy as np

from protocol.values import dataclass


@dataclass(frozen=True, slots=True)
class Times:
    """A distribution of durations, s."""

    mean_s: float
    p50_s: float
    p90_s: float
    p99_s: float
    max_s: float

    def as_ms(self) -> Mapping[str, float]:
        """Percentiles and largest in ms, for a summary; a nanosecond is as fine as anybody stamps."""
        named = {"p50_ms": self.p50_s, "p90_ms": self.p90_s, "p99_ms": self.p99_s, "max_ms": self.max_s}
        return {name: round(value * 1e3, 6) for name, value in named.items()}


def times_of(durations: Iterable[float]) -> Times | None:
    """The distribution of those that are numbers; None when none is."""
    known = [duration for duration in durations if math.isfinite(duration)]
    if not known:
        return None
    p50, p90, p99 = (float(value) for value in np.percentile(known, (50, 90, 99)))
    return Times(statistics.fmean(known), p50, p90, p99, max(known))
