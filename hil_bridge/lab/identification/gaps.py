"""Values that robot and sensor have in common: sample intervals, and the quantisation step."""

import math
from collections.abc import Iterator

import numpy as np

from hil_bridge.lab.fidelity.measures import Floats
from hil_bridge.lab.identification.blocks import Estimate, deviation_of, mean_of
from hil_bridge.lab.identification.values import Quantity, Value, Why

LOST_GAP = 1.5
"""Interval above which samples are missing, as a multiple of the usual interval. Chosen."""
_EVEN_S = 1e-6
"""Deviation of times below which it is rounding of the time stamps, s. Chosen."""
_STEP_SHARE = 0.01
"""Relative uncertainty of a quantisation step. Chosen."""


def usual_gaps(gaps: Floats) -> Floats:
    """Return the intervals between which no samples are missing, s."""
    return gaps[gaps < LOST_GAP * float(np.median(gaps))] if len(gaps) else gaps


def gap_values(
    gaps: Floats, least: int, quantities: tuple[Quantity, Quantity], method: str
) -> Iterator[Value]:
    """Yield mean and deviation of the sample intervals, s. Both are unidentified if there are fewer than `least`
    usual intervals.
    """
    period, jitter = quantities
    usual = usual_gaps(gaps)
    if len(usual) < least:
        yield from (quantity.unseen(Why.NO_SAMPLES) for quantity in quantities)
        return
    yield period.value(mean_of(usual).wider(0.1 * _EVEN_S, "and the rounding of the time stamps"), method)
    deviation = deviation_of(usual)
    yield (
        jitter.unseen(Why.EVEN)
        if deviation.value < _EVEN_S
        else jitter.value(deviation, "standard deviation of these times")
    )


def step_value(quantity: Quantity, size: float) -> Value:
    """Return the quantisation step as a value, which is unidentified if `size` is NaN."""
    if math.isnan(size):
        return quantity.unseen(Why.NO_STEP)
    margin = _STEP_SHARE * size
    estimate = Estimate(size, size - margin, size + margin, "chosen: it is known to 1 %")
    return quantity.value(estimate, "greatest common step of the differences between successive values")
