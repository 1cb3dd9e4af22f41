"""Emulated force/torque sensor under the load of a recording, read by the regular client over its link in virtual
time.

If the recording has the rotation of the sensor, the load is the weight of the tool, with mass, centre of gravity
and zero fitted to the measured wrench. Otherwise, the load is the mean of the measured wrench.
"""

import math
from contextlib import AsyncExitStack
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from hil_bridge.clock import Clock, run_virtual
from hil_bridge.control.analysis.tool_identification import ToolPose, identify_tool
from hil_bridge.control.geometry.frames import GRAVITY_BASE
from hil_bridge.control.geometry.wrist import Wrist
from hil_bridge.devices.device_log import CallbackLog
from hil_bridge.devices.sensors.stream import ForceSensor
from hil_bridge.devices.wiring import Serving, Wiring
from hil_bridge.errors import ConfigError
from hil_bridge.lab.fidelity.measures import Floats
from hil_bridge.lab.fidelity.tables import Table
from hil_bridge.lab.fidelity.units import WRENCH
from hil_bridge.settings.configuration import Config
from hil_bridge.settings.devices import Sensor, sensor_in
from protocol.wrench import WrenchFrame, wrench_of

LOADS = tuple(f"load_{name}" for name in WRENCH)
"""Names of the load columns, in the order of a wrench."""
_POSES = 60
"""Maximum number of readings from which the tool is identified. Chosen: for a slow motion, more readings add
nothing.
"""
_LEAD_S = 0.1
"""Time for which the sensor streams before the load begins to change, s. Chosen."""
_ORTHOGONAL = 1e-3
"""Largest deviation of a rotation matrix from orthonormality. Chosen."""


def with_load(table: Table) -> Table:
    """Add the columns of the load to a table. Raises ConfigError without a wrench, and for an invalid rotation."""
    if not table.has("force"):
        raise ConfigError("the recording has no sensor wrench; map force and, if present, moment")
    moments = table.rows("moment") if table.has("moment") else np.zeros((len(table.times), 3))
    wrench = np.hstack([table.rows("force"), moments])
    load = _weight(table, wrench) if table.has("rotation") else np.tile(wrench.mean(axis=0), (len(wrench), 1))
    columns = {**table.columns, **dict(zip(LOADS, load.T, strict=True))}
    return Table(table.times, columns, table.at_arrival)


def _weight(table: Table, wrench: Floats) -> Floats:
    """Return the wrench (n, 6) of the tool's weight and the sensor's zero, fitted to the readings, N and N·m."""
    rotations = table.rows("rotation").reshape(-1, 3, 3)
    error = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max()
    if error > _ORTHOGONAL or (np.linalg.det(rotations) < 0.0).any():
        raise ConfigError(
            f"rotation: not a rotation matrix, deviation {error:.3g}; give the sensor's frame in the base frame"
        )
    chosen = np.linspace(0, len(wrench) - 1, min(_POSES, len(wrench))).astype(int)
    quaternions = Rotation.from_matrix(rotations[chosen]).as_quat()[:, [3, 0, 1, 2]]
    poses = [
        ToolPose((w, x, y, z), tuple(reading))
        for (w, x, y, z), reading in zip(quaternions.tolist(), wrench[chosen].tolist(), strict=True)
    ]
    tool = identify_tool(poses, Wrist())
    gravity = np.einsum("nji,j->ni", rotations, GRAVITY_BASE)
    force = tool.mass * gravity
    moment = np.cross(np.array(tool.centre_of_gravity), force)
    load: Floats = np.hstack([force, moment]) + np.array(tool.bias)
    return load


class _Load:
    """`WrenchSource` with the loads of a recording: the first load until `begin`, and the last load after the end."""

    def __init__(self, table: Table) -> None:
        self._times = table.times
        self._load = np.column_stack([table.columns[name] for name in LOADS])
        self.begin = math.inf
        """Time at which the recording starts, s; infinity until it is known."""
        self.on_change = lambda time: None

    def wrench(self, times: Floats) -> Floats:
        """Return the wrench at these times; see `WrenchSource.wrench`."""
        if math.isinf(self.begin):
            return np.tile(self._load[0], (len(times), 1))
        at = times - self.begin
        return np.column_stack([np.interp(at, self._times, part) for part in self._load.T])

    def committed_until(self, now: float) -> float:
        """Return `now`: the start of the recording is not known in advance."""
        return now

    def predicted_until(self, now: float) -> float:
        """Return `now`, for the same reason as `committed_until`."""
        return now


def emulate_sensor(config: Config, table: Table) -> Table:
    """Return the table that the emulator of a configured sensor reports under the load of a table. Raises
    ConfigError.
    """
    device = sensor_in(config)
    if device.kind.emulation is None:
        raise ConfigError(f"{device.kind.name} has no emulator")
    times, values = run_virtual(lambda: _listen(device, config.run.seed, table))
    inside = (times >= 0.0) & (times <= table.times[-1])
    columns = dict(zip(WRENCH, values[inside].T, strict=True))
    columns |= {name: np.interp(times[inside], table.times, table.columns[name]) for name in LOADS}
    return Table(times[inside], columns)


async def _listen(device: Sensor, seed: int, table: Table) -> tuple[Floats, Floats]:
    """Return the arrival time of each frame, s since the start of the recording, and its wrench, (n, 6)."""
    clock = Clock.running()
    frames: list[WrenchFrame] = []
    failures: list[BaseException] = []
    log = CallbackLog(frame=frames.append)
    source = _Load(table)
    emulation: Any = device.kind.emulation
    async with AsyncExitStack() as stack:
        serving = Serving(clock, stack, failures.append, lambda text: None)
        emulated = emulation.make(device.settings)(source, clock.now(), seed)
        url = await emulation.serve(
            emulation.usual(device.settings, True), emulated, device.settings, serving
        )
        wire, client = await device.kind.connect(url, device.settings, Wiring("sensor", clock, log))
        sensor = ForceSensor(wire, client, clock, log)
        stack.push_async_callback(sensor.aclose)
        sensor.start()
        facts = await sensor.ready()
        begin = source.begin = clock.now() + _LEAD_S
        await clock.sleep_until(begin + float(table.times[-1]))
    if failures:
        raise ConfigError(f"the emulated {device.kind.name} failed: {failures[0]}")
    times = np.array([frame.at for frame in frames]) - begin
    values = np.array([wrench_of(frame.values, facts.scales) for frame in frames])
    clock.close()
    return times, values
