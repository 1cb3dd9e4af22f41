"""The cells of a table of text: where its columns are, and the numbers and times in them.

What could be read in two ways is refused with its line.
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
"""Chosen: rows of a table at most. An hour at 500 Hz has less."""
HEADER_LINES = 1000
"""Chosen: lines in which the names of the columns are looked for. Headers of test benches have some hundred."""
_COMMENT = "#%"
_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")
"""A number whose comma may set off thousands, or be its decimal sign."""
_ISO = re.compile(r"\d{4}-?\d\d-?\d\d[T ]\d")
NUMBERS, LOCAL, ZONED = "numbers", "times without a zone", "times with a zone"
"""What a column of times holds."""


class Sheet(NamedTuple):
    """Cells of a file."""

    source: str
    names: list[str]
    """Empty where columns have numbers alone."""
    rows: list[list[str]]
    lines: list[int]
    """The line of each row, from 1."""

    def where(self, row: int) -> str:
        """A row for a message."""
        return f"{self.source}: line {self.lines[row]}"


def read_sheet(file: Path, mapping: TableMapping) -> Sheet:
    """The cells of a file below its line of names. Raises ConfigError."""
    source = format_path(file)
    lines = read_text(file).split("\n")
    names: list[str] = []
    separator = mapping.separator or ","
    first = next((k for k, line in enumerate(lines) if line.strip() and line.lstrip()[0] not in _COMMENT), 0)
    if mapping.header:
        wanted = [column.name for column in mapping.columns_in(file) if isinstance(column.name, str)]
        first, separator, names = _header(lines, first, wanted, mapping.separator, source)
        first += 1
    sheet = Sheet(source, names, [], [])
    try:
        for line, row in _split(lines[first:], separator):
            if len(sheet.rows) == ROWS_MOST:
                raise ConfigError(f"{source} has more than {ROWS_MOST} rows; at most these are read")
            sheet.rows.append(row)
            sheet.lines.append(first + line)
    except csv.Error as error:
        line = sheet.lines[-1] + 1 if sheet.lines else first + 1
        raise ConfigError(f"{source}: line {line}: it is no table: {error}") from error
    _check_widths(sheet, separator)
    return sheet


def _split(lines: Sequence[str], separator: str) -> Iterator[tuple[int, list[str]]]:
    """The cells of each line that has some, and its number from 1. Raises csv.Error."""
    sign = SEPARATORS[separator]
    if sign is None:
        yield from ((k, line.split()) for k, line in enumerate(lines, 1) if line.strip())
        return
    reader = csv.reader(lines, delimiter=sign)
    before = 0
    for row in reader:
        if reader.line_num - before > 1:
            raise csv.Error(
                f"a quote is not closed in its line, and takes in {reader.line_num - before} lines"
            )
        before = reader.line_num
        if len(row) > 1 or "".join(row).strip():
            yield reader.line_num, [cell.strip() for cell in row]


def _header(
    lines: Sequence[str], first: int, wanted: Sequence[str], separator: str, source: str
) -> tuple[int, str, list[str]]:
    """Number of the line that names all wanted columns, its separator and its names. Raises ConfigError."""
    separators = [separator] if separator else list(SEPARATORS) if wanted else [","]
    nearest = (-1, next(iter(wanted), ""), [""])
    for k, line in enumerate(
        lines[:HEADER_LINES] if wanted else lines[first : first + 1], 0 if wanted else first
    ):
        for text in dict.fromkeys((line, line.lstrip(f"{_COMMENT} "))):
            for one in separators:
                try:
                    names = next(_split([text], one), (0, [""]))[1]
                except csv.Error:
                    continue
                missing = [name for name in wanted if not _places(name, names)]
                if not missing:
                    return k, one, names
                count = len(wanted) - len(missing)
                if count > nearest[0] and (count or k >= first):
                    nearest = (count, missing[0], names)
    refuse_known(source, "\n".join(lines[:HEADER_LINES]).encode())
    near = format_value(", ".join(nearest[2][:8]))
    raise ConfigError(f"{source} has no column {format_value(nearest[1])}; its header begins with {near}")


def _places(name: str, names: Sequence[str]) -> list[int]:
    """Columns of this name, with or without a unit behind it."""
    exact = [k for k, one in enumerate(names) if one == name]
    return exact or [k for k, one in enumerate(names) if split_heading(one)[0] == name]


def place_of(name: str | int, sheet: Sheet) -> int:
    """The place of a column from 0. Raises ConfigError for a name that two have."""
    if isinstance(name, int):
        return name - 1
    places = _places(name, sheet.names)
    if len(places) > 1:
        numbers = " and ".join(str(place + 1) for place in places[:2])
        raise ConfigError(
            f"{sheet.source}: columns {numbers} are both named {format_value(name)}; give a number in its place"
        )
    return places[0]


def _check_widths(sheet: Sheet, separator: str) -> None:
    """Raise ConfigError for a row that does not fit the names, or the first row: its cells may be shifted."""
    width = len(sheet.names or (sheet.rows or [[]])[0])
    for k, row in enumerate(sheet.rows):
        if (len(row) > width and any(row[width:])) or (separator == "space" and len(row) < width):
            raise ConfigError(
                f"{sheet.where(k)} has {len(row)} cells, and the {'header' if sheet.names else 'first row'} {width}: "
                "which is which? Is the separator a part of names or of numbers with a decimal comma?"
            )


def cells_of(sheet: Sheet, place: int, name: str) -> list[str]:
    """The cells of a column. Raises ConfigError for a row that ends before."""
    for k, row in enumerate(sheet.rows):
        if place >= len(row):
            raise ConfigError(f"{sheet.where(k)} has {len(row)} columns, {name} is in column {place + 1}")
    return [row[place] for row in sheet.rows]


def decimal_of(columns: Mapping[str, Sequence[str]], sheet: Sheet) -> str:
    """The decimal sign of all these cells. Raises ConfigError where they do not show it."""
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
        also = f", and other cells have a point, as {point}" if point else ""
        raise ConfigError(
            f'{comma}{also}: its comma may set off thousands; write decimal = "," or "." into the mapping'
        )
    return ","


def read_numbers(cells: Sequence[str], decimal: str, name: str, sheet: Sheet) -> Floats:
    """The numbers in a column. Raises ConfigError with the line of what is none."""
    values = np.empty(len(cells))
    for k, cell in enumerate(cells):
        values[k] = _number(cell, decimal)
        if not math.isfinite(values[k]):
            raise ConfigError(
                f"{sheet.source}: {name} in line {sheet.lines[k]} is no number: {format_value(cell)}"
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
    """Whether a cell holds a date and a time of ISO 8601."""
    return _ISO.match(cell) is not None


def read_iso_times(cells: Sequence[str], sheet: Sheet) -> tuple[Floats, str]:
    """Times of ISO 8601, s since 1970, and whether they have a zone. Digits below 1 µs are cut. Raises ConfigError."""
    values, kind = np.empty(len(cells)), ""
    for k, cell in enumerate(cells):
        try:
            at = datetime.fromisoformat(cell) if is_iso(cell) else None
        except ValueError:
            at = None
        if at is None:
            raise ConfigError(
                f"{sheet.where(k)}: {format_value(cell)} is no time of ISO 8601 as those before"
            )
        zone = LOCAL if at.tzinfo is None else ZONED
        if zone != (kind := kind or zone):
            raise ConfigError(
                f"{sheet.where(k)}: {format_value(cell)} stands between {kind}; give all a zone"
            )
        values[k] = (at if at.tzinfo else at.replace(tzinfo=UTC)).timestamp()
    return values, kind
