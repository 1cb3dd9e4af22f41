"""Digest of a campaign's results: counts, cases, unmet criteria, and figures by cell.

The page, the text, Markdown, JSON and JUnit are all rendered from this digest, and therefore agree.
"""

import math
import statistics
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from operator import itemgetter
from typing import TypeAlias

from msgspec import Struct
from msgspec.structs import replace

from hil_bridge.lab.campaign.criteria import Criterion, Unmet, unmet_of, value_text
from hil_bridge.lab.campaign.plan import Plan
from hil_bridge.lab.campaign.run_text import faults_of_run
from hil_bridge.lab.campaign.store import Done, Store
from hil_bridge.record.analysis.figures import JUDGED, WORDS

_Spread: TypeAlias = tuple[float | None, float | None, float | None, float | None, float | None]
"""Least value, median, largest value, mean and standard deviation."""
_NO_SPREAD: _Spread = None, None, None, None, None
FORCE = "force_true_max_n"
"""Figure by which runs and cases are compared if no criterion is missed."""
NUMBERS = tuple(key for key in JUDGED if key not in WORDS)
"""Names of the figures of a run that are numbers."""


class Tally(Struct, frozen=True):
    """Numbers of runs that met every criterion, that missed a criterion, and that ended by a bug."""

    passed: int = 0
    failed: int = 0
    errors: int = 0

    @property
    def total(self) -> int:
        """Total number of runs."""
        return self.passed + self.failed + self.errors

    @property
    def good(self) -> bool:
        """Whether there is at least one run, and every run passed."""
        return 0 < self.passed == self.total

    @property
    def text(self) -> str:
        """Counts as one line of text."""
        return f"{self.passed} passed, {self.failed} failed, {self.errors} error{'s' * (self.errors != 1)}"


class CaseResult(Struct, frozen=True):
    """Results of one cell of the matrix with one fault."""

    cell: str
    fault: str
    phase: str
    impossible: str
    """Reason why the cell does not support the fault; empty if it does."""
    tally: Tally


class CriterionResult(Struct, frozen=True):
    """Number of runs that met a criterion, that did not, and to which it does not apply."""

    criterion: str
    met: int
    not_met: int
    no_concern: int
    """Number of runs to which the criterion does not apply, or that do not have its figure."""


class FigureResult(Struct, frozen=True):
    """Distribution of a figure in one cell of the matrix. The values are None if no run has a finite value, and the
    deviation also if only one run has.
    """

    figure: str
    cell: str
    """Label of the cell; with the fault if the campaign lists several."""
    runs: int
    """Number of runs that have the figure."""
    endless: int
    """Number of runs in which the figure is infinite."""
    least: float | None
    median: float | None
    largest: float | None
    mean: float | None
    deviation: float | None
    """Standard deviation of the runs."""
    bounds: tuple[float, ...] = ()
    """Bounds of the criteria on the figure."""
    title: str = ""
    """Title of a primary figure of the campaign; empty for other figures."""


class FailedRun(Struct, frozen=True):
    """Run that did not meet every criterion, or ended by a bug."""

    key: str
    seed: int
    cell: str
    fault: str
    outcome: str
    cause: str
    unmet: tuple[Unmet, ...]
    force_true_max_n: float | None
    recording: str
    """File name of the run's recording in the folder of recordings; empty if there is none."""


class Digest(Struct, frozen=True):
    """Summary of a campaign."""

    name: str
    results: str
    """File name of the results."""
    planned: int
    """Number of runs in the plan."""
    tally: Tally
    facts: Mapping[str, str]
    cases: tuple[CaseResult, ...]
    criteria: tuple[CriterionResult, ...]
    primary: tuple[FigureResult, ...]
    """Results of the plan's primary figures."""
    figures: tuple[FigureResult, ...]
    failing: tuple[FailedRun, ...]


def digest_of(store: Store) -> Digest:
    """Summarise the runs stored so far. Raises ConfigError for a damaged file."""
    plan, runs = store.plan(), list(store.runs())
    figures = tuple(figure_results(plan, runs))
    return Digest(
        plan.name,
        store.path.name,
        plan.count,
        tally_of(runs),
        dict(facts_of(store, plan, runs)),
        tuple(case_results(plan, runs)),
        tuple(criterion_results(plan, runs)),
        primary_results(plan, figures),
        figures,
        tuple(_failed(plan, run) for run in worst_first(plan.criteria, runs)),
    )


