"""The words for a fault: its meaning, its parameters with range, unit and default, and for how long it lasts."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeAlias

from protocol.faults import FaultStage

FaultValue: TypeAlias = float | str

FOREVER = math.inf
"""A fault that lasts until the end of the run, unless `for_s` says otherwise."""
_LONGEST_S = 3600.0
"""Chosen: longer than any run."""
_DURATION = "for_s"


class FaultNews(NamedTuple):
    """Stages of an injected fault, in order."""

    stage: FaultStage
    target: str
    fault: str
    text: str
    """The same in words."""
    values: Mapping[str, FaultValue] = {}
    """Parameters of a fault that begins or happens, defaults included."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number, or one of some words."""

    default: float | str
    """A whole number asks for whole numbers."""
    meaning: str
    minimum: float = 0.0
    maximum: float = 0.0
    unit: str = ""
    choices: tuple[str, ...] = ()

    @property
    def range_text(self) -> str:
        """Allowed values, for people to read."""
        if self.choices:
            return " or ".join(self.choices)
        return f"{self.minimum:g} … {self.maximum:g}{f' {self.unit}' if self.unit else ''}"

    def check(self, given: object) -> FaultValue:
        """Return the value. Raises ValueError."""
        if self.choices:
            if given not in self.choices:
                raise ValueError(f"must be {self.range_text}, got {given!r}")
            return str(given)
        number = _number(given)
        if not self.minimum <= number <= self.maximum:
            raise ValueError(f"must be a number of {self.range_text}, got {given!r}")
        if isinstance(self.default, int):
            if number != int(number):
                raise ValueError(f"must be a whole number, got {given!r}")
            return int(number)
        return number


def _number(given: object) -> float:
    """NaN for anything else. A truth value is not a number here, a text may be one."""
    if isinstance(given, bool) or not isinstance(given, (int, float, str)):
        return math.nan
    try:
        return float(given)
    except (ValueError, OverflowError):
        return math.nan


@dataclass(frozen=True, slots=True)
class Fault:
    """Something that goes wrong."""

    meaning: str
    parameters: Mapping[str, Parameter] = field(default_factory=dict)
    lasts_s: float | None = None
    """Duration unless the injection tells another; None for a fault that strikes now, or at its next opportunities."""
    amounts: tuple[str, ...] = ()
    """Parameters that must not all be 0: it would be no fault."""
    distinct: tuple[str, ...] = ()
    """Parameters that must differ."""

    @property
    def all_parameters(self) -> Mapping[str, Parameter]:
        """Parameters of its own, and the duration of a fault that lasts."""
        if self.lasts_s is None:
            return self.parameters
        until = "how long; otherwise until the end" if self.lasts_s == FOREVER else "how long"
        return {**self.parameters, _DURATION: Parameter(self.lasts_s, until, 0.0, _LONGEST_S, "s")}

    def values(
        self, fault: str, given: Mapping[str, object], target: str = ""
    ) -> tuple[dict[str, FaultValue], float | None]:
        """All parameters, with defaults for those not given, and the duration in s, None where it has none.

        `fault` is its name, and `target` what it strikes, for the error. Raises ValueError in one line.
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
    """Every fault by target, with its meaning and its parameters' meanings, ranges and defaults, as JSON has it."""
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
