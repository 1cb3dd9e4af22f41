"""The board's cascade of low-pass filters, and the rates of its parts.

Source: JR3 manual 5907E for the rates. The shape is identified from the manual's plots, hence derived. Every stage
is the same elliptic filter at a quarter of the rate of the previous stage.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FILTER_STEPS = (1, 1, 4, 16, 64, 256, 1024)
"""Samples between two calculations of filter0 … filter6."""
VECTOR_STEPS = (2, 4, 16, 64, 256, 256, 1024)
"""Samples between two calculations of the vectors of filter0 … filter6."""
THRESHOLD_STEP = 4
"""Samples between two comparisons with the load envelopes."""
ORDER = 6
"""Number of states of a stage: two for each second-order section."""

SECTION_COEFFICIENTS = (
    (
        0.00034455671673048246,
        0.00028070277477768675,
        0.0003445567167304825,
        -1.6108564440845012,
        0.6574667328488996,
    ),
    (1.0, -1.0040359379625765, 0.9999999999999998, -1.6679881051392706, 0.7603974028945926),
    (1.0, -1.3755248617554885, 0.9999999999999998, -1.7737167502860054, 0.9137563288854567),
)
"""Coefficients b0 b1 b2 a1 a2 of each section, with a0 = 1 and gain 1 at 0 Hz. Derived: an elliptic low-pass of
order 6, 0.02 dB and 80 dB, whose pass band ends at 438.069 Hz of 8000 Hz. Its −3.01 dB point is a sixteenth of the
rate.
"""

_BLOCK = 128
"""Maximum number of samples in one matrix product. Chosen: the matrix fits the processor's cache."""

Floats = NDArray[np.float64]


class _Products(NamedTuple):
    """One stage as matrices, for samples u (6, n) from a state x (6, `ORDER`): y = u·T + x·O, after = u·W + x·P."""

    through: Floats
    """T, (block, block): the impulse response. Its first n rows and columns apply to n samples."""
    ringing: Floats
    """O, (`ORDER`, block)."""
    driven: Floats
    """W, (block, `ORDER`). Its last n rows apply to n samples."""
    powers: Floats
    """P for 0 … block samples, (block + 1, `ORDER`, `ORDER`)."""


def run_stage(signal: Floats, state: Floats) -> tuple[Floats, Floats]:
    """Run one stage over samples (6, n) from `state` (6, `ORDER`). Return the stage's output (6, n) and new state."""
    products, output, count = _products(), np.empty_like(signal), signal.shape[1]
    for begin in range(0, count, _BLOCK):
        part = signal[:, begin : begin + _BLOCK]
        n = part.shape[1]
        output[:, begin : begin + n] = part @ products.through[:n, :n] + state @ products.ringing[:, :n]
        state = part @ products.driven[_BLOCK - n :] + state @ products.powers[n]
    return output, state


@lru_cache(maxsize=1)
def _products() -> _Products:
    """Compute the matrices by running the stage, sample by sample, from each of its states and from an impulse."""
    states, outputs = [np.eye(ORDER)], []
    for _ in range(_BLOCK):
        output, after = _sample(np.zeros(ORDER), states[-1])
        outputs.append(output)
        states.append(after)
    response, driven = [], []
    (impulse,), after = _sample(np.ones(1), np.zeros((1, ORDER)))
    for _ in range(_BLOCK):
        response.append(impulse)
        driven.append(after[0])
        (impulse,), after = _sample(np.zeros(1), after)
    through = np.zeros((_BLOCK, _BLOCK))
    for row in range(_BLOCK):
        through[row, row:] = response[: _BLOCK - row]
    return _Products(through, np.array(outputs).T.copy(), np.array(driven[::-1]), np.array(states))


def _sample(signal: Floats, state: Floats) -> tuple[Floats, Floats]:
    """Pass one sample (m,) through the sections from the states (m, `ORDER`), by direct recursion."""
    after = np.empty_like(state)
    for n, (b0, b1, b2, a1, a2) in enumerate(SECTION_COEFFICIENTS):
        first, second = 2 * n, 2 * n + 1
        output = b0 * signal + state[:, first]
        after[:, first] = b1 * signal - a1 * output + state[:, second]
        after[:, second] = b2 * signal - a2 * output
        signal = output
    return signal, after
