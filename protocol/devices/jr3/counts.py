"""Counts of a JR3 sensor and their meaning, which is the same for all gateways and boards."""

from collections.abc import Sequence

from protocol.geometry import Wrench
from protocol.wrench import SensorFacts

FULL_SCALE_COUNTS = 16384
"""Number of counts at full scale. The sensor can represent twice as many. Source: JR3 manual 5907E."""
_RANGE_FULL_SCALES = 2.0
"""End of the count range as a multiple of the full scale. Derived from 16-bit counts."""


def full_scales_si(forces: Sequence[int], moments: Sequence[int]) -> tuple[float, ...]:
    """Convert the words of both full-scale responses (N, N·m×10) to six full scales in N and N·m."""
    return (*(float(word) for word in forces), *(word / 10 for word in moments))


def facts_of(
    full_scales: Sequence[float], period: float | None, delay: float, model: str = ""
) -> SensorFacts:
    """Return the properties of a JR3 sensor with these full scales, N and N·m. The sensor itself subtracts the zero."""
    a, b, c, d, e, f = full_scales
    limit: Wrench = (a, b, c, d, e, f)
    return SensorFacts(
        model=model,
        scales=_times(limit, 1.0 / FULL_SCALE_COUNTS),
        full_scales=limit,
        range=_times(limit, _RANGE_FULL_SCALES),
        period=period,
        delay=delay,
        tares="device",
    )


def _times(six: Wrench, factor: float) -> Wrench:
    a, b, c, d, e, f = six
    return a * factor, b * factor, c * factor, d * factor, e * factor, f * factor
