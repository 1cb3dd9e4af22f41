"""Conversion of a recorded run to columns of known quantities: positions of the robot, or wrench of the sensor."""

from itertools import takewhile

import numpy as np

from hil_bridge.control.course.intent import Phase
from hil_bridge.devices.facts import Pacing
from hil_bridge.errors import ConfigError
from hil_bridge.lab.fidelity.measures import LEAST_SAMPLES
from hil_bridge.lab.fidelity.tables import Table
from hil_bridge.lab.fidelity.units import FAMILIES, WRENCH
from hil_bridge.record import Recording
from hil_bridge.record.device_facts import devices_of
from protocol.wrench import wrench_of

_STEERED = (Phase.APPROACH, Phase.TRACK)
"""Phases in which each cycle has a new order."""

_BEFORE_TOUCH_S = 0.5
"""Largest delay between a contact and its detection, s. Chosen."""


def places_of(run: Recording) -> Table:
    """Return ordered and reported positions of a run, by cycle. Raises ConfigError.

    Only the cycles before the first retraction are used, because a retraction is a long motion to a single order.
    """
    cycles = list(takewhile(lambda cycle: cycle.phase in _STEERED, run.cycles))
    if len(cycles) < LEAST_SAMPLES:
        raise ConfigError(
            f"the recording has {len(cycles)} cycles before it retracts; at least {LEAST_SAMPLES} are required"
        )
    # The report of a streaming robot follows the target of the previous cycle.
    late = 1 if devices_of(run).robot.pacing is Pacing.STREAMED else 0
    times = np.array([cycle.sample.now for cycle in cycles[late:]])
    targets = np.array([cycle.target for cycle in cycles[: len(cycles) - late]])
    places = np.array([cycle.sample.position for cycle in cycles[late:]])
    columns = {axis: places[:, k] for k, axis in enumerate(FAMILIES["position"])}
    columns |= {name: targets[:, k] for k, name in enumerate(FAMILIES["order_position"])}
    return Table(times - times[0], columns, at_arrival=True)


def wrench_before_contact(run: Recording) -> Table:
    """Return the wrench on the sensor without contact, from the zeroing of a run to its first contact. Raises
    ConfigError.
    """
    facts = devices_of(run).sensor.facts
    if facts is None:
        raise ConfigError("the recording does not contain the scales of its sensor")
    touch = next((cycle.sample.sensor_at for cycle in run.cycles if cycle.in_contact), np.inf)
    begin = run.cycles[0].started_at if run.cycles else np.inf  # the zero was taken before
    frames = [frame for frame in run.sensors if begin < frame.at < touch - _BEFORE_TOUCH_S]
    if len(frames) < LEAST_SAMPLES:
        raise ConfigError(
            f"the recording has {len(frames)} frames between its zero and its first contact; "
            f"at least {LEAST_SAMPLES} are required"
        )
    times = np.array([frame.at for frame in frames])
    wrench = np.array([wrench_of(frame.counts, facts.scales) for frame in frames])
    return Table(times - times[0], dict(zip(WRENCH, wrench.T, strict=True)), at_arrival=True)
