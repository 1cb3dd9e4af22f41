"""Values common to robot and sensor: sample intervals, and the quantisation step."""

import math
from collections.abc import Iterator

import numpy as np

from hil_bridge.lab.fidelity.measures import Floats
from hil_bridge.lab.identification.blocks import Estimate, deviation_of, mean_of
from hil_bridge.lab.identification.values import Quantity, Value, Why

LOST_GAP = 1.5
"""Chosen: interval, in multiples of the usual one, above which samples are missing."""
_EVEN_S = 1e-6
"""Chosen: deviation of times below which it is rounding of time stamps."""
_STEP_SHARE = 0.01
"""Chosen: relative uncertainty of a step."""


def usual_gaps(gaps: Floats) -> Floats:
    """Return the intervals, s, without missing samples."""
    return gaps[gaps < LOST_GAP * float(np.median(gaps))] if len(gaps) else gaps


def gap_values(
    gaps: Floats, least: int, quantities: tuple[Quantity, Quantity], method: str
) -> Iterator[Value]:
    """Return mean and deviation of the sample intervals, s; not identified for fewer usual ones than `least`."""
    period, jitter = quantities
    usual = usual_gaps(gaps)
    if len(usual) < least:
        yield from (quantity.unseen(Why.NO_SAMPLES) for quantity in quantities)
        return
    yield period.value(mean_of(usual).wider(0.1 * _EVEN_S, "and the rounding of the stamps"), method)
    deviation = deviation_of(usual)
    yield (
        jitter.unseen(Why.EVEN)
        if deviation.value < _EVEN_S
        else jitter.value(deviation, "standard deviation of these times")
    )


def step_value(quantity: Quantity, size: float) -> Value:
    """Return the quantisation step; NaN if it is not identified."""
    if math.isnan(size):
        return quantity.unseen(Why.NO_STEP)
    margin = _STEP_SHARE * size
    estimate = Estimate(size, size - margin, size + margin, "chosen: it is told to 1 %")
    return quantity.value(estimate, "step of which the differences of successive values are multiples")
