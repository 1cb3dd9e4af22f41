"""A measured recording as columns of known quantities, from a table in a file.

A mapping in TOML says which column of a table is which quantity, and in which unit:

    separator = ","            # or "space", "tab", ";"
    header = true              # false: columns have their numbers, from 1
    [time]
    column = "timestamp"       # or rate_hz = 500 where there is no such column
    unit = "s"
    clock = "device"           # or "arrival" where the computer has stamped the samples
    [columns]
    q = { columns = ["q_1", "q_2", "q_3", "q_4", "q_5", "q_6"], unit = "rad" }

Nothing in a file is trusted: the first fault of one is an error of one line.
"""

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hil_bridge.devices.playing import FAMILIES as OF_ROBOTS
from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import format_path, format_value, read_text, read_toml
from hil_bridge.lab.fidelity.measures import LEAST_SAMPLES, Floats
from hil_bridge.record.foreign import LARGEST

ROTATION = tuple(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))
FAMILIES: Mapping[str, tuple[str, ...]] = {
    **OF_ROBOTS,
    "rotation": ROTATION,
    "depth": ("depth",),
    "press": ("press",),
}
"""Quantities by family. Beside those of robots: the rotation of the sensor in the base, row by row; the depth of a tip
below where it is measured from, m; the force that presses it back, N.
"""
WRENCH = (*FAMILIES["force"], *FAMILIES["moment"])
"""Columns of a wrench in their order."""
_ANGLE = {"rad": 1.0, "mrad": 1e-3, "µrad": 1e-6, "urad": 1e-6, "deg": math.pi / 180.0, "°": math.pi / 180.0}
_SPEED = {"rad/s": 1.0, "mrad/s": 1e-3, "deg/s": math.pi / 180.0, "°/s": math.pi / 180.0}
_LENGTH = {"m": 1.0, "mm": 1e-3, "µm": 1e-6, "um": 1e-6}
_FORCE = {"N": 1.0, "mN": 1e-3, "kN": 1e3}
_MOMENT = {"N·m": 1.0, "Nm": 1.0, "N*m": 1.0, "N·mm": 1e-3, "Nmm": 1e-3}
_TIME = {"s": 1.0, "ms": 1e-3, "µs": 1e-6, "us": 1e-6, "ns": 1e-9}
_NUMBER = {"1": 1.0}
UNITS: Mapping[str, Mapping[str, float]] = {
    **dict.fromkeys(("order_q", "target_q", "q"), _ANGLE),
    **dict.fromkeys(("order_qd", "target_qd", "qd"), _SPEED),
    **dict.fromkeys(("order_position", "target_position", "position", "depth"), _LENGTH),
    **dict.fromkeys(("force", "press"), _FORCE),
    "moment": _MOMENT,
    "rotation": _NUMBER,
}
"""Units of each family, and their sizes in its own, which is the first."""
LONGEST_S = 3600.0
"""Chosen: the longest recording that is played. It keeps a wrong unit of time from running for days."""
ROWS_MOST = 2_000_000
"""Chosen: rows of a table at most. An hour at 500 Hz has less."""
_SEPARATORS = {",": ",", ";": ";", "tab": "\t", "space": None}
_KEYS = {
    "": ("separator", "header", "time", "columns"),
    "time": ("column", "unit", "rate_hz", "clock"),
    "columns": ("columns", "unit", "sign", "file"),
}


@dataclass(frozen=True, slots=True)
class Table:
    """Quantities over time."""

    times: Floats
    """(n,), s, ascending from 0."""
    columns: Mapping[str, Floats]
    """(n,) each, in the units of `UNITS`, by the names in `FAMILIES`."""
    at_arrival: bool = False
    """Times are those at which samples came to the computer, and not those of the device's own clock."""

    def family(self, name: str) -> tuple[str, ...]:
        """The columns of a family that are there."""
        return tuple(part for part in FAMILIES[name] if part in self.columns)

    def has(self, name: str) -> bool:
        """Whether all columns of a family are there."""
        return len(self.family(name)) == len(FAMILIES[name])

    def rows(self, name: str) -> Floats:
        """The columns of a whole family, (n, k)."""
        return np.column_stack([self.columns[part] for part in FAMILIES[name]])

    def check(self) -> None:
        """Raise ConfigError for values or a length that no device has."""
        for name, values in self.columns.items():
            if (largest := float(np.abs(values).max())) > LARGEST:
                raise ConfigError(
                    f"{name} comes to {largest:.3g} {unit_of(name)}: is its unit the right one?"
                )
        if (length := float(self.times[-1])) > LONGEST_S:
            raise ConfigError(
                f"the recording lasts {length:.6g} s; at most {LONGEST_S:g} s are played. Is the unit of its time the "
                "right one? --between takes a stretch"
            )

    def between(self, begin: float, end: float) -> "Table":
        """The stretch between two times, s, from 0 again. Raises ConfigError where too little is left."""
        inside = (self.times >= begin) & (self.times <= end)
        if inside.sum() < LEAST_SAMPLES:
            raise ConfigError(
                f"between {begin:g} and {end:g} s there are {inside.sum()} samples; "
                f"at least {LEAST_SAMPLES} are compared"
            )
        times = self.times[inside]
        columns = {name: values[inside] for name, values in self.columns.items()}
        return Table(times - times[0], columns, self.at_arrival)


