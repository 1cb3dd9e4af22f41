"""A bag of ROS 2 as columns of known quantities."""

import numpy as np

from hil_bridge.errors import ConfigError
from hil_bridge.lab.fidelity.measures import LEAST_SAMPLES
from hil_bridge.lab.fidelity.tables import Table
from hil_bridge.lab.fidelity.units import FAMILIES, ROTATION, WRENCH
from hil_bridge.record import Recording
from protocol.geometry import rotation_rows


def table_of_bag(bag: Recording) -> Table:
    """All that a bag tells: wrench along the tool's axes, place and rotation of the tool, depth and pressing force.

    Moments that it does not tell are left out, and so is all but the first sample of a time. Raises ConfigError.
    """
    times = np.array([cycle.controlled_at for cycle in bag.cycles])
    new = np.concatenate([[True], np.diff(times) > 0.0])
    cycles = [cycle for cycle, taken in zip(bag.cycles, new, strict=True) if taken]
    if len(cycles) < LEAST_SAMPLES:
        raise ConfigError(f"the bag has {len(cycles)} samples; at least {LEAST_SAMPLES} are compared")
    samples = [cycle.sample for cycle in cycles]
    rotations = np.array([rotation_rows(sample.quaternion) for sample in samples]).reshape(len(samples), 9)
    values = {
        WRENCH: np.array([sample.wrench for sample in samples]),
        FAMILIES["position"]: np.array([sample.position for sample in samples]),
        ROTATION: rotations,
        ("depth", "press"): np.array([(cycle.depth, cycle.force) for cycle in cycles]),
    }
    columns = {name: rows[:, k] for names, rows in values.items() for k, name in enumerate(names)}
    told = {name: column for name, column in columns.items() if np.isfinite(column).all()}
    return Table(times[new], told)
