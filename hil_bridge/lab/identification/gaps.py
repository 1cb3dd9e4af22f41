"""Values that robot and sensor have in common: times between samples, and the step on which values lie."""

import math
from collections.abc import Iterator

import numpy as np

from hil_bridge.lab.fidelity.measures import Floats
from hil_bridge.lab.identification.blocks import Estimate, deviation_of, mean_of
from hil_bridge.lab.identification.values import Quantity, Value, Why

LOST_GAP = 1.5
"""Chosen: a longer gap between samples, in usual ones, misses some."""
_EVEN_S = 1e-6
"""Chosen: a smaller deviation of times is the rounding of stamps."""
_STEP_SHARE = 0.01
"""Chosen: a step is told to one hundredth."""


def usual_gaps(gaps: Floats) -> Floats:
    """The gaps, s, in which no sample is missed."""
    return gaps[gaps < LOST_GAP * float(np.median(gaps))] if len(gaps) else gaps


def gap_values(
    gaps: Floats, least: int, quantities: tuple[Quantity, Quantity], method: str
) -> Iterator[Value]:
    """Mean and deviation of the times between samples, s; unseen for fewer usual ones than `least`."""
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
    """The step on which values lie; NaN for one that is not seen."""
    if math.isnan(size):
        return quantity.unseen(Why.NO_STEP)
    margin = _STEP_SHARE * size
    estimate = Estimate(size, size - margin, size + margin, "chosen: it is told to 1 %")
    return quantity.value(estimate, "step of which the differences of successive values are multiples")
