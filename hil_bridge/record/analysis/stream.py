"""Full sensor stream as the controlled force, in addition to the cycles that use some of its frames."""

import math
import statistics
from typing import Any, TypeAlias

import msgspec
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from hil_bridge.control.geometry.wrist import Wrist
from hil_bridge.record.device_facts import devices_of, recorded_configuration
from hil_bridge.record.reader import Recording
from hil_bridge.record.records import Quaternion, Vector
from protocol.geometry import product, turn_about

Floats: TypeAlias = NDArray[np.float64]

_BINS = 3000
_FEWEST_CYCLES = 8
_TOLERANCE = 0.02
"""Largest deviation from the cycle samples for which the stream is drawn, as a share of the force range. Chosen."""


class _Mounting(Struct):
    """Place of the sensor on the tool, as configured."""

    quaternion: Quaternion
    mounting_deg: float
    flip_fx_mx: bool


class _Frame(Struct):
    """Where the surface is, as configured."""

    approach: Vector


class _Configured(Struct):
    """Fields of a recorded configuration that say how the sensor lies to the approach direction."""

    sensor: _Mounting
    frame: _Frame


def stream_force(recording: Recording) -> tuple[Floats, Floats, Floats] | None:
    """Return the sensor's whole stream in N: time, lowest and highest force of each of at most some thousand bins.

    The stream is kept as the device counts. The sensor's facts scale it, and the configuration tells its direction.
    Weight and bias are what the forces of the cycles are beside the frames that they used. Where that does not
    reproduce their force (the tool turned, the bridge filtered), the answer is None.
    """
    along = _along(recording) if recording.cycles else None
    used = {sensor.sequence: sensor.counts[:3] for sensor in recording.sensors}
    pairs = [
        (used[cycle.sample.sensor_sequence], cycle.force)
        for cycle in recording.cycles
        if cycle.sample.sensor_sequence in used and math.isfinite(cycle.force)
    ]
    if along is None or len(pairs) < _FEWEST_CYCLES:
        return None
    force = np.array([value for _, value in pairs])
    offsets = force - np.array([values for values, _ in pairs], dtype=np.float64) @ along
    offset = statistics.median(offsets.tolist())
    if not np.abs(offsets - offset).max() <= _TOLERANCE * max(float(np.ptp(force)), 1e-9):
        return None
    at = np.array([sensor.at for sensor in recording.sensors])
    stream = np.array([sensor.counts[:3] for sensor in recording.sensors], dtype=np.float64) @ along + offset
    starts = np.arange(0, len(at), max(1, math.ceil(len(at) / _BINS)))
    return at[starts], np.minimum.reduceat(stream, starts), np.maximum.reduceat(stream, starts)


def _along(recording: Recording) -> Floats | None:
    """Force along the approach, N, for one of the values of each force axis, (3,); None where that is not known."""
    facts = devices_of(recording).sensor.facts
    try:
        told: Any = msgspec.convert(recorded_configuration(recording), _Configured)
    except ValueError:
        return None
    if facts is None:
        return None
    sensor = told.sensor
    turned = turn_about((0.0, 0.0, 1.0), math.radians(sensor.mounting_deg))
    wrist = Wrist(product(sensor.quaternion, turned), flip=sensor.flip_fx_mx)
    seen = wrist.in_sensor_axes(told.frame.approach, recording.cycles[0].sample.quaternion)
    along: Floats = -seen * np.array(facts.scales[:3])
    return along
