"""Parsing of a text table: the positions of its columns, and the numbers and times in its cells.

Ambiguous content is rejected with its line number.
"""

import csv
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hil_bridge.errors import ConfigError
from hil_bridge.errors.file_kinds import refuse_known
from hil_bridge.errors.text_files import format_path, format_value, read_text
from hil_bridge.lab.fidelity.mapping import SEPARATORS, TableMapping
from hil_bridge.lab.fidelity.measures import Floats
from hil_bridge.lab.fidelity.units import split_heading

ROWS_MOST = 2_000_000
"""Maximum number of rows in a table. Chosen: more than an hour at 500 Hz."""
HEADER_LINES = 1000
"""Number of lines that are searched for the column names. Chosen: headers of test benches have some hundred lines."""
_COMMENT = "#%"
_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")
"""Pattern of a number whose comma may be a thousands separator or a decimal separator."""
_ISO = re.compile(r"\d{4}-?\d\d-?\d\d[T ]\d")
NUMBERS, LOCAL, ZONED = "numbers", "times without a zone", "times with a zone"
"""Kinds of time columns: numbers, times without a time zone, and times with a time zone."""


class Sheet(NamedTuple):
    """Cells of a text table."""

    source: str
    names: list[str]
    """Column names; empty if columns are numbered."""
    rows: list[list[str]]
    lines: list[int]
    """Line number of each row, from 1."""

    def where(self, row: int) -> str:
        """Return the location of a row, for a message."""
        return f"{self.source}: line {self.lines[row]}"


def read_sheet(file: Path, mapping: TableMapping) -> Sheet:
    """Read the cells of a file below its header line. Raises ConfigError."""
    source = format_path(file)
    lines = read_text(file).split("\n")
    names: list[str] = []
    separator = mapping.separator or ","
    first = next((k for k, line in enumerate(lines) if line.strip() and line.lstrip()[0] not in _COMMENT), 0)
    if mapping.header:
        required = [column.name for column in mapping.columns_in(file) if isinstance(column.name, str)]
        first, separator, names = _header(lines, first, required, mapping.separator, source)
        first += 1
    sheet = Sheet(source, names, [], [])
    try:
        for line, row in _split(lines[first:], separator):
            if len(sheet.rows) == ROWS_MOST:
                raise ConfigError(f"{source} has more than the maximum of {ROWS_MOST} rows")
            sheet.rows.append(row)
            sheet.lines.append(first + line)
    except csv.Error as error:
        line = sheet.lines[-1] + 1 if sheet.lines else first + 1
        raise ConfigError(f"{source}: line {line}: not a table: {error}") from error
    _check_widths(sheet, separator)
    return sheet


