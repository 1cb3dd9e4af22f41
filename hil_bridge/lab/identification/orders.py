"""Setpoints sent to a streaming robot, packet by packet, reconstructed from the targets in a recording.

A control cycle may span several packets, and the client approaches a new target at its own pace. The lag of the
robot is relative to the setpoints that were sent, so their path is reconstructed.
"""

from collections.abc import Sequence

import numpy as np

from hil_bridge.devices.robots.ramp import Pace, Ramp
from hil_bridge.lab.fidelity.runs import places_of
from hil_bridge.lab.fidelity.tables import Table
from hil_bridge.lab.fidelity.units import FAMILIES
from hil_bridge.record import Recording
from protocol.geometry import Pose, Vector

_TURNS = 1e3
"""Limit of the rotation. Chosen: so large that it has no effect, because rotations are not evaluated."""
NO_TURN = (1.0, 0.0, 0.0, 0.0)


def setpoints_at_packets(run: Recording, cycle_s: float, speed: float, acceleration: float) -> Table:
    """Return ordered and reported positions at the robot's packets, before the first retraction.

    `speed`, m/s, and `acceleration`, m/s², are the limits of the client's setpoints. Raises ConfigError as
    `places_of` does.
    """
    places = places_of(run)
    count = len(places.times) + 1
    cycles = run.cycles[:count]
    origin = cycles[1].sample.now  # where the times of `places_of` begin
    times = np.arange(0.0, places.times[-1], cycle_s)
    sent = np.array([cycle.sent_at for cycle in cycles]) - origin
    newest = np.searchsorted(sent, times - 1e-9) - 1
    ramp, pace = Ramp(cycle_s), Pace(speed, _TURNS, acceleration, _TURNS)
    here = Pose(_vector(cycles[max(int(newest[0]), 0)].target), NO_TURN)
    orders = []
    for number in newest.tolist():
        if number >= 0:
            here = ramp.step(here, Pose(_vector(cycles[number].target), NO_TURN), pace, cycle_s)
        orders.append(here.position)
    columns = dict(zip(FAMILIES["order_position"], np.array(orders).T, strict=True))
    columns |= {axis: np.interp(times, places.times, places.columns[axis]) for axis in FAMILIES["position"]}
    return Table(times, columns, at_arrival=True)


def _vector(values: Sequence[float]) -> Vector:
    x, y, z = values
    return x, y, z
