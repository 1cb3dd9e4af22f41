"""An experiment and its findings: rows of figures, means over noise seeds, and rows as CSV and Markdown."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from operator import call
from statistics import fmean, pstdev
from typing import Any, Protocol, TypeAlias

from hil_bridge.control import FiguresOfMerit
from hil_bridge.lab.drawing import Panel
from hil_bridge.lab.processes import in_order, own_processes
from hil_bridge.lab.text_tables import markdown_table
from hil_bridge.record.analysis.figures import UNKNOWN, title_of
from hil_bridge.record.export.tables import as_csv

Value: TypeAlias = str | int | float | None
Row: TypeAlias = dict[str, Value]
"""One row of a table by column; None where there is no figure."""

SIGNIFICANT_DIGITS = 4
MERITS = tuple(field.name for field in fields(FiguresOfMerit) if field.name != "rise_s")
"""Figures that a table holds; the paper counts the rise in samples."""


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
    curves: tuple[Row, ...] = ()
    """Curves of the picture where the table does not hold them, for a second CSV file."""


@dataclass(frozen=True, slots=True)
class Experiment:
    """Simulations, and what to make of their results."""

    name: str
    title: str
    about: str
    """What the paper says and what is done here; numbers are in the claims and the table."""
    jobs: Callable[[int], Sequence[Job]]
    """The simulations for so many noise seeds."""
    evaluate: Callable[..., Findings]
    """Table and curves from the jobs and their results, two sequences of the same length."""
    claims: Callable[[Sequence[Row]], tuple[Claim, ...]]
    """The paper's claims with the results, from the table alone: no number can differ from the CSV file."""
    panels: Callable[[Sequence[Row]], Sequence[Panel]] = lambda rows: ()
    """The picture of the curves, or of the table without curves; no panel for an experiment without a picture."""
    summary: Callable[[Sequence[Row]], Sequence[Row]] = lambda table: table
    """The rows that a page shows."""


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


def spread(values: Iterable[float | None]) -> tuple[float | None, float | None]:
    """Mean and standard deviation; None when a value is missing, for a mean of the others would flatter."""
    known = list(values)
    numbers = [float(value) for value in known if value is not None]
    if not numbers or len(numbers) < len(known):
        return None, None
    return fmean(numbers), pstdev(numbers)


def mean_merits(merits: Sequence[FiguresOfMerit | None]) -> Row:
    """Mean of every figure over the seeds, and its standard deviation as `…_sd`."""
    row: Row = {"seeds": len(merits)}
    for column in MERITS:
        mean, deviation = spread(None if merit is None else getattr(merit, column) for merit in merits)
        row[column], row[f"{column}_sd"] = round_digits(mean), round_digits(deviation)
    return row


def round_digits(value: float | None) -> float | None:
    """The value with the digits that a table keeps."""
    return None if value is None else float(f"{value:.{SIGNIFICANT_DIGITS}g}")


def columns_of(*columns: str) -> Callable[[Sequence[Row]], list[Row]]:
    """A function that returns these columns of a table."""
    return lambda table: [{column: row[column] for column in columns} for row in table]


def to_csv(rows: Sequence[Row]) -> str:
    """The rows under a line of column names; an empty field for None."""
    return as_csv({column: [row[column] for row in rows] for column in rows[0]}).decode()


def markdown(rows: Sequence[Row]) -> str:
    """The rows as a Markdown table; underscores of column names become spaces."""
    return markdown_table(
        [title_of(column) for column in rows[0]], [[digits(value) for value in row.values()] for row in rows]
    )


def digits(value: Value) -> str:
    """A figure as an operator reads it: three digits, thousands apart, a dash for None."""
    match value:
        case None:
            return UNKNOWN
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
    """A figure that is there. Raises TypeError for a missing one."""
    value = row[column]
    if not isinstance(value, (int, float)):
        raise TypeError(f"{column} is {value!r}, not a number")
    return float(value)


def distinct(rows: Sequence[Row], column: str) -> list[Any]:
    """The values of a column, each once, in order of first appearance."""
    return list(dict.fromkeys(row[column] for row in rows))
