"""A measured recording as columns of known quantities, from a table in a file and its mapping.

Nothing in a file is trusted: the first fault of one is an error of one line.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import format_path, format_value
from hil_bridge.lab.fidelity.cells import (
    NUMBERS,
    Sheet,
    cells_of,
    decimal_of,
    is_iso,
    place_of,
    read_iso_times,
    read_numbers,
    read_sheet,
)
from hil_bridge.lab.fidelity.mapping import QUATERNION, Column, TableMapping, counts_problem, read_mapping
from hil_bridge.lab.fidelity.measures import LEAST_SAMPLES, Floats
from hil_bridge.lab.fidelity.units import (
    COUNTS,
    FAMILIES,
    ROTATION,
    is_unit,
    plain_unit,
    split_heading,
    unit_of,
)
from hil_bridge.record.foreign import LARGEST

UNIT_ERROR = 0.02
"""Chosen: a quaternion of two decimals is off unit length by less."""
LONGEST_S = 3600.0
"""Chosen: the longest recording that is played. It keeps a wrong unit of time from running for days."""


@dataclass(frozen=True, slots=True)
class Table:
    """Quantities over time."""

    times: Floats
    """(n,), s, ascending from 0."""
    columns: Mapping[str, Floats]
    """(n,) each, in the units of `UNITS`, by the names in `FAMILIES`."""
    at_arrival: bool = False
    """Times are those at which samples came to the computer, and not those of the device's own clock."""
    notes: tuple[str, ...] = ()
    """What was left out of the file, and what its header decided; for people."""

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
        return Table(times - times[0], columns, self.at_arrival, self.notes)


class _Extract(NamedTuple):
    """Wanted columns of one file."""

    times: Floats
    """s."""
    kind: str
    """What its column of times holds."""
    columns: dict[str, Floats]
    notes: list[str]


@np.errstate(over="ignore")  # `Table.check` names the quantity
def read_table(recording: Path, mapping: Path) -> Table:
    """The quantities of a table. Raises ConfigError for a file, a column, a unit or a value that cannot be used."""
    plan = read_mapping(mapping, recording)
    times, kind, columns, notes = _extract(recording, plan)
    for file in dict.fromkeys(entry.file for entry in plan.entries):
        if file == recording:
            continue
        if plan.time is None:
            raise ConfigError(f"{format_path(mapping)}: columns of another file need a time.column")
        other = _extract(file, plan)
        if other.kind != kind:
            raise ConfigError(f"{format_path(file)} has {other.kind}, and {recording.name} {kind}")
        if other.times[-1] < times[0] or times[-1] < other.times[0]:
            raise ConfigError(f"{format_path(file)} and {recording.name} have no time in common")
        columns |= {name: np.interp(times, other.times, values) for name, values in other.columns.items()}
        notes += other.notes
    return Table(times - times[0], columns, plan.at_arrival, tuple(notes))


def _extract(file: Path, plan: TableMapping) -> _Extract:
    """Times and quantities that are in one file. Raises ConfigError."""
    sheet = read_sheet(file, plan)
    notes: list[str] = []
    wanted = plan.columns_in(file)
    places = {column.part: place_of(column.name, sheet) for column in wanted}
    units = _units_line(sheet, [*places.values()])
    sizes = _sizes(wanted, places, units, sheet, notes)
    count = len(sheet.rows)
    cells = {part: cells_of(sheet, place, part) for part, place in places.items()}
    even = np.arange(count) / plan.rate
    full, blank = _full_rows(cells, sheet)
    notes += filter(None, [blank])
    if len(full) < LEAST_SAMPLES:
        left = f"; {blank}" if blank else ""
        raise ConfigError(f"{sheet.source} has {count} rows; at least {LEAST_SAMPLES} are compared{left}")
    sheet = sheet._replace(rows=[], lines=[sheet.lines[k] for k in full])
    cells = {part: [column[k] for k in full] for part, column in cells.items()}
    times, kind = even[full], NUMBERS
    dated = plan.time is not None and is_iso(cells["time"][0])
    numeric = {part: column for part, column in cells.items() if not (dated and part == "time")}
    decimal = plan.decimal or decimal_of(numeric, sheet)
    values = {
        part: read_numbers(column, decimal, part, sheet) * sizes[part] for part, column in numeric.items()
    }
    if plan.time is not None:
        if dated:
            if sizes.pop("time", 1.0) != 1.0:
                raise ConfigError(f"{sheet.source}: its times are dates of ISO 8601; leave time.unit out")
            times, kind = read_iso_times(cells["time"], sheet)
        else:
            times = values.pop("time")
        kept = _rising(times, sheet, notes)
        times, values = times[kept], {part: column[kept] for part, column in values.items()}
        sheet = sheet._replace(lines=[sheet.lines[k] for k in kept])
    return _Extract(times, kind, _with_rotation(values, sheet), notes)


