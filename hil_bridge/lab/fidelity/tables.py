"""Measured recording as columns of known quantities, from a text table and its column mapping.

Nothing in a file is trusted: the first problem raises an error of one line.
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
"""Largest deviation of a quaternion's length from 1. Chosen: quaternions with two decimals deviate less."""
LONGEST_S = 3600.0
"""Longest recording that is replayed, s. Chosen: a wrong time unit cannot make a replay run for days."""


@dataclass(frozen=True, slots=True)
class Table:
    """Columns of known quantities over time."""

    times: Floats
    """Times (n,), s, ascending from 0."""
    columns: Mapping[str, Floats]
    """Values (n,) of each quantity, by a name in `FAMILIES`, in the base unit of `UNITS`."""
    at_arrival: bool = False
    """Whether the times are arrival times at the computer, not times of the device clock."""
    notes: tuple[str, ...] = ()
    """Notes for the user: which rows were skipped, and what the header determined."""

    def family(self, name: str) -> tuple[str, ...]:
        """Return the columns of a family that are present."""
        return tuple(part for part in FAMILIES[name] if part in self.columns)

    def has(self, name: str) -> bool:
        """Return whether all columns of a family are present."""
        return len(self.family(name)) == len(FAMILIES[name])

    def rows(self, name: str) -> Floats:
        """Return all columns of a family, (n, k)."""
        return np.column_stack([self.columns[part] for part in FAMILIES[name]])

    def check(self) -> None:
        """Check the values and the duration. Raises ConfigError if they are implausible."""
        for name, values in self.columns.items():
            if (largest := float(np.abs(values).max())) > LARGEST:
                raise ConfigError(f"{name} reaches {largest:.3g} {unit_of(name)}; check its unit")
        if (length := float(self.times[-1])) > LONGEST_S:
            raise ConfigError(
                f"the recording lasts {length:.6g} s; at most {LONGEST_S:g} s are replayed. Check its time unit, or "
                "select an interval with --between"
            )

    def between(self, begin: float, end: float) -> "Table":
        """Return the part between two times, s, with times that start at 0. Raises ConfigError if it has too few
        samples.
        """
        inside = (self.times >= begin) & (self.times <= end)
        if inside.sum() < LEAST_SAMPLES:
            raise ConfigError(
                f"between {begin:g} and {end:g} s there are {inside.sum()} samples; "
                f"at least {LEAST_SAMPLES} are required"
            )
        times = self.times[inside]
        columns = {name: values[inside] for name, values in self.columns.items()}
        return Table(times - times[0], columns, self.at_arrival, self.notes)


class _Extract(NamedTuple):
    """Mapped columns of one file."""

    times: Floats
    """Times of the rows, s."""
    kind: str
    """Kind of the time column."""
    columns: dict[str, Floats]
    notes: list[str]


@np.errstate(over="ignore")  # `Table.check` names the quantity
def read_table(recording: Path, mapping: Path) -> Table:
    """Read the quantities of a table. Raises ConfigError for an invalid file, column, unit or value."""
    plan = read_mapping(mapping, recording)
    times, kind, columns, notes = _extract(recording, plan)
    for file in dict.fromkeys(entry.file for entry in plan.entries):
        if file == recording:
            continue
        if plan.time is None:
            raise ConfigError(f"{format_path(mapping)}: columns of another file require time.column")
        other = _extract(file, plan)
        if other.kind != kind:
            raise ConfigError(f"{format_path(file)} has {other.kind}, and {recording.name} {kind}")
        if other.times[-1] < times[0] or times[-1] < other.times[0]:
            raise ConfigError(f"{format_path(file)} and {recording.name} have no time in common")
        columns |= {name: np.interp(times, other.times, values) for name, values in other.columns.items()}
        notes += other.notes
    return Table(times - times[0], columns, plan.at_arrival, tuple(notes))


def _extract(file: Path, plan: TableMapping) -> _Extract:
    """Read the times and quantities of one file. Raises ConfigError."""
    sheet = read_sheet(file, plan)
    notes: list[str] = []
    mapped = plan.columns_in(file)
    places = {column.part: place_of(column.name, sheet) for column in mapped}
    units = _units_line(sheet, [*places.values()])
    sizes = _sizes(mapped, places, units, sheet, notes)
    count = len(sheet.rows)
    cells = {part: cells_of(sheet, place, part) for part, place in places.items()}
    even = np.arange(count) / plan.rate
    full, blank = _full_rows(cells, sheet)
    notes += filter(None, [blank])
    if len(full) < LEAST_SAMPLES:
        left = f"; {blank}" if blank else ""
        raise ConfigError(f"{sheet.source} has {count} rows; at least {LEAST_SAMPLES} are required{left}")
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
                raise ConfigError(f"{sheet.source}: its times are ISO 8601 dates; remove time.unit")
            times, kind = read_iso_times(cells["time"], sheet)
        else:
            times = values.pop("time")
        kept = _select_ascending(times, sheet, notes)
        times, values = times[kept], {part: column[kept] for part, column in values.items()}
        sheet = sheet._replace(lines=[sheet.lines[k] for k in kept])
    return _Extract(times, kind, _with_rotation(values, sheet), notes)


