"""Comparison of several campaigns by cell of the matrix: share of runs that passed, medians of figures, and
significant changes.

Runs count as independent samples. For campaigns that share seeds this is conservative: it detects fewer changes,
not more.
"""

import math
import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from enum import StrEnum
from itertools import chain
from typing import TypeVar

from msgspec import Struct
from msgspec.structs import replace

from hil_bridge.errors import ConfigError
from hil_bridge.lab.campaign.comparison import SettingChange, setting_changes
from hil_bridge.lab.campaign.digest import (
    NUMBERS,
    Tally,
    facts_of,
    runs_by_case,
    runs_by_cell,
    tally_of,
    values_of,
)
from hil_bridge.lab.campaign.store import Done, Store
from hil_bridge.lab.significance import LEVEL, fisher_exact, holm, median_interval, rank_sum
from hil_bridge.record.analysis.definition import Good
from hil_bridge.record.analysis.figures import FIGURES

RESULTS_MOST = 50
"""Maximum number of results compared at once. Chosen: one year of weekly results."""


class Change(StrEnum):
    """Significant change from the first results to the last ones."""

    WORSE = "worse"
    BETTER = "better"
    OTHER = "changed"
    """Significant change of a figure without a preferred direction."""
    NONE = ""


class Results(Struct, frozen=True):
    """Results of one of the compared campaigns."""

    name: str
    """Label of the results in the comparison: the file name."""
    campaign: str
    tally: Tally
    facts: Mapping[str, str]


class CellChange(Struct, frozen=True):
    """Counts of runs of one cell in each of the results. The test compares the first results with the last ones."""

    cell: str
    tallies: tuple[Tally, ...]
    probability: float | None
    """Probability of such a difference by chance (Fisher's exact test); None if the first or the last results have
    no run.
    """
    adjusted: float | None
    """Probability adjusted by Holm's method for the number of cells."""
    change: Change


class FigureChange(Struct, frozen=True):
    """Medians of one figure of a cell in each of the results. The test compares the first results with the last
    ones.
    """

    figure: str
    cell: str
    runs: tuple[int, ...]
    medians: tuple[float | None, ...]
    """Median of the figure in each of the results; None if no run has the figure, or the median is infinite."""
    intervals: tuple[tuple[float, float] | None, ...]
    """Interval of each median with a confidence of 95 %, or the range of fewer than six runs; None without a run."""
    probability: float | None
    """Probability of such a difference by chance (Mann-Whitney test)."""
    adjusted: float | None
    """Probability adjusted by Holm's method for the number of figures and cells."""
    change: Change


_Row = TypeVar("_Row", CellChange, FigureChange)


class Trend(Struct, frozen=True):
    """Comparison of all results, oldest first."""

    level: float
    results: tuple[Results, ...]
    settings: tuple[SettingChange, ...]
    """Settings that differ between the first results and the last ones."""
    overall: CellChange
    """Change over all cells together."""
    cells: tuple[CellChange, ...]
    figures: tuple[FigureChange, ...]
    """Figures that differ between the results."""

    @property
    def worse(self) -> bool:
        """Whether any cell or figure is significantly worse in the last results than in the first."""
        return self.overall.change is Change.WORSE or self.significant[0] > 0

    @property
    def significant(self) -> tuple[int, int]:
        """Number of cells and figures that are significantly worse, and number of cells and figures that are
        significantly better.
        """
        changes = [*(one.change for one in self.cells), *(one.change for one in self.figures)]
        return changes.count(Change.WORSE), changes.count(Change.BETTER)


def trend_of(stores: Mapping[str, Store]) -> Trend:
    """Compare results by name, oldest first. Raises ConfigError for too few or too many results, and for results
    without runs.
    """
    if not 2 <= len(stores) <= RESULTS_MOST:
        raise ConfigError(f"compare takes the results of 2 to {RESULTS_MOST} campaigns, not of {len(stores)}")
    results, by_cell, by_case = [], [], []
    for name, store in stores.items():
        plan, runs = store.plan(), list(store.runs())
        if not runs:
            raise ConfigError(f"{store.path} has no run yet; run the campaign first")
        results.append(Results(name, plan.name, tally_of(runs), dict(facts_of(store, plan, runs))))
        by_cell.append(runs_by_cell(plan, runs))
        by_case.append(runs_by_case(plan, runs))
    first, *_, last = stores.values()
    cells = list(dict.fromkeys(chain.from_iterable(by_cell)))
    overall = _adjust([_cell("all cells", [one.tally for one in results])], _cell_change)
    rows = [_cell(cell, [tally_of(runs_of.get(cell, ())) for runs_of in by_cell]) for cell in cells]
    return Trend(
        LEVEL,
        tuple(results),
        tuple(setting_changes(first, last)),
        overall[0],
        tuple(_adjust(rows, _cell_change)),
        tuple(_adjust(list(_figures(by_case)), _figure_change)),
    )


def _cell(cell: str, tallies: Sequence[Tally]) -> CellChange:
    first, last = tallies[0], tallies[-1]
    probability = None
    if first.total and last.total:
        probability = fisher_exact(
            (first.passed, first.total - first.passed), (last.passed, last.total - last.passed)
        )
    return CellChange(cell, tuple(tallies), probability, None, Change.NONE)


def _cell_change(row: CellChange) -> Change:
    first, last = (one.passed / one.total for one in (row.tallies[0], row.tallies[-1]))
    return Change.WORSE if last < first else Change.BETTER


def _figures(by_case: Sequence[Mapping[str, list[Done]]]) -> Iterator[FigureChange]:
    cases = list(dict.fromkeys(chain.from_iterable(by_case)))
    for key in NUMBERS:
        for case in cases:
            samples = [values_of(key, runs_of.get(case, ())) for runs_of in by_case]
            if any(sample != samples[0] for sample in samples):
                medians = tuple(_median(sample) for sample in samples)
                intervals = tuple(median_interval(sample) for sample in samples)
                both = samples[0] and samples[-1]
                probability = rank_sum(samples[0], samples[-1]) if both else None
                runs = tuple(map(len, samples))
                yield FigureChange(key, case, runs, medians, intervals, probability, None, Change.NONE)


def _median(values: Sequence[float]) -> float | None:
    if not values:
        return None
    median = statistics.median(values)
    return median if math.isfinite(median) else None


def _figure_change(row: FigureChange) -> Change:
    good, first, last = FIGURES[row.figure].good, row.medians[0], row.medians[-1]
    if good is Good.NONE or first == last:
        return Change.OTHER
    if first is None or last is None:  # an infinite median is a time that never ends
        return Change.WORSE if last is None else Change.BETTER
    if good is Good.NEAR_ZERO:
        first, last = abs(first), abs(last)
    return Change.WORSE if last > first else Change.BETTER


def _adjust(rows: Sequence[_Row], change_of: Callable[[_Row], Change]) -> list[_Row]:
    """Return the rows with adjusted probabilities and significant changes."""
    tested = [row for row in rows if row.probability is not None]
    adjusted = dict(zip(map(id, tested), holm([row.probability or 0.0 for row in tested]), strict=True))
    result = []
    for row in rows:
        probability = adjusted.get(id(row))
        significant = probability is not None and probability < LEVEL
        change = change_of(row) if significant else Change.NONE
        result.append(replace(row, adjusted=probability, change=change))
    return result