def unit_of(column: str) -> str:
    """The unit of a quantity; empty for a number without one."""
    family = next(name for name, parts in FAMILIES.items() if column in parts)
    unit = next(iter(UNITS[family]))
    return "" if unit == "1" else unit


class _Entry(NamedTuple):
    """Columns of a family in a file."""

    parts: tuple[tuple[str, str | int], ...]
    """Quantity and the name of its column."""
    factor: float
    file: Path


class _Mapping(NamedTuple):
    separator: str | None
    header: bool
    time: str | int | None
    rate: float
    time_size: float
    at_arrival: bool
    entries: tuple[_Entry, ...]


def read_table(recording: Path, mapping: Path) -> Table:
    """The quantities of a table. Raises ConfigError for a file, a column, a unit or a value that cannot be used."""
    plan = _read_mapping(mapping, recording)
    times, columns = _columns_of(recording, plan)
    for file in dict.fromkeys(entry.file for entry in plan.entries):
        if file == recording:
            continue
        if plan.time is None:
            raise ConfigError(f"{format_path(mapping)}: columns of another file need a time.column")
        others_times, others = _columns_of(file, plan)
        if others_times[-1] < times[0] or times[-1] < others_times[0]:
            raise ConfigError(f"{format_path(file)} and {recording.name} have no time in common")
        columns |= {name: np.interp(times, others_times, values) for name, values in others.items()}
    return Table(times - times[0], columns, plan.at_arrival)


def _columns_of(file: Path, plan: _Mapping) -> tuple[Floats, dict[str, Floats]]:
    """Times and quantities that stand in one file."""
    source = format_path(file)
    names, rows = _read_rows(file, plan)
    places = {
        name: (_place(column, names, source), entry.factor)
        for entry in plan.entries
        if entry.file == file
        for name, column in entry.parts
    }
    if len(rows) < LEAST_SAMPLES:
        raise ConfigError(f"{source} has {len(rows)} rows; at least {LEAST_SAMPLES} are compared")
    first = 2 if plan.header else 1
    if plan.time is None:
        times = np.arange(len(rows)) / plan.rate
    else:
        times = (
            _numbers(rows, _place(plan.time, names, source), str(plan.time), source, first) * plan.time_size
        )
        steps = np.diff(times)
        if (steps <= 0.0).any():
            line = first + 1 + int(np.argmax(steps <= 0.0))
            raise ConfigError(f"{source}: the time does not rise in line {line}")
    return times, {
        name: factor * _numbers(rows, place, name, source, first) for name, (place, factor) in places.items()
    }


def _read_rows(file: Path, plan: _Mapping) -> tuple[list[str], list[list[str]]]:
    text = read_text(file)
    if plan.separator is None:
        rows = [line.split() for line in text.splitlines() if line.strip()]
    else:
        try:
            rows = [row for row in csv.reader(io.StringIO(text), delimiter=plan.separator) if row]
        except csv.Error as error:
            raise ConfigError(f"{format_path(file)} is no table: {error}") from error
    if len(rows) > ROWS_MOST:
        raise ConfigError(f"{format_path(file)} has {len(rows)} rows; at most {ROWS_MOST} are read")
    names = [name.strip() for name in rows[0]] if plan.header and rows else []
    return names, rows[1:] if plan.header else rows


def _place(column: str | int, names: Sequence[str], source: str) -> int:
    if isinstance(column, int):
        return column - 1
    if column not in names:
        near = format_value(", ".join(names[:8])) if names else "no names"
        raise ConfigError(f"{source} has no column {format_value(column)}; its header begins with {near}")
    return names.index(column)


