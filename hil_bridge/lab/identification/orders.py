"""The set points that a robot that streams was given, packet by packet, from the targets that a recording keeps.

A control cycle may take several packets, and the client goes to a new target at its own pace. A lag is told from what
the robot was given, so the way of each set point is gone again.
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
"""Chosen: no turn is bounded, for none is looked at."""
NO_TURN = (1.0, 0.0, 0.0, 0.0)


def given_orders(run: Recording, cycle_s: float, speed: float, acceleration: float) -> Table:
    """Given and reported places at the robot's packets, before the first retraction. `speed`, m/s, and `acceleration`,
    m/s², are those of the client. Raises ConfigError as `places_of`.
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
    given = []
    for number in newest.tolist():
        if number >= 0:
            here = ramp.step(here, Pose(_vector(cycles[number].target), NO_TURN), pace, cycle_s)
        given.append(here.position)
    columns = dict(zip(FAMILIES["order_position"], np.array(given).T, strict=True))
    columns |= {axis: np.interp(times, places.times, places.columns[axis]) for axis in FAMILIES["position"]}
    return Table(times, columns, at_arrival=True)


def _vector(values: Sequence[float]) -> Vector:
    x, y, z = values
    return x, y, z
