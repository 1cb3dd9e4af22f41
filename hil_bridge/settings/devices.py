"""The devices that a configuration chooses: kind, wire and settings of each."""

from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from hil_bridge.devices.kinds import (
    ROBOTS,
    SENSORS,
    EmulatedKinds,
    KindSettings,
    RobotKind,
    SensorKind,
    robot_of,
    sensor_of,
)
from hil_bridge.settings.configuration import Config
from hil_bridge.settings.kinds import settings_of

_Kind = TypeVar("_Kind", RobotKind[Any, Any], SensorKind[Any, Any])


@dataclass(frozen=True, slots=True)
class Device(Generic[_Kind]):
    """A robot or a sensor that a configuration chooses."""

    kind: _Kind
    url: str
    """URL of its wire, without the kind; empty for the emulated device."""
    settings: KindSettings[Any, Any]

    @property
    def is_emulated(self) -> bool:
        """Whether this program emulates it; a URL may lead to an emulator elsewhere."""
        return not self.url


Robot = Device[RobotKind[Any, Any]]
Sensor = Device[SensorKind[Any, Any]]


def robot_in(config: Config, url: str = "") -> Robot:
    """The robot of a configuration, or the one behind this URL with its settings. Raises ConfigError."""
    url = url or config.robot.url
    kind, wire = robot_of(url) if url else (ROBOTS.kind(config.robot.emulated), "")
    return Device(kind, wire, settings_of(config, kind))


def sensor_in(config: Config, url: str = "") -> Sensor:
    """The sensor of a configuration, or the one behind this URL with its settings. Raises ConfigError."""
    url = url or config.sensor.url
    kind, wire = sensor_of(url) if url else (SENSORS.kind(config.sensor.emulated), "")
    return Device(kind, wire, settings_of(config, kind))


def emulated_in(config: Config) -> EmulatedKinds:
    """The kinds of which the emulated cell of a configuration is made. Raises ConfigError."""
    return EmulatedKinds.named(config.robot.emulated, config.sensor.emulated, config.cell.surface_kind)


def cell_in_words(robot: Robot, sensor: Sensor) -> tuple[bool, str]:
    """Whether a robot that is not ours may move, and which cell it is."""
    if robot.is_emulated and sensor.is_emulated:
        return False, f"EMULATED  {robot.kind.name}, {sensor.kind.name}"
    if robot.is_emulated:
        return False, f"EMULATED ROBOT {robot.kind.name}, REAL SENSOR {sensor.kind.name}"
    if sensor.is_emulated:
        return True, f"REAL ROBOT {robot.kind.name}, EMULATED SENSOR {sensor.kind.name}"
    return True, f"REAL  {robot.kind.name}, {sensor.kind.name}"
