"""Runs of one point of the space in virtual time, and their score."""

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
from hil_bridge.settings.configuration import read_config

FAILURE = "failure"
"""Beside the figures of a run that raised an error: the error in words."""


@dataclass(frozen=True, slots=True)
class Goal:
    """The goal of a search."""

    weights: Mapping[str, float]
    """Weight of each figure that is to be small."""
    force_limit_n: float
    """A run whose true force is above it counts as failed."""
    scales: Mapping[str, float]
    """The figures of the defaults: a score of 1 is as good as they are."""

    def score(self, figures: Figures) -> float | None:
        """Score of a run, the less the better; None for one that failed."""
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
        """Why a run failed; empty where it did not."""
        if figures["outcome"] != "completed":
            return figure_text(figures.get(FAILURE) or figures["outcome"])
        force = figures.get("force_true_max_n")
        if force is not None and not _number(force) <= self.force_limit_n:  # one that is no number too
            return f"a true force of {_number(force):.1f} N"
        missing = [name for name in self.weights if figures.get(name) is None]
        if missing:
            return f"no {missing[0]}"
        endless = [name for name in self.weights if not math.isfinite(_number(figures[name]))]
        return f"{endless[0]} is {_number(figures[endless[0]])}" if endless else ""


@dataclass(frozen=True, slots=True)
class Worth:
    """A point, and what its runs gave, seed by seed."""

    point: Point
    runs: tuple[Figures, ...]
    scores: tuple[float | None, ...]
    failures: tuple[str, ...]
    """Why runs failed, without those that did not."""
    cells: tuple["Worth", ...] = ()
    """The same cell by cell, where it was tried in several."""

    @property
    def feasible(self) -> bool:
        """No run failed."""
        return not self.failures

    @property
    def score(self) -> float:
        """Mean of its scores plus the standard error: luck with one seed is no merit. Of a point that failed: above
        all others, the more runs failed.
        """
        if self.failures:
            return 1e3 * (1.0 + len(self.failures) / len(self.runs))
        if self.cells:
            return statistics.fmean(cell.score for cell in self.cells)
        scores = [score for score in self.scores if score is not None]
        error = statistics.stdev(scores) / math.sqrt(len(scores)) if len(scores) > 1 else 0.0
        return statistics.fmean(scores) + error

    def mean(self, figure: str) -> float | None:
        """Mean of a figure over the runs that have it; of several cells, all runs together."""
        values = self.values(figure)
        return statistics.fmean(values) if values else None

    def spread(self, figure: str) -> float:
        """Standard deviation of a figure over the seeds, of several cells their mean; 0 with one run."""
        if self.cells:
            return statistics.fmean(cell.spread(figure) for cell in self.cells)
        values = self.values(figure)
        return statistics.stdev(values) if len(values) > 1 else 0.0

    def values(self, figure: str) -> list[float]:
        """A figure of each run that has it."""
        return [_number(run[figure]) for run in self.runs if run.get(figure) is not None]


def together(cells: Sequence[Worth]) -> Worth:
    """A point in several cells as one: it fails where it fails in one of them."""
    if len(cells) == 1:
        return cells[0]
    return Worth(
        cells[0].point,
        tuple(run for cell in cells for run in cell.runs),
        tuple(score for cell in cells for score in cell.scores),
        tuple(text for cell in cells for text in cell.failures),
        tuple(cells),
    )


def _number(value: Any) -> float:
    return float(value)


def worth(goal: Goal, point: Point, runs: Sequence[Figures]) -> Worth:
    """A point with its runs, judged."""
    failures = tuple(text for figures in runs if (text := goal.failure(figures)))
    return Worth(point, tuple(runs), tuple(map(goal.score, runs)), failures)


def scales_of(weights: Mapping[str, float], runs: Sequence[Figures]) -> dict[str, float]:
    """Scales by the mean figures of the defaults, not below their `least`. Raises ConfigError where none is known."""
    found = {}
    for name in weights:
        if name not in TUNED:
            raise ConfigError(f"--minimise {name}: no figure to be tuned for; choose from {', '.join(TUNED)}")
        values = [abs(_number(run[name])) for run in runs if run.get(name) is not None]
        found[name] = max(statistics.fmean(values) if values else 0.0, FIGURES[name].least or 0.0)
    return found


# --- runs in processes


@dataclass(frozen=True, slots=True)
class Job:
    """A run: the whole configuration as JSON, what is laid over its controller's parameters, and a seed."""

    config: str
    parameters: str
    seed: int


def figures_of(job: Job) -> Figures:
    """Figures of a run; a bug is one that failed."""
    values = json.loads(job.config)
    values["controller"]["parameters"] |= json.loads(job.parameters)
    values["run"]["seed"] = job.seed
    try:
        return run(read_config(values)).figures
    except Exception as error:  # one point that makes no sense must not lose the others
        return {
            "outcome": "error",
            FAILURE: f"{type(error).__name__}: {one_line(str(error))[:200]}",
        }


Runs = Callable[[Sequence[Job]], list[Figures]]
"""Does runs, and gives their figures in the same order."""


@contextmanager
def running(workers: int, advance: Callable[[], object]) -> Iterator[Runs]:
    """Does runs in so many processes, in this one with a single worker; `advance` is called after each.

    Leaving it early ends the processes. What comes back does not depend on their number.
    """
    with own_processes(workers) as pool:
        # One at a time: a generation is as slow as the last of its runs.
        yield lambda jobs: in_order(pool, figures_of, jobs, lambda count: advance(), chunk=1)