def _numbers(rows: Sequence[Sequence[str]], place: int, name: str, source: str, first: int) -> Floats:
    values = np.empty(len(rows))
    for k, row in enumerate(rows):
        if place >= len(row):
            raise ConfigError(
                f"{source}: line {first + k} has {len(row)} columns, {name} is in column {place + 1}"
            )
        try:
            values[k] = float(row[place])
        except ValueError:
            values[k] = math.nan
        if not math.isfinite(values[k]):
            raise ConfigError(
                f"{source}: {name} in line {first + k} is no number: {format_value(row[place])}"
            )
    return values


# --- the mapping


def _read_mapping(path: Path, recording: Path) -> _Mapping:
    source = format_path(path)
    values = read_toml(path)
    _check_keys(values, "", source)
    separator = values.get("separator", ",")
    if separator not in _SEPARATORS:
        raise ConfigError(
            f"{source}: separator must be one of {', '.join(_SEPARATORS)}, got {format_value(separator)}"
        )
    header = values.get("header", True)
    if not isinstance(header, bool):
        raise ConfigError(f"{source}: header must be true or false, got {format_value(header)}")
    time, columns = values.get("time"), values.get("columns")
    if not isinstance(time, dict) or not isinstance(columns, dict) or not columns:
        raise ConfigError(f"{source} must have the sections [time] and [columns]")
    _check_keys(time, "time", source)
    column, rate = time.get("column"), time.get("rate_hz")
    if (column is None) == (rate is None):
        raise ConfigError(f"{source}: [time] must have either column or rate_hz")
    if rate is not None and (
        not isinstance(rate, (int, float)) or isinstance(rate, bool) or not 0.0 < rate < 1e6
    ):
        raise ConfigError(
            f"{source}: time.rate_hz must be above 0 and below 1000000, got {format_value(rate)}"
        )
    if column is not None:
        _check_name(column, header, "time.column", source)
    size = _size(time.get("unit", "s"), _TIME, "time", source)
    entries = tuple(_entry(name, given, header, recording, source) for name, given in columns.items())
    clock = time.get("clock", "device")
    if clock not in ("device", "arrival"):
        raise ConfigError(f"{source}: time.clock must be device or arrival, got {format_value(clock)}")
    return _Mapping(
        _SEPARATORS[separator], header, column, float(rate or 1.0), size, clock == "arrival", entries
    )


def _entry(name: str, given: Any, header: bool, recording: Path, source: str) -> _Entry:
    if name not in FAMILIES:
        raise ConfigError(
            f"{source}: there is no quantity {format_value(name)}; there are {', '.join(FAMILIES)}"
        )
    if not isinstance(given, dict):
        raise ConfigError(
            f'{source}: columns.{name} must be a table as {{ columns = ["NAME"], unit = "UNIT" }}'
        )
    _check_keys(given, "columns", source)
    listed, parts = given.get("columns"), FAMILIES[name]
    if not isinstance(listed, list) or len(listed) != len(parts):
        count = "one column" if len(parts) == 1 else f"{len(parts)} columns"
        raise ConfigError(f'{source}: columns.{name}.columns must name {count}, "" for one that is missing')
    named = [(part, column) for part, column in zip(parts, listed, strict=True) if column != ""]
    for _, column in named:
        _check_name(column, header, f"columns.{name}", source)
    sign = given.get("sign", 1)
    if sign not in (1, -1) or isinstance(sign, bool):
        raise ConfigError(f"{source}: columns.{name}.sign must be 1 or -1, got {format_value(sign)}")
    unit = given.get("unit", "1" if name == "rotation" else None)
    size = _size(unit, UNITS[name], f"columns.{name}", source)
    file = given.get("file", "")
    if not isinstance(file, str):
        raise ConfigError(f"{source}: columns.{name}.file must be a file's name, got {format_value(file)}")
    return _Entry(tuple(named), sign * size, recording.parent / file if file else recording)


def _size(unit: Any, units: Mapping[str, float], where: str, source: str) -> float:
    if not isinstance(unit, str) or unit not in units:
        raise ConfigError(
            f"{source}: {where}.unit must be one of {', '.join(units)}, got {format_value(unit)}"
        )
    return units[unit]


def _check_name(column: Any, header: bool, where: str, source: str) -> None:
    number = isinstance(column, int) and not isinstance(column, bool) and 1 <= column <= 10_000
    if not number and not (header and isinstance(column, str)):
        what = "a name of the header, or its number from 1" if header else "a number from 1"
        raise ConfigError(f"{source}: {where} must be {what}, got {format_value(column)}")


def _check_keys(values: Mapping[str, Any], section: str, source: str) -> None:
    for key in values:
        if key not in _KEYS[section]:
            known = ", ".join(_KEYS[section])
            raise ConfigError(f"{source}: {key!r} is not known here; there are {known}")
