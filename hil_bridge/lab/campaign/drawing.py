"""Random draws of a run: settings from ranges, and several simultaneous faults, each a pure function of numbers
from 0 to 1.

A campaign derives these numbers from a seed, and a hunt gets them from its optimiser. Both therefore search the
same space.
"""

import json
import math
import random
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any, TypeAlias

import msgspec

from hil_bridge.devices.kinds import EmulatedKinds
from hil_bridge.runs.faults.wrong_controller import CONTROLLER, CONTROLLER_FAULTS
from hil_bridge.settings.faults import FaultConfig

EVERY = "*"
"""Wildcard for all targets, or for all faults of a target, except those that another table of the plan names."""
PARAMETERS = 3
"""Maximum number of parameters of a fault that are drawn; the others keep their defaults. Chosen: as many as the
axes of an offset.
"""
SLOT = 4 + PARAMETERS
"""Number of values from 0 to 1 that one fault consumes: selection, phase, delay, duration, and parameters."""
FACTOR = 10.0
"""Factor by which a parameter without a specified range is drawn above or below its default. Chosen."""
SPREAD: Mapping[str, float] = {"mm": 50.0, "mm/s": 50.0, "N": 50.0}
"""Half range, by unit, of a parameter that the fault requires and whose default is 0: it is drawn within ±SPREAD.
Chosen.
"""
SHORTEST_S, LONGEST_S = 0.05, 3.0
"""Shortest and longest drawn duration, s, of a fault that has a duration but no specified one. Chosen: half of
these faults get a drawn duration; the others keep the default.
"""
DELAY_S = 1.5
"""Longest drawn delay of a fault after the beginning of its phase, s, if no delay is specified. Chosen."""
DRAWN = "drawn"
"""Fault label of a case whose faults are drawn."""

Numbers: TypeAlias = Sequence[float]


class Between(msgspec.Struct, frozen=True):
    """Range of a number, both ends included."""

    low: float
    high: float
    log: bool = False
    """Whether values are drawn on a logarithmic scale; both ends are then positive."""
    whole: bool = False

    def value(self, number: float) -> float | int:
        """Map a number from 0 to 1 to a value in the range."""
        span = self.high - self.low
        drawn = (
            self.low * math.exp(math.log(self.high / self.low) * number)
            if self.log
            else self.low + span * number
        )
        if self.whole:
            return round(drawn)
        return min(max(float(f"{drawn:.6g}"), self.low), self.high)


class Setting(msgspec.Struct, frozen=True):
    """Drawn setting, either from a range or from several sets of values."""

    key: str
    """Dotted key of the setting, or a name for its sets of values."""
    between: Between | None = None
    options: tuple[dict[str, Any], ...] = ()
    """Sets of values to draw from, each by dotted key."""

    def values(self, number: float) -> Mapping[str, Any]:
        """Map a number from 0 to 1 to values by dotted key."""
        if self.between is not None:
            return {self.key: self.between.value(number)}
        chosen: Mapping[str, Any] = _pick(self.options, number)
        return chosen


class Draw(msgspec.Struct, frozen=True):
    """Settings and faults drawn for a run."""

    settings: tuple[Setting, ...] = ()
    faults: tuple[dict[str, Any], ...] = ()
    """Tables of faults as in [[campaign.fault]], with lists of phases, ranges for numbers, and `EVERY` as a name."""
    fewest: int = 1
    most: int = 1
    """Smallest number of faults in a run (`fewest`), and largest number (`most`)."""
    without: dict[str, tuple[tuple[str, int], ...]] = {}
    """Options that each cell does not support, by the label of the cell: key of the setting, and index of the
    option.
    """

    def settings_in(self, cell: str) -> Iterator[Setting]:
        """Yield the settings, with only the options that a cell supports."""
        left_out = self.without.get(cell, ())
        for setting in self.settings:
            places = {place for key, place in left_out if key == setting.key}
            options = tuple(one for place, one in enumerate(setting.options) if place not in places)
            yield Setting(setting.key, setting.between, options) if places else setting

    @property
    def dimensions(self) -> int:
        """Number of values from 0 to 1 that determine a run in a given cell."""
        return len(self.settings) + 1 + self.most * SLOT

    @property
    def text(self) -> str:
        """Draw as JSON, for the results file."""
        return msgspec.json.encode(self, order="sorted").decode()

    @classmethod
    def read(cls, text: str) -> "Draw":
        """Parse a draw from its JSON. Raises msgspec.MsgspecError."""
        return msgspec.json.decode(text, type=cls)


