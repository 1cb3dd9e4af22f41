"""Counts of a JR3 sensor and what they mean, the same behind every gateway and board."""

from collections.abc import Sequence

from protocol.geometry import Wrench
from protocol.wrench import SensorFacts

FULL_SCALE_COUNTS = 16384
"""Counts that mean full scale; twice as much is representable. Source: JR3 manual 5907E."""
_RANGE_FULL_SCALES = 2.0
"""Full scales to the end of the counts. Derived: from 16 bits."""


def full_scales_si(forces: Sequence[int], moments: Sequence[int]) -> tuple[float, ...]:
    """Convert the words of both full-scale queries (N, N·m×10) to six full scales in N and N·m."""
    return (*(float(word) for word in forces), *(word / 10 for word in moments))


def facts_of(
    full_scales: Sequence[float], period: float | None, delay: float, model: str = ""
) -> SensorFacts:
    """Facts of a JR3 sensor with these full scales in N and N·m; it takes its zero itself."""
    a, b, c, d, e, f = full_scales
    whole: Wrench = (a, b, c, d, e, f)
    return SensorFacts(
        model=model,
        scales=_times(whole, 1.0 / FULL_SCALE_COUNTS),
        full_scales=whole,
        range=_times(whole, _RANGE_FULL_SCALES),
        period=period,
        delay=delay,
        tares="device",
    )


def _times(six: Wrench, factor: float) -> Wrench:
    a, b, c, d, e, f = six
    return a * factor, b * factor, c * factor, d * factor, e * factor, f * factor
