"""Identification of values from a recorded run or a table, including those that need an emulated robot to replay
the orders.
"""

import copy
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import ValidationError

from hil_bridge.errors import ConfigError
from hil_bridge.lab.fidelity.emulating import emulate_robot
from hil_bridge.lab.fidelity.tables import Table, read_table
from hil_bridge.lab.identification.line import line_values
from hil_bridge.lab.identification.motion import motion_values
from hil_bridge.lab.identification.observations import Observations, observe_run, observe_table
from hil_bridge.lab.identification.stream import stream_values
from hil_bridge.lab.identification.surface import surface_values
from hil_bridge.lab.identification.values import Values
from hil_bridge.record import Recording
from hil_bridge.record.device_facts import devices_of, recorded_configuration
from hil_bridge.runs.zeroing import wrist
from hil_bridge.settings.configuration import Config, explain, load_config, read_config
from hil_bridge.settings.devices import robot_in

_HIDDEN = ("cell", "faults")
"""Sections of a recorded configuration that only an emulated cell has, and that contain its true parameters."""


class Identified(NamedTuple):
    """Identified values of a recording, with the data that were used."""

    values: Values
    seen: Observations
    config: Config
    """Configuration with the settings of the client, and with emulated devices of its kinds at their defaults."""
    run: Recording | None


def identify_run(run: Recording) -> Identified:
    """Identify the values of a recorded run. Raises ConfigError for an unusable recording."""
    config = client_config(run)
    robot = config.robot
    pace = robot.velocity_mm_s * 1e-3, robot.acceleration_mm_s2 * 1e-3
    return _identified(observe_run(run, wrist(config).alignment(), pace), config, run)


def identify_table(
    recording: Path, mapping: Path, config_file: Path | None, between: tuple[float, float] | None
) -> tuple[Identified, tuple[str, ...]]:
    """Identify the values of a table with its mapping; also return the notes on its file.

    The configuration contains the settings of the cell. Raises ConfigError.
    """
    table = read_table(recording, mapping)
    if between is not None:
        table = table.between(*between)
    table.check()
    return _identified(observe_table(table), load_config(config_file, {}), None), table.notes


def client_config(run: Recording) -> Config:
    """Return the client configuration of a recorded run, without the emulated cell and its faults.

    The devices are emulated devices of the recorded kinds. Raises ConfigError if this version does not support one
    of the kinds.
    """
    recorded: dict[str, Any] = copy.deepcopy(dict(recorded_configuration(run)))
    if not recorded:
        raise ConfigError(
            "the recording contains no configuration and cannot be identified; give another recording"
        )
    for section in _HIDDEN:
        recorded.pop(section, None)
    facts = devices_of(run)
    for name, kind in (("robot", facts.robot.kind), ("sensor", facts.sensor.kind)):
        section = recorded.setdefault(name, {})
        if isinstance(section, dict):
            section["url"] = ""
            if kind:
                section["emulated"] = kind
    try:
        return read_config(recorded)
    except ValidationError as error:
        raise explain(error, None, set()) from error


def _identified(observations: Observations, config: Config, run: Recording | None) -> Identified:
    device = robot_in(config)

    def twin(table: Table) -> Table | None:
        playable = device.kind.emulation is not None and device.kind.emulation.play is not None
        return emulate_robot(config, table) if playable else None

    usual = device.kind.facts("", device.settings).servo
    parts = (
        motion_values(observations, usual, twin),
        stream_values(observations),
        surface_values(observations),
        line_values(observations),
    )
    return Identified(Values(chain.from_iterable(parts)), observations, config, run)
