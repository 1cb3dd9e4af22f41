"""Experiment and its findings: rows of figures, means over noise seeds, and rows as CSV and Markdown."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from operator import call
from statistics import fmean, pstdev
from typing import Any, Protocol, TypeAlias

from hil_bridge.control import FiguresOfMerit
from hil_bridge.lab.drawing import Panel
from hil_bridge.lab.processes import in_order, own_processes
from hil_bridge.lab.text_tables import markdown_table
from hil_bridge.record.analysis.definition import UNKNOWN
from hil_bridge.record.analysis.figures import title_of
from hil_bridge.record.export.tables import as_csv

Value: TypeAlias = str | int | float | None
Row: TypeAlias = dict[str, Value]
"""Row of a table, by column; None for a missing figure."""

SIGNIFICANT_DIGITS = 4
MERITS = tuple(field.name for field in fields(FiguresOfMerit) if field.name != "rise_s")
"""Figures in a table; the paper counts the rise in samples."""


class Job(Protocol):
    """Simulation: hashable, picklable, a pure function of its fields."""

    def __call__(self) -> Any:
        """Run the simulation."""


@dataclass(frozen=True, slots=True)
class Claim:
    """Claim of the paper and the result here, one line each."""

    paper: str
    found: str


@dataclass(frozen=True, slots=True)
class Findings:
    """Results of an experiment."""

    table: tuple[Row, ...]
    """Numbers for the CSV file."""
    curves: tuple[Row, ...] = ()
    """Curves of the picture that are not in the table, for a second CSV file."""


@dataclass(frozen=True, slots=True)
class Experiment:
    """Simulations and their evaluation."""

    name: str
    title: str
    about: str
    """Description of the paper's statement and of the experiment; numbers are in the claims and the table."""
    jobs: Callable[[int], Sequence[Job]]
    """Function that returns the simulations for this many noise seeds."""
    evaluate: Callable[..., Findings]
    """Function that returns table and curves from the jobs and their results, two sequences of equal length."""
    claims: Callable[[Sequence[Row]], tuple[Claim, ...]]
    """Function that returns the paper's claims with the results from the table, so that they match the CSV file."""
    panels: Callable[[Sequence[Row]], Sequence[Panel]] = lambda rows: ()
    """Function that returns the picture of the curves, or of the table without curves; no panels without a picture."""
    summary: Callable[[Sequence[Row]], Sequence[Row]] = lambda table: table
    """Function that returns the rows shown on the page."""


def run_jobs(
    jobs: Iterable[Job], workers: int | None = None, advance: Callable[[int], object] = lambda count: None
) -> dict[Job, Any]:
    """Return the results by job, in the order of the jobs; a job that occurs twice runs once.

    `workers` is the number of processes, by default one per core; with 1 everything runs in this process. `advance` is
    called with the number of jobs that have ended since the last call.
    """
    todo = list(dict.fromkeys(jobs))
    with own_processes(workers, len(todo)) as pool:
        return dict(zip(todo, in_order(pool, call, todo, advance), strict=True))


def spread(values: Iterable[float | None]) -> tuple[float | None, float | None]:
    """Return mean and standard deviation; None if a value is missing, because a mean of the others would be biased."""
    known = list(values)
    numbers = [float(value) for value in known if value is not None]
    if not numbers or len(numbers) < len(known):
        return None, None
    return fmean(numbers), pstdev(numbers)


def mean_merits(merits: Sequence[FiguresOfMerit | None]) -> Row:
    """Return the mean of every figure over the seeds, and its standard deviation as `…_sd`."""
    row: Row = {"seeds": len(merits)}
    for column in MERITS:
        mean, deviation = spread(None if merit is None else getattr(merit, column) for merit in merits)
        row[column], row[f"{column}_sd"] = round_digits(mean), round_digits(deviation)
    return row


def round_digits(value: float | None) -> float | None:
    """Return the value rounded to the digits of a table."""
    return None if value is None else float(f"{value:.{SIGNIFICANT_DIGITS}g}")


def columns_of(*columns: str) -> Callable[[Sequence[Row]], list[Row]]:
    """Return a function that selects these columns of a table."""
    return lambda table: [{column: row[column] for column in columns} for row in table]


def to_csv(rows: Sequence[Row]) -> str:
    """Return the rows as CSV with a header line; an empty field for None."""
    return as_csv({column: [row[column] for row in rows] for column in rows[0]}).decode()


def markdown(rows: Sequence[Row]) -> str:
    """Return the rows as a Markdown table; underscores of column names become spaces."""
    return markdown_table(
        [title_of(column) for column in rows[0]], [[digits(value) for value in row.values()] for row in rows]
    )


def digits(value: Value) -> str:
    """Return a figure as text: three digits, separated thousands, a dash for None."""
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
    """Return the verdict on a claim, as text for the page."""
    return "reproduced" if holds else "not reproduced"


def rows_where(rows: Sequence[Row], **wanted: Value) -> list[Row]:
    """Return the rows that have these values."""
    return [row for row in rows if all(row[name] == value for name, value in wanted.items())]


def only_row(rows: Sequence[Row], **wanted: Value) -> Row:
    """Return the only such row. Raises ValueError if there is none, or more than one."""
    (row,) = rows_where(rows, **wanted)
    return row


def figure(row: Row, column: str) -> float:
    """Return a figure that is not None. Raises TypeError for a missing one."""
    value = row[column]
    if not isinstance(value, (int, float)):
        raise TypeError(f"{column} is {value!r}, not a number")
    return float(value)


def distinct(rows: Sequence[Row], column: str) -> list[Any]:
    """Return the distinct values of a column, in order of first appearance."""
    return list(dict.fromkeys(row[column] for row in rows))
