"""Conversion of a ROS 2 bag to columns of known quantities."""

import numpy as np

from hil_bridge.errors import ConfigError
from hil_bridge.lab.fidelity.measures import LEAST_SAMPLES
from hil_bridge.lab.fidelity.tables import Table
from hil_bridge.lab.fidelity.units import FAMILIES, ROTATION, WRENCH
from hil_bridge.record import Recording
from protocol.geometry import rotation_rows


def table_of_bag(bag: Recording) -> Table:
    """Return the quantities of a bag: wrench in the tool frame, position and rotation of the tool, depth, and
    force.

    Columns with missing values are left out. Of several samples with the same time, only the first is kept. Raises
    ConfigError.
    """
    times = np.array([cycle.controlled_at for cycle in bag.cycles])
    new = np.concatenate([[True], np.diff(times) > 0.0])
    cycles = [cycle for cycle, is_new in zip(bag.cycles, new, strict=True) if is_new]
    if len(cycles) < LEAST_SAMPLES:
        raise ConfigError(f"the bag has {len(cycles)} samples; at least {LEAST_SAMPLES} are required")
    samples = [cycle.sample for cycle in cycles]
    rotations = np.array([rotation_rows(sample.quaternion) for sample in samples]).reshape(len(samples), 9)
    values = {
        WRENCH: np.array([sample.wrench for sample in samples]),
        FAMILIES["position"]: np.array([sample.position for sample in samples]),
        ROTATION: rotations,
        ("depth", "press"): np.array([(cycle.depth, cycle.force) for cycle in cycles]),
    }
    columns = {name: rows[:, k] for names, rows in values.items() for k, name in enumerate(names)}
    complete = {name: column for name, column in columns.items() if np.isfinite(column).all()}
    return Table(times[new], complete)
