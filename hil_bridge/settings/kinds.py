"""Sections of a configuration for the device kinds that it uses."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from pydantic import BaseModel, create_model

from hil_bridge.devices.kinds import (
    ROBOTS,
    SENSORS,
    SURFACES,
    CellSection,
    DeviceKind,
    KindSettings,
    Registry,
    RobotKind,
    SensorKind,
    SurfaceKind,
    field_name,
    section_of,
)
from hil_bridge.errors import ConfigError

_Client = TypeVar("_Client")
_Emulated = TypeVar("_Emulated")
_Settings = TypeVar("_Settings")

USUAL_ROBOT, USUAL_SENSOR = "s3", "jr3"
"""Default kinds of the emulated devices, for a configuration that names no kinds."""


@dataclasses.dataclass(frozen=True, slots=True)
class Chosen:
    """Names of the kinds in a configuration, sorted."""

    robots: tuple[str, ...] = ()
    sensors: tuple[str, ...] = ()
    surfaces: tuple[str, ...] = ()


def chosen_in(values: Mapping[str, Any]) -> Chosen:
    """Return the kinds that a configuration names in a URL, as emulated device or by a section; the default kinds
    otherwise.
    """
    robot, sensor, cell = (_table(values, name) for name in ("robot", "sensor", "cell"))
    return Chosen(
        _named(ROBOTS, robot.get("url"), _emulated(robot, USUAL_ROBOT), *robot, *cell),
        _named(SENSORS, sensor.get("url"), _emulated(sensor, USUAL_SENSOR), *sensor, *cell),
        _named(SURFACES, None, cell.get("surface_kind"), *cell),
    )


def with_cell_defaults(values: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a configuration with the defaults of the cell that its emulated robot brings, if it names one."""
    robot, cell = _table(values, "robot").get("emulated"), values.get("cell", {})
    emulation = ROBOTS.kind(robot).emulation if isinstance(robot, str) and robot in ROBOTS.names else None
    if emulation is None or not isinstance(cell, Mapping):
        return values
    return {**values, "cell": _laid_under(cell, emulation.cell)}


def _laid_under(values: Mapping[str, Any], defaults: Mapping[str, Any]) -> dict[str, Any]:
    """Return nested tables with a default for each missing value."""
    merged = {**defaults, **values}
    for name, default in defaults.items():
        if isinstance(default, Mapping) and isinstance(own := values.get(name), Mapping):
            merged[name] = _laid_under(own, default)
    return merged


def _emulated(section: Mapping[str, Any], usual: str) -> object:
    return section.get("emulated", None if section.get("url") else usual)


def section_with(base: type[BaseModel], kinds: Sequence[DeviceKind]) -> Any:
    """Return a section with an inner section for each kind. Raises ConfigError if two kinds have the same section."""
    fields: dict[str, Any] = {
        name: (settings, settings()) for name, settings in _inside(kinds, lambda kind: kind.settings).items()
    }
    return create_model(
        base.__name__, __base__=base, __doc__=base.__doc__, __module__=base.__module__, **fields
    )


def cell_with(kinds: Sequence[DeviceKind], surfaces: Sequence[SurfaceKind]) -> Any:
    """Return the section of the emulated cell, with an inner section for each of the given devices and surfaces."""
    inside = _inside(kinds, lambda kind: None if kind.emulation is None else kind.emulation.settings)
    inside |= {section_of(kind): kind.settings for kind in surfaces}
    fields = [
        (name, settings, dataclasses.field(default_factory=settings)) for name, settings in inside.items()
    ]
    return dataclasses.make_dataclass(
        "CellConfig",
        fields,
        bases=(CellSection,),
        frozen=True,
        namespace={
            "__module__": CellSection.__module__,
            "__doc__": "The emulated cell, with all its devices.",
        },
    )


def _inside(kinds: Sequence[DeviceKind], settings: Callable[[DeviceKind], Any]) -> dict[str, Any]:
    """Return the settings by section. Raises ConfigError if two kinds have different settings under the same name."""
    inside: dict[str, Any] = {}
    for kind in kinds:
        own, name = settings(kind), section_of(kind)
        if own is None:
            continue
        if inside.setdefault(name, own) is not own:
            raise ConfigError(
                f"{kind.name} and another kind share the section {name} with different settings"
            )
    return inside


def settings_of(
    config: Any, kind: RobotKind[_Client, _Emulated] | SensorKind[_Client, _Emulated]
) -> KindSettings[_Client, _Emulated]:
    """Return the settings of a device in a configuration, or its defaults if the configuration does not mention it."""
    section, name = (config.robot if isinstance(kind, RobotKind) else config.sensor), section_of(kind)
    emulated: Any = None if kind.emulation is None else _inner(config.cell, name, kind.emulation.settings)
    return KindSettings(_inner(section, name, kind.settings), emulated)


def surface_settings(config: Any, kind: SurfaceKind) -> Any:
    """Return the settings of a plug-in's surface in a configuration."""
    return _inner(config.cell, section_of(kind), kind.settings)


def _inner(section: object, name: str, settings: type[_Settings]) -> _Settings:
    """Return the section of one device inside another section, or its defaults if the configuration has none."""
    inner = getattr(section, name, None)
    return inner if isinstance(inner, settings) else settings()


def _table(values: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    table = values.get(name)
    return table if isinstance(table, Mapping) else {}


def _named(registry: Registry[Any], url: object, *names: object) -> tuple[str, ...]:
    kind, _ = registry.split(url) if isinstance(url, str) else ("", "")
    mentioned = {kind, *(name for name in names if isinstance(name, str))}
    return tuple(
        sorted(name for name in registry.names if name in mentioned or field_name(name) in mentioned)
    )
