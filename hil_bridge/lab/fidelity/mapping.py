"""Column mapping of a table: quantity and unit of each column.

separator = ","            # or ";", "tab", "space"; default: the separator that yields the named columns
decimal = "."              # or ","; default: detected from the numbers
header = true              # false: columns are numbered, from 1
[time]
column = "timestamp"       # or rate_hz = 500 if there is no such column
unit = "s"
clock = "device"           # or "arrival" if the computer stamped the samples
[columns]
q = { columns = ["q_1", "q_2", "q_3", "q_4", "q_5", "q_6"], unit = "rad" }
force = { columns = ["c1", "c2", "c3"], unit = "N", factor = 0.01 }    # N per count
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import format_path, format_value, read_toml
from hil_bridge.lab.fidelity.units import COUNTS, FAMILIES, TIME, UNITS, plain_unit

SEPARATORS = {",": ",", ";": ";", "tab": "\t", "space": None}
QUATERNION = ("qx", "qy", "qz", "qw")
"""Components of a rotation that is given as a quaternion."""
_KEYS = {
    "": ("separator", "decimal", "header", "time", "columns"),
    "time": ("column", "unit", "rate_hz", "clock"),
    "columns": ("columns", "unit", "factor", "sign", "file"),
}


class Column(NamedTuple):
    """One mapped column of a file."""

    part: str
    """Name of the quantity, or of the component of a quaternion."""
    name: str | int
    """Name of the column in the file, or its number from 1."""
    units: Mapping[str, float]
    """Allowed units, and the size of each in the base unit."""
    unit: str = ""
    """Unit of the column as in `UNITS`; empty if the header names the unit."""
    factor: float = 1.0
    """Factor that converts the values of the column to its unit."""
    is_scaled: bool = False
    """Whether the mapping gives a factor, which overrides the unit in the header."""


class Entry(NamedTuple):
    """Mapped columns of one family in one file."""

    family: str
    columns: tuple[Column, ...]
    file: Path


class TableMapping(NamedTuple):
    """Parsed mapping file."""

    separator: str
    """Separator as a key of `SEPARATORS`; empty to detect it."""
    decimal: str
    """Decimal separator, `.` or `,`; empty to detect it."""
    header: bool
    time: Column | None
    """Time column; None for evenly spaced samples."""
    rate: float
    at_arrival: bool
    entries: tuple[Entry, ...]

    def columns_in(self, file: Path) -> list[Column]:
        """Return the mapped columns of a file, beginning with the time column."""
        named = [column for entry in self.entries if entry.file == file for column in entry.columns]
        return named if self.time is None else [self.time, *named]


def read_mapping(path: Path, recording: Path) -> TableMapping:
    """Read a mapping file. Raises ConfigError."""
    source = format_path(path)
    values = read_toml(path)
    _check_keys(values, "", source)
    separator, decimal = values.get("separator", ""), values.get("decimal", "")
    for key, value, choices in (
        ("separator", separator, tuple(SEPARATORS)),
        ("decimal", decimal, (".", ",")),
    ):
        if key in values and value not in choices:
            known = ", ".join(choices) if key == "separator" else '"." or ","'
            raise ConfigError(f"{source}: {key} must be one of {known}, got {format_value(value)}")
    header = values.get("header", True)
    if not isinstance(header, bool):
        raise ConfigError(f"{source}: header must be true or false, got {format_value(header)}")
    time, columns = values.get("time"), values.get("columns")
    if not isinstance(time, dict) or not isinstance(columns, dict) or not columns:
        raise ConfigError(f"{source} must have the sections [time] and [columns]")
    column, rate = _time(time, header, source)
    entries = tuple(_entry(name, entry, header, recording, source) for name, entry in columns.items())
    clock = time.get("clock", "device")
    if clock not in ("device", "arrival"):
        raise ConfigError(f"{source}: time.clock must be device or arrival, got {format_value(clock)}")
    return TableMapping(separator, decimal, header, column, rate, clock == "arrival", entries)


def _time(time: Mapping[str, Any], header: bool, source: str) -> tuple[Column | None, float]:
    """Return the time column, or None and the sample rate if there is no time column."""
    _check_keys(time, "time", source)
    column, rate = time.get("column"), time.get("rate_hz")
    if (column is None) == (rate is None):
        raise ConfigError(f"{source}: [time] must have either column or rate_hz")
    unit = _unit(time.get("unit"), TIME, "time", source)
    if column is not None:
        _check_name(column, header, "time.column", source)
        return Column("time", column, TIME, unit), 1.0
    if not isinstance(rate, (int, float)) or isinstance(rate, bool) or not 0.0 < rate < 1e6:
        raise ConfigError(
            f"{source}: time.rate_hz must be greater than 0 and less than 1000000, got {format_value(rate)}"
        )
    return None, float(rate)


def _entry(name: str, value: Any, header: bool, recording: Path, source: str) -> Entry:
    where = f"columns.{name}"
    if name not in FAMILIES:
        raise ConfigError(f"{source}: unknown quantity {format_value(name)}; known: {', '.join(FAMILIES)}")
    if not isinstance(value, dict):
        raise ConfigError(
            f'{source}: {where} must be a table such as {{ columns = ["NAME"], unit = "UNIT" }}'
        )
    _check_keys(value, "columns", source)
    listed, parts = value.get("columns"), FAMILIES[name]
    if name == "rotation" and isinstance(listed, list) and len(listed) == len(QUATERNION):
        parts = _quaternion_parts(listed, source)
    if not isinstance(listed, list) or len(listed) != len(parts):
        count = "one column" if len(parts) == 1 else f"{len(parts)} columns"
        more = ", or the 4 of a quaternion" if name == "rotation" else ""
        raise ConfigError(f'{source}: {where}.columns must name {count}{more}, with "" for a missing one')
    for column in listed:
        if column != "":
            _check_name(column, header, where, source)
    unit = _unit(value.get("unit", "1" if name == "rotation" else None), UNITS[name], where, source)
    if "factor" in value and not unit:
        raise ConfigError(f"{source}: {where}.factor requires {where}.unit, the unit of the scaled values")
    factors = _factors(value, len(parts), where, source)
    file = value.get("file", "")
    if not isinstance(file, str):
        raise ConfigError(f"{source}: {where}.file must be a file name, got {format_value(file)}")
    columns = tuple(
        Column(part, column, UNITS[name], unit, factor, "factor" in value)
        for part, column, factor in zip(parts, listed, factors, strict=True)
        if column != ""
    )
    return Entry(name, columns, recording.parent / file if file else recording)


def _quaternion_parts(listed: Sequence[Any], source: str) -> tuple[str, ...]:
    """Return the quaternion components according to the last letters of the column names, since their order alone
    is ambiguous.
    """
    names = [name if isinstance(name, str) else "" for name in listed]
    parts = tuple(f"q{name[-1:].lower()}" for name in names)
    if sorted(parts) != sorted(QUATERNION) or len({name[:-1] for name in names}) > 1:
        raise ConfigError(
            f"{source}: columns.rotation: quaternion columns must have a common name ending in x, y, z and w, "
            f"such as qx, qy, qz, qw, got {format_value(listed)}; otherwise give the 9 columns of a matrix"
        )
    return parts


def _factors(table: Mapping[str, Any], count: int, where: str, source: str) -> list[float]:
    """Return the signed factor of each column."""
    sign, factor = table.get("sign", 1), table.get("factor", 1.0)
    if sign not in (1, -1) or isinstance(sign, bool):
        raise ConfigError(f"{source}: {where}.sign must be 1 or -1, got {format_value(sign)}")
    factors = factor if isinstance(factor, list) else [factor] * count
    for value in factors:
        if (
            not isinstance(value, (int, float))
            or isinstance(value, bool)
            or not (value and math.isfinite(value))
        ):
            raise ConfigError(
                f"{source}: {where}.factor must be a number other than 0, got {format_value(value)}"
            )
    if len(factors) != count:
        raise ConfigError(f"{source}: {where}.factor must be one number, or {count}, got {len(factors)}")
    return [float(sign * value) for value in factors]


def _unit(unit: Any, units: Mapping[str, float], where: str, source: str) -> str:
    """Return a unit in the spelling of `units`; None becomes an empty text, so that the header determines the unit."""
    if unit is None:
        return ""
    plain = plain_unit(unit) if isinstance(unit, str) else ""
    if plain in COUNTS:
        raise ConfigError(counts_problem(f"{source}: {where}", next(iter(units))))
    if plain not in units:
        raise ConfigError(
            f"{source}: {where}.unit must be one of {', '.join(units)}, got {format_value(unit)}"
        )
    return plain


def counts_problem(what: str, unit: str) -> str:
    """Return the error message for values in counts."""
    return f'{what} is in counts; set unit = "{unit}" and factor = {unit} per count, from the sensor\'s calibration'


def _check_name(column: Any, header: bool, where: str, source: str) -> None:
    number = isinstance(column, int) and not isinstance(column, bool) and 1 <= column <= 10_000
    if not number and not (header and isinstance(column, str)):
        what = "a column name, or its number from 1" if header else "a column number from 1"
        raise ConfigError(f"{source}: {where} must be {what}, got {format_value(column)}")


def _check_keys(values: Mapping[str, Any], section: str, source: str) -> None:
    for key in values:
        if key not in _KEYS[section]:
            known = ", ".join(_KEYS[section])
            raise ConfigError(f"{source}: unknown key {key!r}; known: {known}")
