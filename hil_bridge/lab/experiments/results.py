"""An experiment and its findings, and the way of tables into files and back."""

import csv
import io
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from operator import call
from typing import Any, Protocol, TypeAlias

from hil_bridge.lab.processes import in_order, own_processes
from hil_bridge.lab.text_tables import markdown_table
from hil_bridge.record.analysis.figures import title_of

Value: TypeAlias = str | int | float | None
Row: TypeAlias = dict[str, Value]
"""One row of a table by column; None where there is no figure."""

SIGNIFICANT_DIGITS = 4


class Job(Protocol):
    """One simulation: hashable, picklable, a pure function of its fields."""

    def __call__(self) -> Any:
        """Do it."""


@dataclass(frozen=True, slots=True)
class Claim:
    """A claim of the paper and the result here, one line each."""

    paper: str
    found: str


@dataclass(frozen=True, slots=True)
class Findings:
    """Results of an experiment."""

    table: tuple[Row, ...]
    """The numbers, as they go into the CSV file."""
    picture: bytes
    """PNG."""
    series: tuple[Row, ...] = ()
    """The curves of the picture where the table does not hold them, for a second CSV file."""
    reference_n: float | None = None
    """Force that the curves are to reach."""


@dataclass(frozen=True, slots=True)
class Experiment:
    """Simulations, and what to make of their results."""

    name: str
    title: str
    jobs: Callable[[int], Sequence[Job]]
    """The simulations for so many noise seeds."""
    evaluate: Callable[..., Findings]
    """Table and picture from the jobs and their results, two sequences of the same length."""
    describe: Callable[[Sequence[Row]], tuple[str, tuple[Claim, ...]]]
    """The paragraph, and the paper's claims with the results. Both come from the table alone, so that no number in the
    text can differ from the CSV file.
    """
    page_columns: tuple[str, ...] = ()
    """Columns of the table that a page shows; none for a table too long for it."""


def run_jobs(
    jobs: Iterable[Job], workers: int | None = None, advance: Callable[[int], object] = lambda count: None
) -> dict[Job, Any]:
    """Results by job, in the order of the jobs; a job that occurs twice runs once.

    `workers` processes, by default one a core; with 1 everything runs in this one. `advance` is told how many have
    ended since.
    """
    todo = list(dict.fromkeys(jobs))
    with own_processes(workers, len(todo)) as pool:
        return dict(zip(todo, in_order(pool, call, todo, advance), strict=True))


def round_digits(value: float | None) -> float | None:
    """The value with the digits that a table keeps."""
    return None if value is None else float(f"{value:.{SIGNIFICANT_DIGITS}g}")


def to_csv(rows: Sequence[Row]) -> str:
    """The rows under a line of column names; an empty field for None."""
    text = io.StringIO()
    if rows:
        writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    return text.getvalue()


def markdown(rows: Sequence[Row], columns: Sequence[str]) -> str:
    """These columns as a Markdown table; underscores of column names become spaces."""
    texts = [[digits(row[column]) for column in columns] for row in rows]
    return markdown_table([title_of(column) for column in columns], texts)


def digits(value: Value) -> str:
    """A figure as a person reads it: three digits, thousands apart, a dash for none."""
    match value:
        case None:
            return "–"
        case str():
            return value
        case int():
            return f"{value:,}".replace(",", " ")
        case _ if abs(value) >= 999.5:
            return f"{float(f'{value:.3g}'):,.0f}".replace(",", " ")
        case _:
            return f"{value:.3g}"


def verdict(holds: bool) -> str:
    """Words of a page for a claim."""
    return "reproduced" if holds else "not reproduced"


def rows_where(rows: Sequence[Row], **wanted: Value) -> list[Row]:
    """The rows that have these values."""
    return [row for row in rows if all(row[name] == value for name, value in wanted.items())]


def only_row(rows: Sequence[Row], **wanted: Value) -> Row:
    """The only such row. Raises ValueError when there is none, or more than one."""
    (row,) = rows_where(rows, **wanted)
    return row


def figure(row: Row, column: str) -> float:
    """A figure that is there. Raises TypeError when it is none."""
    value = row[column]
    if not isinstance(value, (int, float)):
        raise TypeError(f"{column} is {value!r}, no number")
    return float(value)


def distinct(rows: Sequence[Row], column: str) -> list[Any]:
    """The values of a column, each once, in order of first appearance."""
    return list(dict.fromkeys(row[column] for row in rows))
