"""Counts of a JR3 sensor and what they mean, the same behind every gateway and board."""

import math
from collections.abc import Sequence

from protocol.geometry import Wrench

AXES = ("fx", "fy", "fz", "mx", "my", "mz")
FULL_SCALE_COUNTS = 16384
"""Counts that mean full scale; twice as much is representable. Source: JR3 manual 5907E."""
SATURATED_COUNTS = 32752
"""Counts from which an axis may be at the end of its range, whatever the converter.

Derived: 32768 − 2^(16 − bits), the manual's default, for the coarsest converter of 12 bits.
"""


def full_scales_si(forces: Sequence[int], moments: Sequence[int]) -> tuple[float, ...]:
    """The six full scales in N and N·m from the words of both queries (N, N·m×10)."""
    return (*(float(word) for word in forces), *(word / 10 for word in moments))


def wrench_from_counts(counts: Sequence[int], full_scales: Sequence[float]) -> Wrench:
    """Six counts in N and N·m; full scales in N and N·m."""
    (fx, fy, fz, mx, my, mz), (a, b, c, d, e, f), one = counts, full_scales, FULL_SCALE_COUNTS
    return fx * a / one, fy * b / one, fz * c / one, mx * d / one, my * e / one, mz * f / one


def counts_from_wrench(wrench: Sequence[float], full_scales: Sequence[float]) -> tuple[int, ...]:
    """The nearest six counts to a wrench in N and N·m, not saturated; full scales in N and N·m."""
    return tuple(
        math.floor(value * FULL_SCALE_COUNTS / scale + 0.5)
        for value, scale in zip(wrench, full_scales, strict=True)
    )
