"""Search space: the parameters to vary, and their bounds, which the controller declares or the user gives."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

from hil_bridge.control.controllers import controller_kind
from hil_bridge.control.types import Range
from hil_bridge.errors import ConfigError
from hil_bridge.settings.configuration import Config

Point = tuple[float, ...]
"""Values of the parameters, in the order of the space and in their units."""


@dataclasses.dataclass(frozen=True, slots=True)
class Parameter:
    """Parameter to vary."""

    name: str
    range: Range
    whole: bool
    """Whether the parameter takes integers only."""
    default: float | None
    """Value of the parameter without tuning; None if the configuration gives no number."""

    def coordinate(self, value: float) -> float:
        """Map a value to the optimiser's coordinate."""
        return math.log(value) if self.range.by_factor and not self.whole else value

    def value(self, coordinate: float) -> float:
        """Map an optimiser's coordinate to a value within the bounds."""
        low, high, by_factor = self.range
        value = math.exp(coordinate) if by_factor and not self.whole else coordinate
        if self.whole:
            return float(round(min(max(value, low), high)))
        return min(max(float(f"{value:.6g}"), low), high)


@dataclasses.dataclass(frozen=True, slots=True)
class Space:
    """Search space of all parameters to vary."""

    parameters: tuple[Parameter, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of the space."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """Lower and upper bounds of the optimiser's coordinates."""
        return [
            (parameter.coordinate(parameter.range.low), parameter.coordinate(parameter.range.high))
            for parameter in self.parameters
        ]

    def point(self, coordinates: Sequence[float]) -> Point:
        """Map the optimiser's coordinates to values of the parameters."""
        return tuple(
            parameter.value(float(each)) for parameter, each in zip(self.parameters, coordinates, strict=True)
        )

    def coordinates(self, point: Point) -> list[float]:
        """Map values of the parameters to the optimiser's coordinates."""
        return [parameter.coordinate(value) for parameter, value in zip(self.parameters, point, strict=True)]

    @property
    def start(self) -> Point | None:
        """Default values, clipped to the bounds; None if a parameter has no default."""
        values = []
        for parameter in self.parameters:
            if parameter.default is None:
                return None
            values.append(min(max(parameter.default, parameter.range.low), parameter.range.high))
        return tuple(values)

    def table(self, point: Point) -> dict[str, float | int]:
        """Return the values of a point as a table `[controller.parameters]`."""
        return {
            parameter.name: int(value) if parameter.whole else value
            for parameter, value in zip(self.parameters, point, strict=True)
        }


def space_of(config: Config, ranges: Sequence[str]) -> Space:
    """Return the search space for the controller of a configuration.

    Each range is `NAME=LOW:HIGH`, with `:log` appended for a logarithmic scale, or NAME alone for the declared
    bounds. If no ranges are given, the space contains all parameters whose bounds the controller declares. Raises
    ConfigError for an unknown parameter, and for a parameter without bounds.
    """
    kind: Any = controller_kind(config.controller.name)
    declared = {
        name: bounds for name, bounds in getattr(kind, "ranges", {}).items() if isinstance(bounds, Range)
    }
    requested: Mapping[str, Range] = (
        dict(_read_range(text, declared, kind.name) for text in ranges) or declared
    )
    if not requested:
        raise ConfigError(
            f"the controller {kind.name} declares no bounds for its parameters; give some with --vary NAME=LOW:HIGH"
        )
    fields = {field.name: field for field in dataclasses.fields(kind) if field.init}
    parameters = []
    for name, bounds in requested.items():
        if name not in fields:
            raise ConfigError(f"{kind.name} has no parameter {name!r}; known: {', '.join(fields)}")
        _check(name, bounds)
        value = config.controller.parameters.get(name, fields[name].default)
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        is_integer = fields[name].type in (int, "int")
        parameters.append(Parameter(name, bounds, is_integer, float(value) if number else None))
    return Space(tuple(parameters))


def _read_range(text: str, declared: Mapping[str, Range], controller: str) -> tuple[str, Range]:
    name, equals, bounds = text.partition("=")
    if not equals:
        if name not in declared:
            raise ConfigError(
                f"--vary {name}: {controller} declares no bounds for it; give {name}=LOW:HIGH, in its unit"
            )
        return name, declared[name]
    low, *rest = bounds.split(":")
    by_factor = rest[1:] == ["log"]
    try:
        if len(rest) != (2 if by_factor else 1):
            raise ValueError
        return name, Range(float(low), float(rest[0]), by_factor)
    except ValueError:
        raise ConfigError(f"--vary {text}: must be NAME=LOW:HIGH or NAME=LOW:HIGH:log, in its unit") from None


def _check(name: str, bounds: Range) -> None:
    low, high, by_factor = bounds
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise ConfigError(f"{name}: invalid bounds {low:g}:{high:g}; give the lower one first")
    if by_factor and low <= 0.0:
        raise ConfigError(f"{name}: bounds with :log must be greater than 0, got {low:g}:{high:g}")
