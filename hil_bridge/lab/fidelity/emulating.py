"""Replay of a recording's inputs to an emulated robot, whose reports form the emulated table."""

from typing import NamedTuple

import numpy as np

from emulators.seams import StartPose
from hil_bridge.devices.trajectory import Trajectory
from hil_bridge.errors import ConfigError
from hil_bridge.lab.fidelity.tables import Table
from hil_bridge.settings.configuration import Config
from hil_bridge.settings.devices import robot_in

POWERED_S = 1000.25
"""Power-up time of the emulated device, s. Chosen: not a round number, so that no time starts at 0."""
_DRIVES = ("order_q", "order_qd", "order_position", "target_q", "target_qd", "target_position")
"""Families that can be replayed, in order of preference."""
_NOWHERE = (0.0, 0.0, 0.0)


class Drive(NamedTuple):
    """Family of a recording that is replayed to a robot."""

    family: str
    """Name of the family in the recording; empty if the robot remains stationary."""
    order: str
    """Name of the corresponding family of orders."""


def drive_of(table: Table) -> Drive:
    """Return the family of a recording to replay. If the recording has none, the robot remains stationary."""
    for family in _DRIVES:
        if table.has(family):
            return Drive(family, family.replace("target_", "order_"))
    return Drive("", "order_position")


def emulate_robot(config: Config, table: Table) -> Table:
    """Return the table that the emulator of a configured robot reports. Raises ConfigError if the emulator cannot
    replay the recording.
    """
    device = robot_in(config)
    emulation = device.kind.emulation
    if emulation is None or emulation.play is None:
        raise ConfigError(
            f"{device.kind.name}: the emulator does not support replaying a recording (RobotEmulation.play)"
        )
    drive = drive_of(table)
    start = tuple(table.rows("q")[0].tolist()) if drive.order != "order_q" and table.has("q") else ()
    orders = [_NOWHERE] * len(table.times)
    if drive.family:
        orders = [tuple(row) for row in table.rows(drive.family).tolist()]
    course = Trajectory(drive.order, table.times.tolist(), orders, start, table.at_arrival)
    cell = config.cell
    x, y, z = (part / 1e3 for part in cell.start_position_mm)
    home = StartPose((x, y, z), cell.start_quaternion, cell.tool.length_mm / 1e3)
    try:
        robot = emulation.make(device.settings)(home, POWERED_S, config.run.seed)
    except ValueError as error:
        raise ConfigError(f"cell: {error}") from error
    replay = emulation.play(robot, course, device.settings, POWERED_S)
    times = np.array(replay.times)
    inside = (times >= -1e-9) & (times <= course.end + 1e-9)
    columns = {name: np.array(values)[inside] for name, values in replay.columns.items()}
    return Table(times[inside], columns)
