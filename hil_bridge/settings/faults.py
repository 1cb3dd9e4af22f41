"""Fault in a configuration: target, name, start time, duration and parameters."""

import operator
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from emulators.faults import find
from hil_bridge.control.course.intent import BEFORE_TOUCH, Phase
from hil_bridge.devices.kinds import EmulatedKinds
from hil_bridge.errors import ConfigError
from protocol.marks import SettingError

if TYPE_CHECKING:
    from hil_bridge.record import CycleRecord

PHASES = ("", *BEFORE_TOUCH, *(str(phase) for phase in Phase if phase is not Phase.END))
"""Phases of a run in which a fault can begin. An empty phase stands for the first phase, or for any phase."""
_QUANTITIES: Mapping[str, Callable[["CycleRecord"], float]] = {
    "force": lambda record: record.force,
    "depth_mm": lambda record: record.depth * 1e3,
    "travel_mm": lambda record: record.travel_commanded * 1e3,
    "cycle": lambda record: float(record.cycle),
}
"""Quantities of a cycle for a condition: force, N; depth below the start point, mm; travel along the surface, mm;
number of the cycle.
"""
_COMPARISONS: Mapping[str, Callable[[float, float], bool]] = {"<": operator.lt, ">": operator.gt}
_CONDITION = re.compile(r"\s*([a-z_]{1,20})\s*([<>])\s*([-+]?[0-9]{1,12}(?:\.[0-9]{1,12})?)\s*")


@dataclass(frozen=True, slots=True)
class Condition:
    """Condition that a quantity of a cycle is below or above a number."""

    quantity: str
    comparison: str
    number: float

    @classmethod
    def read(cls, text: str) -> Self:
        """Return the condition parsed from a text such as `force > 8`. Raises SettingError."""
        match = _CONDITION.fullmatch(text)
        if match is None or match[1] not in _QUANTITIES:
            raise SettingError(
                "when",
                f"must be one of {', '.join(_QUANTITIES)}, then < or >, then a number, got {text[:60]!r}",
            )
        return cls(match[1], match[2], float(match[3]))

    def holds(self, record: "CycleRecord") -> bool:
        """Return whether the condition holds in this cycle."""
        return _COMPARISONS[self.comparison](_QUANTITIES[self.quantity](record), self.number)


class FaultConfig(BaseModel):
    """One fault that is injected into the emulated cell."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, populate_by_name=True)

    on: str = ""
    """Target: `hil-bridge list faults` lists them."""
    fault: str = ""
    """Name of the fault at that target."""
    phase: str = Field(default="", json_schema_extra={"enum": [*PHASES]})
    """Phase of the run at whose start it is injected, or in which `when` is checked; empty: the first, or any."""
    after_s: float = Field(default=0.0, ge=0)
    """Delay after that."""
    when: str = ""
    """Condition that triggers it at the end of a cycle, such as "force > 8": force, depth_mm, travel_mm or cycle."""
    for_s: float | None = None
    """Duration, s; by default that of `hil-bridge list faults`. A fault that strikes once has none."""
    parameters: dict[str, Any] = Field(default={}, alias="with")
    """Parameters of the fault that differ from their defaults."""

    @field_validator("phase")
    @classmethod
    def _known_phase(cls, phase: str) -> str:
        if phase not in PHASES:
            raise ValueError(f"must be {', '.join(map(repr, PHASES[:-1]))} or {PHASES[-1]!r}, got {phase!r}")
        return phase

    @property
    def condition(self) -> Condition | None:
        """Condition parsed from `when`; None if there is no condition. Raises SettingError."""
        return Condition.read(self.when) if self.when else None

    @property
    def given(self) -> dict[str, Any]:
        """Parameters and duration."""
        return self.parameters if self.for_s is None else {**self.parameters, "for_s": self.for_s}

    @model_validator(mode="after")
    def _fits(self) -> Self:
        _ = self.condition
        return self

    def check_cell(self, robot_url: str, sensor_url: str, cell: EmulatedKinds) -> None:
        """Raise ValueError if the fault concerns a real device, or if the cell has no such fault."""
        name = f"{self.on}: {self.fault}"
        try:
            find(cell.faults, self.on, self.fault).values(self.fault, self.given, self.on)
        except ValueError as error:
            if other := cell.alternatives_for(self.on, self.fault, self.given):
                known = self.fault in cell.faults.get(self.on, {})
                given = ", ".join(f"{key} = {value}" for key, value in self.given.items()) if known else ""
                rest = "" if known or self.on not in cell.faults else f"; {error}"
                raise ValueError(f"{name}{given and f' with {given}'} needs {other}{rest}") from error
            raise
        if robot_url:
            raise ValueError(f"{name} needs the emulated cell, but robot.url names a real robot")
        if sensor_url and self.on in cell.sensor_targets:
            raise ValueError(f"{name} needs the emulated sensor, but sensor.url names a real one")


def refuse_faults(faults: Sequence[FaultConfig], command: str, instead: str = "") -> None:
    """Raise ConfigError if faults are configured for a command that injects no faults. `instead` names an
    alternative.
    """
    if faults:
        raise ConfigError(
            f"faults.0: {command} has no phases of a run and would ignore the fault; delete [[faults]]"
            f"{instead and f', or {instead}'}"
        )
