"""Comparison of a recording by kind: robots replay orders, sensors replay loads, and the contact replays depths."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from msgspec.structs import replace

from hil_bridge.devices.kinds import ROBOTS, SENSORS
from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import format_path
from hil_bridge.lab.fidelity.bags import table_of_bag
from hil_bridge.lab.fidelity.comparing import (
    Comparison,
    Sides,
    compare_robot,
    direct_line,
    followed_line,
    make_comparison,
)
from hil_bridge.lab.fidelity.contact import emulate_contact, laws_of
from hil_bridge.lab.fidelity.emulating import drive_of, emulate_robot
from hil_bridge.lab.fidelity.runs import places_of, wrench_before_contact
from hil_bridge.lab.fidelity.sensing import LOADS, emulate_sensor, with_load
from hil_bridge.lab.fidelity.tables import Table, read_table
from hil_bridge.lab.fidelity.units import WRENCH
from hil_bridge.record import Recording
from hil_bridge.record import read as read_recording
from hil_bridge.record.foreign import BagChoices
from hil_bridge.record.ros.bag_file import is_bag
from hil_bridge.record.ros.bag_reader import read_bag
from hil_bridge.runs.replay import changes_of, recorded_config
from hil_bridge.settings.configuration import Config, load_config
from hil_bridge.settings.overrides import lay_over

STANDSTILL = "inputs: the recording has none, so the emulated robot is stationary"
_TABLES = (".csv", ".tsv", ".txt", ".dat")
"""File suffixes of text tables."""
CONTACT = "contact"
"""Kind name for the surface of an emulated cell, which is not a device."""


class Compared(NamedTuple):
    """Measured and emulated tables, and their comparison."""

    sides: Sides
    comparison: Comparison


class Measured(NamedTuple):
    """Recording to be compared."""

    table: Table
    run: Recording | None = None
    """Recorded run; None for a text table or a bag."""


def read(recording: Path, mapping: Path | None, kind: str, bag: BagChoices | None = None) -> Measured:
    """Read the quantities for a kind from a text table with its mapping, a ROS 2 bag, or a recorded run. Raises
    ConfigError.
    """
    if is_bag(recording):
        if mapping is not None:
            raise ConfigError(f"{format_path(recording)} is a ROS 2 bag; give --topic instead of --columns")
        return Measured(table_of_bag(read_bag(recording, bag)))
    if mapping is not None:
        return Measured(read_table(recording, mapping))
    if recording.suffix.lower() in _TABLES:
        raise ConfigError(f"{format_path(recording)} is a table; give its column mapping with --columns")
    run = read_recording(recording)
    return Measured(wrench_before_contact(run) if kind in SENSORS.names else places_of(run), run)


def compare_with(kind: str, measured: Measured, config_file: Path | None, seed: int | None) -> Compared:
    """Replay a recording to an emulated device of a kind, and compare the outputs.

    Settings of the file override the settings of a recorded run. Raises ConfigError.
    """
    chosen: dict[str, object]
    compare: Callable[[str, Table, Config], Compared]
    if kind in ROBOTS.names:
        chosen, compare = {"robot.emulated": kind, "robot.url": ""}, _robot
    elif kind in SENSORS.names:
        chosen, compare = {"sensor.emulated": kind, "sensor.url": ""}, _sensor
    elif kind == CONTACT:
        chosen, compare = {}, _contact
    else:
        known = ", ".join((*ROBOTS.names, *SENSORS.names, CONTACT))
        raise ConfigError(f"unknown kind {kind!r}; known: {known}")
    measured.table.check()
    chosen["run.seed"] = seed
    if measured.run is None:
        return compare(kind, measured.table, load_config(config_file, chosen))
    changes = changes_of(config_file, None)
    lay_over(changes, chosen)
    return compare(kind, measured.table, recorded_config(measured.run, changes))


def _sides(kind: str, measured: Table, emulated: Table) -> Sides:
    """Return the tables to compare. Raises ConfigError if the recording is too short for two samples of the device."""
    if len(emulated.times) < 2:
        lasts_s = measured.times[-1] - measured.times[0]
        raise ConfigError(
            f"the recording lasts {lasts_s:.3g} s, too short for two samples of the emulated {kind}; "
            "check time.unit"
        )
    return Sides(kind, measured, emulated)


def _robot(kind: str, measured: Table, config: Config) -> Compared:
    sides = _sides(kind, measured, emulate_robot(config, measured))
    comparison = compare_robot(sides)
    if not drive_of(measured).family:
        comparison = replace(comparison, left_out=(*comparison.left_out, STANDSTILL))
    return Compared(sides, comparison)


def _sensor(kind: str, measured: Table, config: Config) -> Compared:
    measured = with_load(measured)
    sides = _sides(kind, measured, emulate_sensor(config, measured))
    pairs = [pair for pair in zip(LOADS, WRENCH, strict=True) if pair[1] in measured.columns]
    return Compared(sides, make_comparison(sides, [followed_line(sides, *pair, free=1) for pair in pairs]))


def _contact(kind: str, measured: Table, config: Config) -> Compared:
    sides = _sides(kind, measured, emulate_contact(config, measured))
    return Compared(sides, make_comparison(sides, [direct_line(sides, "press")], laws_of(*sides.tables)))