def _split(lines: Sequence[str], separator: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the line number, from 1, and the cells of each line that is not blank. Raises csv.Error."""
    sign = SEPARATORS[separator]
    if sign is None:
        yield from ((k, line.split()) for k, line in enumerate(lines, 1) if line.strip())
        return
    reader = csv.reader(lines, delimiter=sign)
    before = 0
    for row in reader:
        if reader.line_num - before > 1:
            raise csv.Error(f"unclosed quote, spanning {reader.line_num - before} lines")
        before = reader.line_num
        if len(row) > 1 or "".join(row).strip():
            yield reader.line_num, [cell.strip() for cell in row]


def _header(
    lines: Sequence[str], first: int, required: Sequence[str], separator: str, source: str
) -> tuple[int, str, list[str]]:
    """Find the line that names all required columns; return its index, separator and names. Raises ConfigError."""
    separators = [separator] if separator else list(SEPARATORS) if required else [","]
    nearest = (-1, next(iter(required), ""), [""])
    for k, line in enumerate(
        lines[:HEADER_LINES] if required else lines[first : first + 1], 0 if required else first
    ):
        for text in dict.fromkeys((line, line.lstrip(f"{_COMMENT} "))):
            for one in separators:
                try:
                    names = next(_split([text], one), (0, [""]))[1]
                except csv.Error:
                    continue
                missing = [name for name in required if not _column_indices(name, names)]
                if not missing:
                    return k, one, names
                count = len(required) - len(missing)
                if count > nearest[0] and (count or k >= first):
                    nearest = (count, missing[0], names)
    refuse_known(source, "\n".join(lines[:HEADER_LINES]).encode())
    near = format_value(", ".join(nearest[2][:8]))
    raise ConfigError(f"{source} has no column {format_value(nearest[1])}; its header begins with {near}")


def _column_indices(name: str, names: Sequence[str]) -> list[int]:
    """Return the indices of the columns that have this name, with or without a unit suffix."""
    exact = [k for k, one in enumerate(names) if one == name]
    return exact or [k for k, one in enumerate(names) if split_heading(one)[0] == name]


def place_of(name: str | int, sheet: Sheet) -> int:
    """Return the index of a column, from 0. Raises ConfigError for an ambiguous name."""
    if isinstance(name, int):
        return name - 1
    places = _column_indices(name, sheet.names)
    if len(places) > 1:
        numbers = " and ".join(str(place + 1) for place in places[:2])
        raise ConfigError(
            f"{sheet.source}: columns {numbers} are both named {format_value(name)}; give the column's number instead"
        )
    return places[0]


def _check_widths(sheet: Sheet, separator: str) -> None:
    """Check that no row has another width than the header or the first row, since its cells may be shifted. Raises
    ConfigError.
    """
    width = len(sheet.names or (sheet.rows or [[]])[0])
    for k, row in enumerate(sheet.rows):
        if (len(row) > width and any(row[width:])) or (separator == "space" and len(row) < width):
            raise ConfigError(
                f"{sheet.where(k)} has {len(row)} cells, and the {'header' if sheet.names else 'first row'} {width}; "
                "check whether the separator occurs in names or as a decimal comma"
            )


def cells_of(sheet: Sheet, place: int, name: str) -> list[str]:
    """Return the cells of a column. Raises ConfigError for a row that is too short."""
    for k, row in enumerate(sheet.rows):
        if place >= len(row):
            raise ConfigError(f"{sheet.where(k)} has {len(row)} columns, {name} is in column {place + 1}")
    return [row[place] for row in sheet.rows]


def decimal_of(columns: Mapping[str, Sequence[str]], sheet: Sheet) -> str:
    """Return the decimal separator of these cells. Raises ConfigError if it is ambiguous."""
    comma = point = ""
    is_decimal = False
    for name, cells in columns.items():
        for k, cell in enumerate(cells):
            if "," in cell:
                comma = comma or f"{sheet.where(k)}: {name}: {format_value(cell)}"
                is_decimal |= not _GROUPED.fullmatch(cell)
            elif "." in cell:
                point = point or format_value(cell)
    if not comma:
        return "."
    if point or not is_decimal:
        also = f", and other cells have a point, such as {point}" if point else ""
        raise ConfigError(
            f'{comma}{also}: the comma may be a thousands separator; set decimal = "," or "." in the mapping'
        )
    return ","


def read_numbers(cells: Sequence[str], decimal: str, name: str, sheet: Sheet) -> Floats:
    """Parse the numbers of a column. Raises ConfigError with the line of an invalid number."""
    values = np.empty(len(cells))
    for k, cell in enumerate(cells):
        values[k] = _number(cell, decimal)
        if not math.isfinite(values[k]):
            raise ConfigError(
                f"{sheet.source}: {name} in line {sheet.lines[k]} is not a number: {format_value(cell)}"
            )
    return values


def _number(cell: str, decimal: str) -> float:
    if "_" in cell or (decimal == "," and "." in cell):  # Python's own 1_000, and thousands
        return math.nan
    try:
        return float(cell.replace(",", ".") if decimal == "," else cell)
    except ValueError:
        return math.nan


def is_iso(cell: str) -> bool:
    """Return whether a cell contains an ISO 8601 date and time."""
    return _ISO.match(cell) is not None


def read_iso_times(cells: Sequence[str], sheet: Sheet) -> tuple[Floats, str]:
    """Parse ISO 8601 times to seconds since 1970; also return whether they have a time zone. Digits below 1 µs are
    truncated.

    Raises ConfigError.
    """
    values, kind = np.empty(len(cells)), ""
    for k, cell in enumerate(cells):
        try:
            at = datetime.fromisoformat(cell) if is_iso(cell) else None
        except ValueError:
            at = None
        if at is None:
            raise ConfigError(
                f"{sheet.where(k)}: {format_value(cell)} is not an ISO 8601 time like the previous ones"
            )
        zone = LOCAL if at.tzinfo is None else ZONED
        if zone != (kind := kind or zone):
            raise ConfigError(
                f"{sheet.where(k)}: {format_value(cell)} is mixed with {kind}; give all times a zone"
            )
        values[k] = (at if at.tzinfo else at.replace(tzinfo=UTC)).timestamp()
    return values, kind