def _sizes(
    wanted: Sequence[Column], places: Mapping[str, int], units: Sequence[str], sheet: Sheet, notes: list[str]
) -> dict[str, float]:
    """Factor of each column to the unit of its family. Raises ConfigError where mapping and header differ."""
    sizes: dict[str, float] = {}
    by_header: dict[str, list[str]] = {}
    for column in wanted:
        place = places[column.part]
        heading = sheet.names[place] if place < len(sheet.names) else ""
        _, named, is_sure = split_heading(heading)
        if units:
            named, is_sure = units[place], True
        unit = column.unit or named
        if column.part == "time" and not unit:
            unit = "s"
        if unit in COUNTS:
            raise ConfigError(counts_problem(f"{sheet.source}: {column.part}", next(iter(column.units))))
        if unit not in column.units:
            raise ConfigError(
                f"{sheet.source}: the header names no unit of {column.part} that is known here, got "
                f"{format_value(heading)}; give unit in the mapping, one of {', '.join(column.units)}"
            )
        is_other = column.units.get(named) != column.units[unit] and (is_sure or named in column.units)
        if named and is_other and not column.is_scaled and isinstance(column.name, str):
            raise ConfigError(
                f"{sheet.source}: {column.part} is in {named} by its header and in {unit} by the mapping; correct the "
                "mapping, or give the column's number where the header is wrong"
            )
        if not column.unit and named:
            by_header.setdefault(unit, []).append(column.part)
        sizes[column.part] = column.units[unit] * column.factor
    told = ", ".join(f"{' '.join(parts)} in {unit}" for unit, parts in by_header.items())
    notes += [f"{sheet.source}: by its header {told}"] if told else []
    return sizes


def _units_line(sheet: Sheet, places: Sequence[int]) -> list[str]:
    """The units in a line below the names, which is taken out; empty where there is none."""
    if not sheet.names or not sheet.rows:
        return []
    units = [plain_unit(cell.strip("[]() ")) for cell in sheet.rows[0]]
    given = [units[place] for place in places if place < len(units)]
    if not any(map(is_unit, given)) or not all(unit in ("", "1", "·") or is_unit(unit) for unit in given):
        return []
    del sheet.rows[0], sheet.lines[0]
    return [unit if is_unit(unit) else "" for unit in (*units, *[""] * len(sheet.names))]


def _full_rows(cells: Mapping[str, Sequence[str]], sheet: Sheet) -> tuple[list[int], str]:
    """Rows without a blank cell, and a note on those that are left out; a blank cell is no zero."""
    blank = {part: [k for k, cell in enumerate(column) if not cell] for part, column in cells.items()}
    out = {k for rows in blank.values() for k in rows}
    if not out:
        return [*range(len(sheet.rows))], ""
    counts = ", ".join(f"{part} in {len(rows)}" for part, rows in blank.items() if rows)
    note = (
        f"{sheet.source}: {len(out)} of {len(sheet.rows)} rows left out for blank cells, the first in line "
        f"{sheet.lines[min(out)]}: {counts}"
    )
    return [k for k in range(len(sheet.rows)) if k not in out], note


def _rising(times: Floats, sheet: Sheet, notes: list[str]) -> list[int]:
    """Rows whose time is later than that of the row before. Raises ConfigError for one that is earlier."""
    steps = np.diff(times)
    if (steps < 0.0).any():
        line = sheet.lines[1 + int(np.argmax(steps < 0.0))]
        raise ConfigError(f"{sheet.source}: the time does not rise in line {line}; sort the rows by time")
    same = 1 + np.flatnonzero(steps == 0.0)
    if not len(same):
        return [*range(len(times))]
    if len(times) - len(same) < LEAST_SAMPLES:
        raise ConfigError(
            f"{sheet.source} has {len(times) - len(same)} different times in {len(times)} rows; at least "
            f"{LEAST_SAMPLES} are compared. Is the clock too coarse? time.rate_hz counts the rows"
        )
    notes.append(
        f"{sheet.source}: {len(same)} of {len(times)} rows left out for a time that the row before has, the first in "
        f"line {sheet.lines[same[0]]}: of equal times the first row counts"
    )
    return [k for k in range(len(times)) if k == 0 or steps[k - 1] > 0.0]


def _with_rotation(values: dict[str, Floats], sheet: Sheet) -> dict[str, Floats]:
    """The same with a matrix in the place of a quaternion. Raises ConfigError for one that is no rotation."""
    if not set(QUATERNION) <= set(values):
        return values
    quaternions = np.column_stack([values.pop(part) for part in QUATERNION])
    wrong = np.abs(np.linalg.norm(quaternions, axis=1) - 1.0) > UNIT_ERROR
    if wrong.any():
        line = sheet.lines[int(np.argmax(wrong))]
        raise ConfigError(
            f"{sheet.source}: the quaternion in line {line} is no rotation: its length is not 1 within {UNIT_ERROR:g}"
        )
    rows = Rotation.from_quat(quaternions).as_matrix().reshape(-1, len(ROTATION))
    return values | {name: rows[:, k] for k, name in enumerate(ROTATION)}