def tally_of(runs: Iterable[Done]) -> Tally:
    """Count runs by verdict."""
    return Tally(**Counter(map(verdict_of, runs)))


def verdict_of(run: Done) -> str:
    """Return the name of the count in `Tally` to which a run belongs."""
    return "errors" if run.outcome == "error" else "passed" if run.passed else "failed"


def facts_of(store: Store, plan: Plan, runs: Sequence[Done]) -> Iterator[tuple[str, str]]:
    """Yield names and values of the campaign's facts: date, host, code version, size and speed."""
    sittings = store.sittings()
    begun = store.fact("begun") or (sittings[0].began if sittings else "")
    last = sittings[-1].began if sittings else ""
    if begun:
        yield (
            "Date",
            f"{begun} UTC" + (f", last start {last} UTC" if last > begun and len(sittings) > 1 else ""),
        )
    if hosts := store.hosts():
        yield "Host", ", ".join(hosts)
    yield "Code", f"hil-bridge {store.fact('code')}"
    if system := store.fact("platform"):
        yield "Versions", system
    yield from _size(plan)
    count, wall_s = sum(one.runs for one in sittings), sum(one.wall_s for one in sittings)
    if wall_s > 0:
        core_s = sum(one.wall_s * one.workers for one in sittings)
        yield "Runs per second", f"{count / wall_s:.2f}, {count / core_s:.2f} for each process"
        starts = "one start" if len(sittings) == 1 else f"{len(sittings)} starts"
        yield "Time", f"{count} runs in {wall_s:.0f} s, {starts}"
    simulated = sum(run.figures.get("duration_s") or 0.0 for run in runs)  # type: ignore[misc]
    if (busy_s := sum(run.wall_s for run in runs)) > 0:
        yield "Simulated time", f"{simulated:.0f} s, {simulated / busy_s:.1f} s in each second of a core"


def _size(plan: Plan) -> Iterator[tuple[str, str]]:
    if not plan.cases_per_seed:
        yield "Cases × seeds", f"{len(plan.possible)} × {len(plan.seeds)}"
        return
    yield "Cases and seeds", f"{len(plan.possible)} cases, {len(plan.seeds)} seeds"
    turns = Counter(case for case, _ in plan.runs())
    least, most = min(turns[case] for case in plan.possible), max(turns.values())
    between = "or" if most == least + 1 else "…"
    count = f"{least}" if least == most else f"{least} {between} {most}"
    yield "Cases for each seed", f"{plan.cases_per_seed} in turn; seeds for each case: {count}"


def case_results(plan: Plan, runs: Iterable[Done]) -> Iterator[CaseResult]:
    """Yield the result of every case, in the order of the plan."""
    by_case: dict[int, list[Done]] = {}
    for run in runs:
        by_case.setdefault(run.number, []).append(run)
    for number, case in enumerate(plan.cases):
        tally = tally_of(by_case.get(number, ()))
        yield CaseResult(case.cell, case.fault, case.phase, case.impossible, tally)


def criterion_results(plan: Plan, runs: Sequence[Done]) -> Iterator[CriterionResult]:
    """Yield the result of every criterion, in the order of the plan."""
    for criterion in plan.criteria:
        verdicts = Counter(criterion.judge(run.figures) for run in runs)
        yield CriterionResult(criterion.text, verdicts[True], verdicts[False], verdicts[None])


def figure_results(plan: Plan, runs: Sequence[Done]) -> Iterator[FigureResult]:
    """Yield every figure that any run has, case by case."""
    by_case = runs_by_case(plan, runs)
    for key in NUMBERS:
        bounds = tuple(limit for one in plan.criteria if one.figure == key for limit in one.limits.values())
        for case, of_case in by_case.items():
            if values := values_of(key, of_case):
                known = [value for value in values if math.isfinite(value)]
                spread = _spread(known) if known else _NO_SPREAD
                yield FigureResult(key, case, len(values), len(values) - len(known), *spread, bounds=bounds)


