"""Sections of a configuration that a kind of device brings along: put together for the kinds that are in use."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
from pydantic import BaseModel, create_model

from hil_bridge.devices.facts import RobotFacts
from hil_bridge.devices.kinds import (
    ROBOTS,
    SENSORS,
    SURFACES,
    CellSection,
    KindSettings,
    Registry,
    RobotKind,
    SensorKind,
    emulated_sensor,
    robot_of,
    sensor_of,
)


@dataclasses.dataclass(frozen=True, slots=True)
class Chosen:
    """Names of the kinds with sections of their own that a configuration speaks of, sorted."""

    robots: tuple[str, ...] = ()
    sensors: tuple[str, ...] = ()
    surfaces: tuple[str, ...] = ()


def chosen_in(values: Mapping[str, Any]) -> Chosen:
    """The kinds with sections of their own that a configuration names: in a URL, as the emulated device, or by a
    section.
    """
    robot, sensor, cell = (_table(values, name) for name in ("robot", "sensor", "cell"))
    return Chosen(
        _named(ROBOTS, robot.get("url"), robot.get("emulated"), *robot, *cell),
        _named(SENSORS, sensor.get("url"), sensor.get("emulated"), *sensor, *cell),
        _named(SURFACES, None, cell.get("surface_kind"), *cell),
    )


def merged_section(base: type[BaseModel], registry: Registry[Any], names: Sequence[str]) -> Any:
    """A section with the settings of the kinds that stand in it directly, and one inside it for each further kind."""
    ours = dict.fromkeys(kind.settings for kind in map(registry.kind, registry.direct))
    more: dict[str, Any] = {}
    for kind in map(registry.kind, names):
        more[field_name(kind.name)] = (kind.settings, kind.settings())
    return create_model(
        base.__name__, __base__=(*ours, base), __doc__=base.__doc__, __module__=base.__module__, **more
    )


def cell_section(chosen: Chosen) -> Any:
    """The section of the emulated cell with the settings of all emulated devices."""
    devices: list[RobotKind | SensorKind] = [
        *map(ROBOTS.kind, ROBOTS.direct),
        *map(SENSORS.kind, SENSORS.direct),
    ]
    others: list[RobotKind | SensorKind] = [
        *map(ROBOTS.kind, chosen.robots),
        *map(SENSORS.kind, chosen.sensors),
    ]
    ours = dict.fromkeys(kind.emulation.settings for kind in devices if kind.emulation is not None)
    more = {field_name(kind.name): kind.emulation.settings for kind in others if kind.emulation is not None}
    more |= {field_name(kind.name): kind.settings for kind in map(SURFACES.kind, chosen.surfaces)}
    fields = [(name, kind, dataclasses.field(default_factory=kind)) for name, kind in more.items()]
    return dataclasses.make_dataclass(
        "CellConfig",
        fields,
        bases=(*reversed(ours), CellSection),
        frozen=True,
        namespace={
            "__module__": CellSection.__module__,
            "__doc__": "The emulated cell, with all its devices.",
        },
    )


def field_name(kind: str) -> str:
    """How the sections of a kind are called."""
    return kind.replace("-", "_")


def settings_of(config: Any, kind: RobotKind | SensorKind) -> KindSettings:
    """The settings of a device, from the configuration that a run has."""
    client = config.robot if isinstance(kind, RobotKind) else config.sensor
    if kind.directly:
        return KindSettings(client, config.cell)
    name = field_name(kind.name)
    emulated = (
        None if kind.emulation is None else getattr(config.cell, name, None) or kind.emulation.settings()
    )
    return KindSettings(getattr(client, name, None) or kind.settings(), emulated)


def robot_kind(config: Any) -> RobotKind:
    """The kind of robot that a run has. Raises ConfigError."""
    return robot_of(config.robot.url)[0] if config.robot.url else ROBOTS.kind(config.robot.emulated)


def sensor_kind(config: Any) -> SensorKind:
    """The kind of sensor that a run has. Raises ConfigError."""
    return sensor_of(config.sensor.url)[0] if config.sensor.url else emulated_sensor(config.sensor.emulated)


def cell_in_words(config: Any) -> tuple[bool, str]:
    """Whether a robot that is not ours may move, and which cell it is; a URL may lead to an emulator elsewhere."""
    robot, sensor = robot_kind(config).name, sensor_kind(config).name
    if not config.robot.url and not config.sensor.url:
        return False, f"EMULATED  {robot}, {sensor}"
    if not config.robot.url:
        return False, f"EMULATED ROBOT {robot}, REAL SENSOR {sensor}"
    if not config.sensor.url:
        return True, f"REAL ROBOT {robot}, EMULATED SENSOR {sensor}"
    return True, f"REAL  {robot}, {sensor}"


def facts_of(config: Any) -> RobotFacts:
    """Facts of a run's robot before a wire is opened. Raises ConfigError for its URL."""
    url = config.robot.url
    kind, wire = robot_of(url) if url else (ROBOTS.kind(config.robot.emulated), "")
    return recorded_facts(config, kind.facts(wire, settings_of(config, kind)))


def recorded_facts(config: Any, facts: RobotFacts) -> RobotFacts:
    """The facts that a robot tells, with the name of its kind and whether it is emulated."""
    return msgspec.structs.replace(facts, kind=robot_kind(config).name, emulated=not config.robot.url)


def _table(values: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    table = values.get(name)
    return table if isinstance(table, Mapping) else {}


def _named(registry: Registry[Any], url: object, *names: object) -> tuple[str, ...]:
    others = [name for name in registry.names if name not in registry.direct]
    if not others:
        return ()
    kind, _ = registry.split(url) if isinstance(url, str) else ("", "")
    spoken = {kind, *(name for name in names if isinstance(name, str))}
    return tuple(sorted(name for name in others if name in spoken or field_name(name) in spoken))