def numbers_of(seed: str, count: int) -> list[float]:
    """Return `count` random numbers from 0 to 1, reproducible from the seed on every computer."""
    draw = random.Random(seed)
    return [draw.random() for _ in range(count)]


def draw_values(
    draw: Draw, cell: str, config: str, numbers: Numbers, overlays: Sequence[Mapping[str, Any]] = ()
) -> str:
    """Return the settings and faults that these numbers select, as JSON that overlays a cell's configuration
    (JSON).

    The faults in `overlays` come first.
    """
    settings: dict[str, Any] = {}
    for setting, number in zip(draw.settings_in(cell), numbers, strict=False):
        settings.update(setting.values(number))
    rest = numbers[len(draw.settings) :]
    count = draw.fewest + min(int(rest[0] * (draw.most - draw.fewest + 1)), draw.most - draw.fewest)
    slots = [rest[1 + place * SLOT : 1 + (place + 1) * SLOT] for place in range(count)]
    faults = [*overlays, *faults_for(draw, config, slots)]
    return json.dumps({"config": settings, "faults": faults}, sort_keys=True)


def faults_for(draw: Draw, config: str, slots: Sequence[Numbers]) -> list[dict[str, Any]]:
    """Return the faults for these slots of numbers. Duplicates, and faults that the cell does not support, are left
    out.
    """
    templates, chosen = faults_of_cell(draw, config), list[dict[str, Any]]()
    if not templates:
        return chosen
    for slot in slots:
        template = _pick(templates, slot[0])
        first = fault_of_slot(template, slot, *_devices(config))
        moment = {key: first.get(key, 0.0) for key in ("phase", "after_s")}
        others = [{**other, **moment} for other in template.get("together", ())]
        for table in (first, *(fault_of_slot(other, slot, *_devices(config)) for other in others)):
            _add(chosen, table, *_devices(config))
    return chosen


def _add(chosen: list[dict[str, Any]], table: dict[str, Any], robot: str, sensor: str, surface: str) -> None:
    """Append a fault unless it is a duplicate or the cell does not support it."""
    same = any((one["on"], one["fault"]) == (table["on"], table["fault"]) for one in chosen)
    if not same and fits(table, robot, sensor, surface):
        chosen.append(table)


def faults_of_cell(draw: Draw, config: str) -> tuple[Mapping[str, Any], ...]:
    """Return the tables of the faults that a cell (JSON) supports, one table for each name."""
    return possible_faults(draw.text, *_devices(config))


def fault_of_slot(
    template: Mapping[str, Any], numbers: Numbers, robot: str, sensor: str, surface: str
) -> dict[str, Any]:
    """Return the table of the fault that a slot of numbers determines, as in [[faults]]."""
    _, of_phase, of_delay, of_time, *of_values = numbers
    phases = template.get("phase", "")
    phase = _pick(phases, of_phase) if isinstance(phases, list) else phases
    table: dict[str, Any] = {"on": template["on"], "fault": template["fault"], "phase": phase}
    if "when" in template:
        table["when"] = template["when"]
    delay = _number(template.get("after_s", {"from": 0.0, "to": DELAY_S}), of_delay)
    if delay:
        table["after_s"] = delay
    words = _fault_names(robot, sensor, surface)[template["on"]][template["fault"]]
    if "for_s" in template:
        table["for_s"] = _number(template["for_s"], of_time)
    elif words.lasts_s is not None and of_time < 0.5:
        table["for_s"] = Between(SHORTEST_S, LONGEST_S, log=True).value(2.0 * of_time)
    parameters = template.get("with", {})
    values: dict[str, Any] = {}
    for (name, parameter), number in zip(words.parameters.items(), of_values, strict=False):
        if name in parameters:
            continue
        value = _around(parameter, name in words.amounts, number)
        if value != parameter.default:
            values[name] = value
    for (name, value), number in zip(parameters.items(), reversed(of_values), strict=False):
        values[name] = _pick(value, number) if isinstance(value, list) else _number(value, number)
    if values:
        table["with"] = values
    return table


