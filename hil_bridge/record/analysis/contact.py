"""Contact figures: force statistics while the tool is in contact.

They need no target force, so every recording has them.
"""

from collections.abc import Mapping

import numpy as np

from hil_bridge.record.analysis.figures import CONTACT
from hil_bridge.record.foreign import CONTACT_N
from hil_bridge.record.reader import Recording


def contact_figures(recording: Recording) -> Mapping[str, float | None]:
    """Return the contact figures of the samples in contact, by the keys of `analysis.figures`.

    A figure is None if there is no such sample or if the quantity is unknown. The time of a sample is the arrival
    of its sensor frame; in a recording of another program, it is the time stamp of the sample.
    """
    origin, cycles = recording.foreign, recording.cycles
    threshold = CONTACT_N if origin is None else origin.choices.contact_n
    forces = np.array([cycle.force for cycle in cycles])
    touches = forces > threshold
    if not touches.any():
        return dict.fromkeys(one.key for one in CONTACT) | {"contacts": 0.0, "contact_s": 0.0}
    at = np.array([cycle.controlled_at if origin else cycle.sample.sensor_at for cycle in cycles])
    wrenches = np.array([cycle.sample.wrench for cycle in cycles])[touches]
    pressed = forces[touches]
    resultants = np.linalg.norm(wrenches[:, :3], axis=1)
    lateral = np.sqrt(np.maximum(resultants**2 - pressed**2, 0.0))
    moments = np.linalg.norm(wrenches[:, 3:], axis=1)
    values = {
        "contact_force_mean_n": pressed.mean(),
        "contact_force_rms_n": np.sqrt((pressed**2).mean()),
        "contact_force_deviation_n": pressed.std(),
        "contact_force_peak_n": pressed.max(),
        "contact_lateral_peak_n": lateral.max(),
        "contact_moment_peak_nm": moments.max(),
        "contact_s": np.diff(at)[touches[:-1]].sum(),
        "contacts": np.count_nonzero(touches[1:] & ~touches[:-1]) + touches[0],
    }
    return {key: _known(float(value)) for key, value in values.items()}


def _known(value: float) -> float | None:
    return value if np.isfinite(value) else None
