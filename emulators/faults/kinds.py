"""Definition of a fault: its meaning, its parameters with range, unit and default, and its duration."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeAlias

from protocol.faults import FaultStage

FaultValue: TypeAlias = float | str

FOREVER = math.inf
"""Duration of a fault that lasts until the end of the run unless `for_s` is set."""
_LONGEST_S = 3600.0
"""Maximum of `for_s`, s. Chosen: longer than any run."""
_DURATION = "for_s"


class FaultNews(NamedTuple):
    """Report that an injected fault has reached a stage."""

    stage: FaultStage
    target: str
    fault: str
    text: str
    """Text of the report."""
    values: Mapping[str, FaultValue] = {}
    """Parameters of a fault that begins or happens, including parameters with default values."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """Parameter of a fault: a number in a range, or one of several choices."""

    default: float | str
    """Default value. If it is an int, only whole numbers are allowed."""
    meaning: str
    minimum: float = 0.0
    maximum: float = 0.0
    unit: str = ""
    choices: tuple[str, ...] = ()

    @property
    def range_text(self) -> str:
        """Allowed values as text."""
        if self.choices:
            return " or ".join(self.choices)
        return f"{self.minimum:g} … {self.maximum:g}{f' {self.unit}' if self.unit else ''}"

    def check(self, value: object) -> FaultValue:
        """Return the value converted to the type of the parameter.

        Raises ValueError for a value that is not allowed.
        """
        if self.choices:
            if value not in self.choices:
                raise ValueError(f"must be {self.range_text}, got {value!r}")
            return str(value)
        number = _number(value)
        if not self.minimum <= number <= self.maximum:
            raise ValueError(f"must be a number of {self.range_text}, got {value!r}")
        if isinstance(self.default, int):
            if number != int(number):
                raise ValueError(f"must be a whole number, got {value!r}")
            return int(number)
        return number


def _number(value: object) -> float:
    """Return a value as a number; NaN if it is not a number.

    Texts are converted, and booleans do not count as numbers.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        return math.nan
    try:
        return float(value)
    except (ValueError, OverflowError):
        return math.nan


@dataclass(frozen=True, slots=True)
class Fault:
    """Definition of a fault of an emulated device."""

    meaning: str
    parameters: Mapping[str, Parameter] = field(default_factory=dict)
    lasts_s: float | None = None
    """Default duration, s; None for a fault that happens at once or at its next opportunities."""
    amounts: tuple[str, ...] = ()
    """Names of parameters that must not all be 0, because the fault would then have no effect."""
    distinct: tuple[str, ...] = ()
    """Names of parameters whose values must differ from each other."""

    @property
    def all_parameters(self) -> Mapping[str, Parameter]:
        """Parameters of the fault, including the duration if the fault has one."""
        if self.lasts_s is None:
            return self.parameters
        meaning = "duration; by default until the end" if self.lasts_s == FOREVER else "duration"
        return {**self.parameters, _DURATION: Parameter(self.lasts_s, meaning, 0.0, _LONGEST_S, "s")}

    def values(
        self, fault: str, given: Mapping[str, object], target: str = ""
    ) -> tuple[dict[str, FaultValue], float | None]:
        """Return all parameters, with defaults for missing ones, and the duration, s.

        The duration is None for a fault that has no duration. `fault` and `target` are names for error messages.
        Raises ValueError, in one line, for invalid parameters.
        """
        name = f"{target}: {fault}" if target else fault
        known = self.all_parameters
        if unknown := [key for key in given if key not in known]:
            raise ValueError(
                f"{name} has no parameter {unknown[0]!r}; known: {', '.join(known)}"
                if known
                else f"{name} has no parameters, got {unknown[0]!r}"
            )
        values: dict[str, FaultValue] = {}
        for key, parameter in known.items():
            try:
                values[key] = parameter.check(given[key]) if key in given else parameter.default
            except ValueError as error:
                raise ValueError(f"{name}: {key} {error}") from None
        if self.amounts and not any(values[key] for key in self.amounts):
            raise ValueError(f"{name}: give {' or '.join(self.amounts)}; all are 0")
        if len({values[key] for key in self.distinct}) < len(self.distinct):
            raise ValueError(f"{name}: {' and '.join(self.distinct)} must differ")
        duration = values.pop(_DURATION, None)
        return values, None if duration is None else float(duration)


def describe_faults(table: Mapping[str, Mapping[str, Fault]]) -> dict[str, Any]:
    """Return every fault by target, for JSON, with its meaning and the meaning, range and default of each parameter."""
    return {
        target: {
            name: {
                "meaning": fault.meaning,
                "parameters": {
                    key: {
                        "meaning": parameter.meaning,
                        "range": parameter.range_text,
                        "unit": parameter.unit,
                        "default": None if parameter.default == FOREVER else parameter.default,
                    }
                    for key, parameter in fault.all_parameters.items()
                },
            }
            for name, fault in faults.items()
        }
        for target, faults in table.items()
    }
