"""Evaluation of a point in the search space: runs in virtual time, and their score."""

import json
import math
import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from hil_bridge.errors import ConfigError
from hil_bridge.errors.failures import one_line
from hil_bridge.lab.campaign.criteria import Figures, figure_text
from hil_bridge.lab.campaign.judging import run
from hil_bridge.lab.processes import in_order, own_processes
from hil_bridge.lab.tuning.space import Point
from hil_bridge.record.analysis.figures import FIGURES, TUNED
from hil_bridge.record.kept import READ_RECORDS
from hil_bridge.settings.configuration import read_config

FAILURE = "failure"
"""Key of the error message in the figures of a run that raised an error."""


@dataclass(frozen=True, slots=True)
class Goal:
    """Goal of a search: the figures to minimise, and a limit of the force."""

    weights: Mapping[str, float]
    """Weight of each figure to minimise."""
    force_limit_n: float
    """Limit of the true force, N. A run that exceeds it counts as failed."""
    scales: Mapping[str, float]
    """Scale of each figure: its mean for the defaults. A score of 1 is therefore as good as the defaults."""

    def score(self, figures: Figures) -> float | None:
        """Return the score of a run; lower is better. None for a failed run."""
        if self.failure(figures):
            return None
        total = sum(self.weights.values())
        return (
            sum(
                weight * abs(_number(figures[name])) / self.scales[name]
                for name, weight in self.weights.items()
            )
            / total
        )

    def failure(self, figures: Figures) -> str:
        """Return the reason why a run failed; empty if it did not."""
        if figures["outcome"] != "completed":
            return figure_text(figures.get(FAILURE) or figures["outcome"])
        force = figures.get("force_true_max_n")
        if force is not None and not _number(force) <= self.force_limit_n:  # NaN fails too
            return f"a true force of {_number(force):.1f} N"
        missing = [name for name in self.weights if figures.get(name) is None]
        if missing:
            return f"no {missing[0]}"
        endless = [name for name in self.weights if not math.isfinite(_number(figures[name]))]
        return f"{endless[0]} is {_number(figures[endless[0]])}" if endless else ""


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Point of the search space with the results of its runs, by seed."""

    point: Point
    runs: tuple[Figures, ...]
    scores: tuple[float | None, ...]
    failures: tuple[str, ...]
    """Reason of each failed run."""
    cells: tuple["Evaluation", ...] = ()
    """Evaluation in each cell, if the point was tried in several cells."""

    @property
    def feasible(self) -> bool:
        """Whether no run failed."""
        return not self.failures

    @property
    def score(self) -> float:
        """Score of the point; lower is better.

        It is the mean score of the runs plus the standard error of the mean, so that luck with one seed does not
        pay. A point with failed runs scores above all others, and its score increases with the share of failed
        runs.
        """
        if self.failures:
            return 1e3 * (1.0 + len(self.failures) / len(self.runs))
        if self.cells:
            return statistics.fmean(cell.score for cell in self.cells)
        scores = [score for score in self.scores if score is not None]
        error = statistics.stdev(scores) / math.sqrt(len(scores)) if len(scores) > 1 else 0.0
        return statistics.fmean(scores) + error

    def mean(self, figure: str) -> float | None:
        """Return the mean of a figure over the runs of all cells that have the figure; None if no run has it."""
        values = self.values(figure)
        return statistics.fmean(values) if values else None

    def spread(self, figure: str) -> float:
        """Return the standard deviation of a figure over the seeds, averaged over the cells; 0 for a single run."""
        if self.cells:
            return statistics.fmean(cell.spread(figure) for cell in self.cells)
        values = self.values(figure)
        return statistics.stdev(values) if len(values) > 1 else 0.0

    def values(self, figure: str) -> list[float]:
        """Return the figure of each run that has the figure."""
        return [_number(run[figure]) for run in self.runs if run.get(figure) is not None]


def combine_cells(cells: Sequence[Evaluation]) -> Evaluation:
    """Combine the evaluations of a point in several cells. The point fails if it fails in any cell."""
    if len(cells) == 1:
        return cells[0]
    return Evaluation(
        cells[0].point,
        tuple(run for cell in cells for run in cell.runs),
        tuple(score for cell in cells for score in cell.scores),
        tuple(text for cell in cells for text in cell.failures),
        tuple(cells),
    )


def _number(value: Any) -> float:
    return float(value)


def evaluate(goal: Goal, point: Point, runs: Sequence[Figures]) -> Evaluation:
    """Evaluate a point from the figures of its runs."""
    failures = tuple(text for figures in runs if (text := goal.failure(figures)))
    return Evaluation(point, tuple(runs), tuple(map(goal.score, runs)), failures)


def scales_of(weights: Mapping[str, float], runs: Sequence[Figures]) -> dict[str, float]:
    """Return the scale of each figure: its mean for the defaults, but at least the `least` of the figure.

    Raises ConfigError for an unknown figure.
    """
    scales = {}
    for name in weights:
        if name not in TUNED:
            raise ConfigError(f"--minimise {name}: not a figure for tuning; known: {', '.join(TUNED)}")
        values = [abs(_number(run[name])) for run in runs if run.get(name) is not None]
        scales[name] = max(statistics.fmean(values) if values else 0.0, FIGURES[name].least or 0.0)
    return scales


# --- runs in processes


@dataclass(frozen=True, slots=True)
class Job:
    """Run to be executed: the complete configuration and overrides of the controller's parameters, both as JSON,
    and a seed.
    """

    config: str
    parameters: str
    seed: int


def figures_of(job: Job) -> Figures:
    """Execute a run and return its figures. A run that raises an error counts as failed."""
    values = json.loads(job.config)
    values["controller"]["parameters"] |= json.loads(job.parameters)
    values["run"]["seed"] = job.seed
    try:
        return run(read_config(values), READ_RECORDS).figures
    except Exception as error:  # an invalid point must not lose the other points
        return {
            "outcome": "error",
            FAILURE: f"{type(error).__name__}: {one_line(str(error))[:200]}",
        }


Runs = Callable[[Sequence[Job]], list[Figures]]
"""Function that executes runs and returns their figures in the order of the runs."""


@contextmanager
def running(workers: int, advance: Callable[[], object]) -> Iterator[Runs]:
    """Provide a function that executes runs in `workers` processes, or in this process for one worker.

    `advance` is called after each run. Leaving the context early ends the processes. The results do not depend on
    the number of processes.
    """
    with own_processes(workers) as pool:
        # Chunks of one: a generation is as slow as its last run.
        yield lambda jobs: in_order(pool, figures_of, jobs, lambda count: advance(), chunk=1)
