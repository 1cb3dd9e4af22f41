"""The parameters that are varied, and their bounds: those that the controller declares, and a person's."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

from hil_bridge.control.controllers import controller_kind
from hil_bridge.control.types import Range
from hil_bridge.errors import ConfigError
from hil_bridge.settings.configuration import Config

Point = tuple[float, ...]
"""Values of the parameters, in their order and their units."""


@dataclasses.dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter that is varied."""

    name: str
    range: Range
    whole: bool
    """It takes whole numbers only."""
    default: float | None
    """Its value without tuning; None where the configuration gives it no number."""

    def coordinate(self, value: float) -> float:
        """The optimiser's number for a value."""
        return math.log(value) if self.range.by_factor and not self.whole else value

    def value(self, coordinate: float) -> float:
        """The value that an optimiser's number stands for, within the bounds."""
        low, high, by_factor = self.range
        value = math.exp(coordinate) if by_factor and not self.whole else coordinate
        if self.whole:
            return float(round(min(max(value, low), high)))
        return min(max(float(f"{value:.6g}"), low), high)


@dataclasses.dataclass(frozen=True, slots=True)
class Space:
    """All that are varied."""

    parameters: tuple[Parameter, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in order."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """Lowest and highest of the optimiser's numbers."""
        return [
            (parameter.coordinate(parameter.range.low), parameter.coordinate(parameter.range.high))
            for parameter in self.parameters
        ]

    def point(self, coordinates: Sequence[float]) -> Point:
        """Values of the parameters for the optimiser's numbers."""
        return tuple(
            parameter.value(float(each)) for parameter, each in zip(self.parameters, coordinates, strict=True)
        )

    def coordinates(self, point: Point) -> list[float]:
        """The optimiser's numbers for values."""
        return [parameter.coordinate(value) for parameter, value in zip(self.parameters, point, strict=True)]

    @property
    def start(self) -> Point | None:
        """The defaults, moved to the nearer bound; None where one has none."""
        found = []
        for parameter in self.parameters:
            if parameter.default is None:
                return None
            found.append(min(max(parameter.default, parameter.range.low), parameter.range.high))
        return tuple(found)

    def table(self, point: Point) -> dict[str, float | int]:
        """The same for `[controller.parameters]`."""
        return {
            parameter.name: int(value) if parameter.whole else value
            for parameter, value in zip(self.parameters, point, strict=True)
        }


def space_of(config: Config, given: Sequence[str]) -> Space:
    """The space of a configuration's controller: `NAME=LOW:HIGH`, with `:log` behind it where factors count, or NAME
    alone for the declared bounds; without any, all that the controller declares.

    Raises ConfigError for a name that it does not have, and where there are no bounds.
    """
    kind: Any = controller_kind(config.controller.name)
    declared = {
        name: found for name, found in getattr(kind, "ranges", {}).items() if isinstance(found, Range)
    }
    asked: Mapping[str, Range] = dict(_read_range(text, declared, kind.name) for text in given) or declared
    if not asked:
        raise ConfigError(
            f"the controller {kind.name} declares no bounds of its parameters: give them, --vary NAME=LOW:HIGH"
        )
    fields = {field.name: field for field in dataclasses.fields(kind) if field.init}
    parameters = []
    for name, bounds in asked.items():
        if name not in fields:
            raise ConfigError(f"{kind.name} has no parameter {name!r}, only {', '.join(fields)}")
        _check(name, bounds)
        value = config.controller.parameters.get(name, fields[name].default)
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        whole = fields[name].type in (int, "int")
        parameters.append(Parameter(name, bounds, whole, float(value) if number else None))
    return Space(tuple(parameters))


def _read_range(text: str, declared: Mapping[str, Range], controller: str) -> tuple[str, Range]:
    name, equals, bounds = text.partition("=")
    if not equals:
        if name not in declared:
            raise ConfigError(
                f"--vary {name}: {controller} declares no bounds of it; write {name}=LOW:HIGH, in its unit"
            )
        return name, declared[name]
    low, *rest = bounds.split(":")
    by_factor = rest[1:] == ["log"]
    try:
        if len(rest) != (2 if by_factor else 1):
            raise ValueError
        return name, Range(float(low), float(rest[0]), by_factor)
    except ValueError:
        raise ConfigError(f"--vary {text}: write NAME=LOW:HIGH or NAME=LOW:HIGH:log, in its unit") from None


def _check(name: str, bounds: Range) -> None:
    low, high, by_factor = bounds
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise ConfigError(f"{name}: the bounds {low:g}:{high:g} are no range; the lower one comes first")
    if by_factor and low <= 0.0:
        raise ConfigError(f"{name}: bounds by factors must be above 0, got {low:g}:{high:g}")