def primary_results(plan: Plan, figures: Iterable[FigureResult]) -> tuple[FigureResult, ...]:
    """Return the results of the plan's primary figures, in their order."""
    results = {(one.figure, one.cell): one for one in figures}
    return tuple(
        replace(results[one.figure, one.case], title=one.title)
        for one in plan.primary
        if (one.figure, one.case) in results
    )


def _spread(values: Sequence[float]) -> _Spread:
    """Return the spread of values in ascending order."""
    deviation = statistics.stdev(values) if len(values) > 1 else None
    return values[0], statistics.median(values), values[-1], statistics.fmean(values), deviation


def runs_by_case(plan: Plan, runs: Iterable[Done]) -> dict[str, list[Done]]:
    """Group runs by the label of their case, in the order of the plan; cases without runs are left out."""
    return _grouped(plan.labels, runs)


def runs_by_cell(plan: Plan, runs: Iterable[Done]) -> dict[str, list[Done]]:
    """Group runs by cell of the matrix, in the order of the plan; cells without runs are left out."""
    return _grouped([case.cell for case in plan.cases], runs)


def _grouped(labels: Sequence[str], runs: Iterable[Done]) -> dict[str, list[Done]]:
    """Group runs by the label of the case with their number."""
    groups: dict[str, list[Done]] = {label: [] for label in labels}
    for run in runs:
        groups[labels[run.number]].append(run)
    return {label: group for label, group in groups.items() if group}


def values_of(key: str, runs: Iterable[Done]) -> list[float]:
    """Return the values of a numeric figure in ascending order, with infinite values last."""
    values = (run.figures.get(key) for run in runs)
    return sorted(float(value) for value in values if isinstance(value, (int, float)) and value == value)


def true_force(run: Done) -> float:
    """Return the largest true force of a run, N; 0 if the run does not have this figure."""
    force = run.figures.get(FORCE)
    return float(force) if isinstance(force, (int, float)) else 0.0


def bound_of(run: Done) -> float | None:
    """Return the bound of the true force of a run with its faults, N; None if it has none."""
    beyond = run.figures.get("force_beyond_n")
    return true_force(run) - beyond if isinstance(beyond, float) and math.isfinite(beyond) else None


def share_of_bound(run: Done) -> float:
    """Return the largest true force of a run as a share of its bound with its faults; 0 if it has no bound."""
    bound = bound_of(run)
    return true_force(run) / bound if bound else 0.0


def most_missed(plan: Plan, runs: Iterable[Done]) -> tuple[int, Criterion | None]:
    """Return the criterion that most failed runs did not meet, and their number; 0 and None if there is none."""
    failed = [run for run in runs if not run.passed]
    missed = [(sum(one.judge(run.figures) is False for run in failed), one) for one in plan.criteria]
    count, criterion = max(missed, key=itemgetter(0), default=(0, None))
    return (count, criterion) if count else (0, None)


def true_force_text(plan: Plan, run: Done) -> str:
    """Format the largest true force of a run with its unit, so that the text agrees with the criteria on it."""
    return value_text(FORCE, true_force(run), plan.criteria)


def worst_first(criteria: Sequence[Criterion], runs: Iterable[Done]) -> list[Done]:
    """Return the failed runs, worst first: bugs, then by number of unmet criteria, by the largest relative distance
    from a bound, and by true force.
    """

    def rank(run: Done) -> tuple[bool, int, float, float]:
        excess = max((one.excess(run.figures) for one in criteria), default=0.0)
        return run.outcome != "error", -len(run.failed), -excess, -true_force(run)

    return sorted((run for run in runs if not run.passed), key=rank)


def unmet_by(plan: Plan, run: Done) -> tuple[Unmet, ...]:
    """Return the criteria that a run did not meet, with the values of the run."""
    return unmet_of(plan.criteria, run.figures)


def _failed(plan: Plan, run: Done) -> FailedRun:
    case, force = plan.cases[run.number], run.figures.get(FORCE)
    return FailedRun(
        run.key,
        run.seed,
        case.cell,
        faults_of_run(case, run),
        run.outcome,
        run.cause,
        unmet_by(plan, run),
        float(force) if isinstance(force, (int, float)) else None,
        run.recording,
    )
