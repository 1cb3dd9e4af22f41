"""Controlled force computed from the full sensor stream, not only from the frames that the cycles used."""

import math
import statistics
from typing import TypeAlias

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
"""Largest deviation from the cycle samples at which the stream is still drawn, as a share of the force range.
Chosen.
"""


class _Mounting(Struct):
    """Configured position of the sensor on the tool."""

    quaternion: Quaternion
    mounting_deg: float
    flip_fx_mx: bool


class _Frame(Struct):
    """Configured orientation of the surface."""

    approach: Vector


class _Configured(Struct):
    """Configuration fields that relate the axes of the sensor to the approach direction."""

    sensor: _Mounting
    frame: _Frame


def stream_of(recording: Recording) -> tuple[Floats, Floats] | None:
    """Return the controlled force in all frames of the sensor: arrival times, s, and forces, N.

    The stream is recorded in device counts. The facts of the sensor scale it, and the configuration gives its
    direction. Weight and bias are the differences between the forces of the cycles and the forces of the frames
    that the cycles used. The result is None if it does not reproduce the force of the cycles, for example because
    the tool turned or a filter was active.
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
    return at, np.array(
        [sensor.counts[:3] for sensor in recording.sensors], dtype=np.float64
    ) @ along + offset


def stream_force(recording: Recording) -> tuple[Floats, Floats, Floats] | None:
    """Return `stream_of` as time, lowest and highest force of at most a few thousand bins; None as there."""
    complete = stream_of(recording)
    if complete is None:
        return None
    at, stream = complete
    starts = np.arange(0, len(at), max(1, math.ceil(len(at) / _BINS)))
    return at[starts], np.minimum.reduceat(stream, starts), np.maximum.reduceat(stream, starts)


def approach_of(recording: Recording) -> Vector | None:
    """Return the configured approach direction in the base frame; None if it is unknown."""
    configured = _configured(recording)
    return None if configured is None else configured.frame.approach


def _configured(recording: Recording) -> _Configured | None:
    try:
        return msgspec.convert(recorded_configuration(recording), _Configured)
    except ValueError:
        return None


def _along(recording: Recording) -> Floats | None:
    """Return the force along the approach direction per count of each force axis, N, (3,); None if it is unknown."""
    facts, configured = devices_of(recording).sensor.facts, _configured(recording)
    if facts is None or configured is None:
        return None
    sensor = configured.sensor
    turned = turn_about((0.0, 0.0, 1.0), math.radians(sensor.mounting_deg))
    wrist = Wrist(product(sensor.quaternion, turned), flip=sensor.flip_fx_mx)
    direction = wrist.in_sensor_axes(configured.frame.approach, recording.cycles[0].sample.quaternion)
    along: Floats = -direction * np.array(facts.scales[:3])
    return along
