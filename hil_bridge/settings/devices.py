"""Devices of a configuration: kind, link and settings of each device."""

from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, TypeVar

from hil_bridge.devices.kinds import (
    ROBOTS,
    SENSORS,
    KindSettings,
    RobotKind,
    SensorKind,
    robot_of,
    sensor_of,
)
from hil_bridge.settings.configuration import Config
from hil_bridge.settings.kinds import settings_of
from hil_bridge.transports.urls import WireUrl, naming_kind

_Kind = TypeVar("_Kind", RobotKind[Any, Any], SensorKind[Any, Any])


@dataclass(frozen=True, slots=True)
class Device(Generic[_Kind]):
    """Robot or sensor of a configuration."""

    kind: _Kind
    url: str
    """URL of the link, without the kind; empty for the emulated device."""
    settings: KindSettings[Any, Any]

    @property
    def named_url(self) -> str:
        """URL of the link with the kind as a prefix, as in a configuration."""
        return f"{self.kind.name}+{self.url}"

    @property
    def is_emulated(self) -> bool:
        """Whether this program emulates the device. Even if it does not, the URL may lead to an emulator elsewhere."""
        return not self.url

    def wires(self) -> list[WireUrl]:
        """Return the wires that the client opens at the URL. Raises ConfigError for an invalid URL."""
        others: Any = getattr(self.kind, "other_wires", None)
        with naming_kind(self.kind.name):
            wire = self.kind.parse(self.url, self.settings)
            return [wire, *(others(self.url, self.settings) if others else ())]


Robot = Device[RobotKind[Any, Any]]
Sensor = Device[SensorKind[Any, Any]]


def robot_in(config: Config) -> Robot:
    """Return the robot of a configuration. Raises ConfigError."""
    return robot_at(config, config.robot.url)


def robot_at(config: Config, url: str) -> Robot:
    """Return the robot at the given URL with its settings. The URL "" selects the emulated robot. Raises
    ConfigError.
    """
    kind, wire = robot_of(url) if url else (ROBOTS.kind(config.robot.emulated), "")
    return Device(kind, wire, settings_of(config, kind))


def sensor_in(config: Config) -> Sensor:
    """Return the sensor of a configuration. Raises ConfigError."""
    return sensor_at(config, config.sensor.url)


def sensor_at(config: Config, url: str) -> Sensor:
    """Return the sensor at the given URL with its settings. The URL "" selects the emulated sensor. Raises
    ConfigError.
    """
    kind, wire = sensor_of(url) if url else (SENSORS.kind(config.sensor.emulated), "")
    return Device(kind, wire, settings_of(config, kind))


class CellName(NamedTuple):
    """Name of the cell in which a run moves, for display."""

    real: bool
    """Whether a real robot may move."""
    words: str
    """EMULATED or REAL. If only one of the devices is real, the text names the devices."""
    devices: str = ""
    """Kinds of robot and sensor, unless `words` already names them."""


def name_cell(robot: Robot, sensor: Sensor) -> CellName:
    """Return the name of the cell with the given devices."""
    kinds = f"{robot.kind.name}, {sensor.kind.name}"
    if robot.is_emulated and sensor.is_emulated:
        return CellName(False, "EMULATED", kinds)
    if robot.is_emulated:
        return CellName(False, f"EMULATED ROBOT {robot.kind.name}, REAL SENSOR {sensor.kind.name}")
    if sensor.is_emulated:
        return CellName(True, f"REAL ROBOT {robot.kind.name}, EMULATED SENSOR {sensor.kind.name}")
    return CellName(True, "REAL", kinds)
