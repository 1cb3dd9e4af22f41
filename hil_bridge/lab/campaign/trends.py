"""Comparison of several campaigns by cell of the matrix: share of runs that passed, medians of figures, and
significant changes.

Runs count as independent samples. For campaigns that share seeds this is conservative: it detects fewer changes,
not more.
"""

import math
import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from enum import StrEnum
from itertools import chain, count
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
    planned: int
    """Number of runs of the complete campaign."""
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

    @property
    def best(self) -> frozenset[int]:
        """Places of the results with the largest share of passed runs; empty if it is the same in all of them."""
        return _least([-one.passed / one.total if one.total else None for one in self.tallies])


class FigureChange(Struct, frozen=True):
    """Medians of one figure of a cell in each of the results. The test compares the first results with the last
    ones.
    """

    figure: str
    cell: str
    title: str
    """Title of a primary figure of the campaign; empty for other figures."""
    runs: tuple[int, ...]
    medians: tuple[float | None, ...]
    """Median of the figure in each of the results; None if no run has the figure, or the median is infinite."""
    intervals: tuple[tuple[float, float] | None, ...]
    """Interval of each median with a confidence of 95 %, or the range of fewer than six runs; None without a run."""
    probability: float | None
    """Probability of such a difference by chance (Mann-Whitney test)."""
    adjusted: float | None
    """Probability adjusted by Holm's method for the number of primary figures, or of other figures and cells."""
    change: Change

    @property
    def label(self) -> str:
        """Title of a primary figure, and the words of another figure."""
        return self.title or FIGURES[self.figure].words

    @property
    def direction(self) -> Change:
        """Direction in which the median changed, whether significantly or not."""
        first, last = (self._cost(place) for place in (0, len(self.medians) - 1))
        if first is None or last is None:
            return Change.OTHER
        return Change.NONE if first == last else Change.WORSE if last > first else Change.BETTER

    @property
    def best(self) -> frozenset[int]:
        """Places of the results with the best median; empty if all are equally good."""
        return _least([self._cost(place) for place in range(len(self.medians))])

    def _cost(self, place: int) -> float | None:
        """Return a number that is the smaller, the better the median of these results is; None if no run has the
        figure, or if it has no preferred direction.
        """
        if not self.runs[place]:
            return None
        median = self.medians[place]
        return FIGURES[self.figure].cost(math.inf if median is None else median)  # a time that never ended


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
    primary: tuple[FigureChange, ...]
    """Primary figures of the last campaign."""
    figures: tuple[FigureChange, ...]
    """Other figures that differ between the results."""

    @property
    def worse(self) -> bool:
        """Whether any cell or figure is significantly worse in the last results than in the first."""
        return Change.WORSE in self.changes

    @property
    def changes(self) -> frozenset[Change]:
        """Significant changes over all cells, of single cells, and of figures."""
        figures = (one.change for one in (*self.primary, *self.figures))
        return frozenset((self.overall.change, *(one.change for one in self.cells), *figures)) - {Change.NONE}

    @property
    def significant(self) -> tuple[int, int]:
        """Number of cells and figures that are significantly worse, and number of cells and figures that are
        significantly better.
        """
        changes = [one.change for one in self.cells]
        changes += [one.change for one in (*self.primary, *self.figures)]
        return changes.count(Change.WORSE), changes.count(Change.BETTER)

    @property
    def tested(self) -> bool:
        """Whether there are enough runs for the tests, or a difference is significant with fewer."""
        return not self.runs_needed or bool(self.changes)

    @property
    def runs_needed(self) -> int:
        """Number of runs of each case from which on a difference of a figure can be significant; 0 if there are
        enough, or no figure is tested.
        """
        tested = [row for row in self.primary or self.figures if row.probability is not None]
        if not tested:
            return 0
        fewest = self.level / (2.0 * len(tested))  # the probability of two samples without an overlap, halved
        if any(math.comb(row.runs[0] + row.runs[-1], row.runs[0]) * fewest > 1.0 for row in tested):
            return 0
        return next(runs for runs in count(1) if math.comb(2 * runs, runs) * fewest > 1.0)


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
        results.append(
            Results(name, plan.name, tally_of(runs), plan.count, dict(facts_of(store, plan, runs)))
        )
        by_cell.append(runs_by_cell(plan, runs))
        by_case.append(runs_by_case(plan, runs))
    first, *_, last = stores.values()
    titles = {(one.figure, one.case): one.title for one in last.plan().primary}
    figures = list(_figures(by_case, titles))
    primary = [row for key in titles for row in figures if (row.figure, row.cell) == key]
    cells = list(dict.fromkeys(chain.from_iterable(by_cell)))
    overall = _adjust([_cell("all cells", [one.tally for one in results])], _cell_change)
    rows = [_cell(cell, [tally_of(runs_of.get(cell, ())) for runs_of in by_cell]) for cell in cells]
    return Trend(
        LEVEL,
        tuple(results),
        tuple(setting_changes(first, last)),
        overall[0],
        tuple(_adjust(rows, _cell_change)),
        tuple(_adjust(primary, _figure_change)),
        tuple(_adjust([row for row in figures if not row.title], _figure_change)),
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


def _figures(
    by_case: Sequence[Mapping[str, list[Done]]], titles: Mapping[tuple[str, str], str]
) -> Iterator[FigureChange]:
    """Yield every primary figure, and the other figures that differ."""
    cases = list(dict.fromkeys(chain.from_iterable(by_case)))
    for key in NUMBERS:
        for case in cases:
            samples = [values_of(key, runs_of.get(case, ())) for runs_of in by_case]
            title = titles.get((key, case), "")
            if title or any(sample != samples[0] for sample in samples):
                medians = tuple(_median(sample) for sample in samples)
                intervals = tuple(median_interval(sample) for sample in samples)
                both = samples[0] and samples[-1]
                probability = rank_sum(samples[0], samples[-1]) if both else None
                runs = tuple(map(len, samples))
                yield FigureChange(key, case, title, runs, medians, intervals, probability, None, Change.NONE)


def _median(values: Sequence[float]) -> float | None:
    if not values:
        return None
    median = statistics.median(values)
    return median if math.isfinite(median) else None


def _figure_change(row: FigureChange) -> Change:
    return row.direction or Change.OTHER


def _least(costs: Sequence[float | None]) -> frozenset[int]:
    """Return the places of the smallest number; none if all numbers are equal."""
    known = {cost for cost in costs if cost is not None}
    least = min(known) if len(known) > 1 else None
    return frozenset(place for place, cost in enumerate(costs) if cost is not None and cost == least)


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