def _sizes(
    mapped: Sequence[Column], places: Mapping[str, int], units: Sequence[str], sheet: Sheet, notes: list[str]
) -> dict[str, float]:
    """Return the factor that converts each column to the base unit of its family. Raises ConfigError if mapping and
    header contradict each other.
    """
    sizes: dict[str, float] = {}
    by_header: dict[str, list[str]] = {}
    for column in mapped:
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
                f"{sheet.source}: the header names no known unit of {column.part}, got "
                f"{format_value(heading)}; set unit in the mapping, one of {', '.join(column.units)}"
            )
        is_other = column.units.get(named) != column.units[unit] and (is_sure or named in column.units)
        if named and is_other and not column.is_scaled and isinstance(column.name, str):
            raise ConfigError(
                f"{sheet.source}: {column.part} is in {named} by its header and in {unit} by the mapping; correct the "
                "mapping, or give the column's number if the header is wrong"
            )
        if not column.unit and named:
            by_header.setdefault(unit, []).append(column.part)
        sizes[column.part] = column.units[unit] * column.factor
    units_text = ", ".join(f"{' '.join(parts)} in {unit}" for unit, parts in by_header.items())
    notes += [f"{sheet.source}: by its header {units_text}"] if units_text else []
    return sizes


def _units_line(sheet: Sheet, places: Sequence[int]) -> list[str]:
    """Remove a line of units below the column names and return the units; empty if there is no such line."""
    if not sheet.names or not sheet.rows:
        return []
    units = [plain_unit(cell.strip("[]() ")) for cell in sheet.rows[0]]
    named = [units[place] for place in places if place < len(units)]
    if not any(map(is_unit, named)) or not all(unit in ("", "1", "·") or is_unit(unit) for unit in named):
        return []
    del sheet.rows[0], sheet.lines[0]
    return [unit if is_unit(unit) else "" for unit in (*units, *[""] * len(sheet.names))]


def _full_rows(cells: Mapping[str, Sequence[str]], sheet: Sheet) -> tuple[list[int], str]:
    """Return the rows without blank cells, and a note on the skipped rows. A blank cell does not count as zero."""
    blank = {part: [k for k, cell in enumerate(column) if not cell] for part, column in cells.items()}
    out = {k for rows in blank.values() for k in rows}
    if not out:
        return [*range(len(sheet.rows))], ""
    counts = ", ".join(f"{part} in {len(rows)}" for part, rows in blank.items() if rows)
    note = (
        f"{sheet.source}: {len(out)} of {len(sheet.rows)} rows skipped for blank cells, the first in line "
        f"{sheet.lines[min(out)]}: {counts}"
    )
    return [k for k in range(len(sheet.rows)) if k not in out], note


def _select_ascending(times: Floats, sheet: Sheet, notes: list[str]) -> list[int]:
    """Return the rows whose time is later than the time of the previous row. Raises ConfigError if the time
    decreases.
    """
    steps = np.diff(times)
    if (steps < 0.0).any():
        line = sheet.lines[1 + int(np.argmax(steps < 0.0))]
        raise ConfigError(f"{sheet.source}: the time decreases in line {line}; sort the rows by time")
    same = 1 + np.flatnonzero(steps == 0.0)
    if not len(same):
        return [*range(len(times))]
    if len(times) - len(same) < LEAST_SAMPLES:
        raise ConfigError(
            f"{sheet.source} has {len(times) - len(same)} different times in {len(times)} rows; at least "
            f"{LEAST_SAMPLES} are required. If the clock is too coarse, use time.rate_hz"
        )
    notes.append(
        f"{sheet.source}: {len(same)} of {len(times)} rows skipped for the same time as the previous row, the first in "
        f"line {sheet.lines[same[0]]}"
    )
    return [k for k in range(len(times)) if k == 0 or steps[k - 1] > 0.0]


def _with_rotation(values: dict[str, Floats], sheet: Sheet) -> dict[str, Floats]:
    """Replace a quaternion by a rotation matrix. Raises ConfigError for an invalid quaternion."""
    if not set(QUATERNION) <= set(values):
        return values
    quaternions = np.column_stack([values.pop(part) for part in QUATERNION])
    wrong = np.abs(np.linalg.norm(quaternions, axis=1) - 1.0) > UNIT_ERROR
    if wrong.any():
        line = sheet.lines[int(np.argmax(wrong))]
        raise ConfigError(
            f"{sheet.source}: the quaternion in line {line} is invalid: its length is not 1 within {UNIT_ERROR:g}"
        )
    rows = Rotation.from_quat(quaternions).as_matrix().reshape(-1, len(ROTATION))
    return values | {name: rows[:, k] for k, name in enumerate(ROTATION)}
