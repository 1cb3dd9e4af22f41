"""The board's cascade of low passes and the rates at which its parts run.

Source: JR3 manual 5907E for the rates. The shape is identified from the manual's plots, so derived. Every stage is the
same elliptic filter at a quarter of the rate of the stage before.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

FILTER_STEPS = (1, 1, 4, 16, 64, 256, 1024)
"""Samples from one calculation of filter0 … filter6 to the next."""
VECTOR_STEPS = (2, 4, 16, 64, 256, 256, 1024)
"""The same for their vectors."""
THRESHOLD_STEP = 4
"""The same for load envelopes."""
SECTIONS = 3
"""Second-order sections of a stage."""

_ORDER, _RIPPLE_DB, _STOP_DB = 6, 0.02, 80.0
_EDGE = 438.069 / 4000.0
"""End of the pass band by half the rate; puts −3.01 dB at a sixteenth of the rate."""

Floats = NDArray[np.float64]


@lru_cache(maxsize=1)
def low_pass() -> Floats:
    """Second-order sections (3, 6) of one stage, of gain 1 at 0 Hz."""
    # Here, not above: this import costs more than half a second, and only a board needs it.
    from scipy.signal import ellip

    sections: Floats = ellip(_ORDER, _RIPPLE_DB, _STOP_DB, _EDGE, output="sos")
    gain = np.prod(sections[:, :3].sum(axis=1) / sections[:, 3:].sum(axis=1))
    sections[0, :3] /= gain
    return sections


def run_stage(signal: Floats, state: Floats) -> tuple[Floats, Floats]:
    """One stage over samples (6, n) from `state` (6, 3, 2): its output (6, n) and its state after."""
    from scipy.signal import sosfilt  # here, as above

    output, after = sosfilt(low_pass(), signal, zi=state.transpose(1, 0, 2))
    return output, after.transpose(1, 0, 2)