@cache
def possible_faults(text: str, robot: str, sensor: str, surface: str) -> tuple[Mapping[str, Any], ...]:
    """Return the tables of the plan's faults that a cell with these devices supports, one table for each name."""
    words = _fault_names(robot, sensor, surface)
    draw = Draw.read(text)
    tables = draw.faults
    named = {(table["on"], table["fault"]) for table in tables}
    chosen = []
    for table in tables:
        for on, fault in _names(table, words):
            by_star = EVERY in (table["on"], table["fault"])
            if by_star and ((on, fault) in named or (table["on"] == EVERY and (on, EVERY) in named)):
                continue
            one = {**table, "on": on, "fault": fault}
            middle = fault_of_slot(one, [0.9] * SLOT, robot, sensor, surface)
            if fits(middle, robot, sensor, surface):
                chosen.append(one)
    return tuple(chosen)


def fits(table: Mapping[str, Any], robot: str, sensor: str, surface: str) -> bool:
    """Return whether a cell with these devices supports this fault."""
    fault = FaultConfig.model_validate(table)
    words = _fault_names(robot, sensor, surface).get(fault.on, {}).get(fault.fault)
    if words is None:
        return False
    try:
        words.values(fault.fault, fault.given)
    except ValueError:
        return False
    return True


def _names(table: Mapping[str, Any], words: Mapping[str, Mapping[str, Any]]) -> Iterator[tuple[str, str]]:
    for on in words if table["on"] == EVERY else [table["on"]]:
        for fault in words.get(on, {}):
            if table["fault"] in (EVERY, fault):
                yield on, fault


@cache
def _fault_names(robot: str, sensor: str, surface: str) -> Mapping[str, Mapping[str, Any]]:
    """Return all faults that a run with these devices supports, by target and name."""
    return {**EmulatedKinds.named(robot, sensor, surface).faults, CONTROLLER: CONTROLLER_FAULTS}


@cache
def _devices(config: str) -> tuple[str, str, str]:
    values = json.loads(config)
    return (
        values["robot"]["emulated"],
        values["sensor"]["emulated"],
        values["cell"].get("surface_kind", ""),
    )


def between_of(value: object) -> Between | None:
    """Return the range of a table `{ from = 0.0, to = 3.0 }`, logarithmic with `log = true`; None for a value
    without a range.

    Raises ValueError for an invalid range.
    """
    if not isinstance(value, dict):
        return None
    extra = set(value) - {"from", "to", "log"}
    low, high, log = value.get("from"), value.get("to"), value.get("log", False)
    if (
        extra
        or type(log) is not bool
        or not (isinstance(low, (int, float)) and isinstance(high, (int, float)))
        or not (math.isfinite(low) and math.isfinite(high) and low < high)
        or (log and low <= 0)
    ):
        raise ValueError("must be a range { from = LOW, to = HIGH }, with log = true for a logarithmic one")
    integral = type(low) is int and type(high) is int
    return Between(float(low), float(high), log, integral)


def _number(value: Any, number: float) -> Any:
    between = between_of(value)
    return value if between is None else between.value(number)


def _around(parameter: Any, needed: bool, number: float) -> Any:
    """Return a value for a fault parameter that has no specified range, around its default."""
    default = parameter.default
    if parameter.choices:
        return _pick(parameter.choices, number)
    if default == 0:
        reach = SPREAD.get(parameter.unit, 0.0) if needed else 0.0
        value: float = Between(-reach, reach).value(number) if reach else default
    else:
        two_sided = parameter.minimum < 0
        share = abs(2.0 * number - 1.0) if two_sided else number
        value = Between(abs(default) / FACTOR, abs(default) * FACTOR, log=True).value(share)
        value = -value if (two_sided and number < 0.5) != (default < 0) else value
    value = min(max(value, parameter.minimum), parameter.maximum)
    return round(value) if isinstance(default, int) else value


def _pick(options: Sequence[Any], number: float) -> Any:
    return options[min(int(number * len(options)), len(options) - 1)]
