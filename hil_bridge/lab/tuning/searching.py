"""Search by SciPy's differential evolution, one generation at a time, with the same seeds for every point."""

import json
import math
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from hil_bridge.errors import ConfigError
from hil_bridge.lab.campaign.criteria import Figures
from hil_bridge.lab.optimiser import optimiser
from hil_bridge.lab.tuning.evaluating import (
    FAILURE,
    Evaluation,
    Goal,
    Job,
    Runs,
    combine_cells,
    evaluate,
    scales_of,
)
from hil_bridge.lab.tuning.space import Point, Space
from hil_bridge.settings.configuration import Config, dump

FINALISTS = 3
"""Number of best points that are compared with the defaults on fresh seeds. Chosen."""
FRESH = 2
"""Number of fresh seeds for the finalists, per seed of the search. Chosen."""
_FRESH_FROM = 1_000_000
"""Offset that separates the fresh seeds from the seeds of the search."""


@dataclass(frozen=True, slots=True)
class SearchPlan:
    """Parameters of a search. Raises ConfigError for a budget that is too small."""

    space: Space
    weights: dict[str, float]
    force_limit_n: float
    seeds: tuple[int, ...]
    budget: int
    """Maximum number of runs, including the runs of the defaults and of the finalists."""
    seed: int
    """Seed of the optimiser."""
    cells: int = 1
    """Number of cells in which each point is tried."""

    def __post_init__(self) -> None:
        if self.points < self.population:
            least = self.of_finalists + (self.population + 1) * len(self.seeds) * self.cells
            raise ConfigError(
                f"--budget {self.budget}: a search with {len(self.seeds)} seeds needs at least {least} runs"
            )

    @property
    def fresh(self) -> tuple[int, ...]:
        """Fresh seeds, which the search does not use."""
        return tuple(_FRESH_FROM + self.seed * 1000 + number for number in range(FRESH * len(self.seeds)))

    @property
    def points(self) -> int:
        """Number of points that the search may try in addition to the defaults."""
        return (self.budget - self.of_finalists) // (len(self.seeds) * self.cells) - 1

    @property
    def of_finalists(self) -> int:
        """Number of runs on fresh seeds that are reserved for the finalists and the defaults."""
        return (FINALISTS + 1) * len(self.fresh) * self.cells

    @property
    def population(self) -> int:
        """Number of points in a generation. Chosen: five per parameter, as differential evolution requires."""
        return max(5, 5 * len(self.space.parameters))


@dataclass
class Search:
    """State of a search, and its results so far."""

    configs: tuple[str, ...]
    """Configuration of each cell with the default parameters, as JSON."""
    plan: SearchPlan
    goals: tuple[Goal, ...]
    """Goal in each cell, scaled by the figures of the defaults in that cell."""
    defaults: Evaluation
    tried: list[Evaluation] = field(default_factory=list)
    """All points so far, in the order in which they were tried."""
    finals: list[Evaluation] = field(default_factory=list)
    """Evaluations of the finalists on fresh seeds, best first."""
    defaults_fresh: Evaluation | None = None

    @property
    def best(self) -> Evaluation | None:
        """Best feasible point so far, or None."""
        feasible = [one for one in self.finals or self.tried if one.feasible]
        return min(feasible, key=lambda one: one.score, default=None)


def jobs_of(config: str, parameters: dict[str, Any], seeds: Sequence[int]) -> list[Job]:
    """Return one run for each seed."""
    return [Job(config, json.dumps(parameters), seed) for seed in seeds]


def begin(configs: Sequence[Config], plan: SearchPlan, runs: Runs) -> Search:
    """Start a search: evaluate the defaults in each cell, as its reference.

    Raises ConfigError for an unknown figure, and for a cell that cannot be run.
    """
    scales_of(plan.weights, [])
    plan.points  # noqa: B018  raises before the first run
    texts = tuple(map(dump, configs))
    optimiser()  # raises before the first run
    goals, defaults = [], []
    for figures in _by_cell(texts, {}, plan.seeds, runs):
        failure = next((one[FAILURE] for one in figures if FAILURE in one), None)
        if failure is not None:
            raise ConfigError(f"the configuration cannot be run: {failure}")
        goals.append(Goal(plan.weights, plan.force_limit_n, scales_of(plan.weights, figures)))
        defaults.append(evaluate(goals[-1], plan.space.start or (), figures))
    return Search(texts, plan, tuple(goals), combine_cells(defaults))


def _by_cell(
    configs: Sequence[str], parameters: dict[str, Any], seeds: Sequence[int], runs: Runs
) -> list[list[Figures]]:
    figures = runs([job for config in configs for job in jobs_of(config, parameters, seeds)])
    return [figures[at : at + len(seeds)] for at in range(0, len(figures), len(seeds))]


class _BudgetExhausted(Exception):
    """Signal that the budget of runs is exhausted."""


def search(state: Search, runs: Runs) -> None:
    """Try points until the budget is exhausted or the points converge. Then evaluate the best points on fresh seeds."""
    minimise, plan = optimiser(), state.plan
    space, known = plan.space, dict[Point, Evaluation]()

    def evaluated(function: Callable[[Any], float], generation: Iterable[Any]) -> list[float]:
        points = [space.point(each) for each in generation]
        new = [point for point in dict.fromkeys(points) if point not in known]
        left = plan.points - len(state.tried)
        for one in _try_points(state, new[:left], plan.seeds, runs):
            known[one.point] = one
            state.tried.append(one)
        if len(new) > left:
            raise _BudgetExhausted
        return [known[point].score for point in points]

    start = space.start
    with suppress(_BudgetExhausted):
        minimise(
            lambda coordinates: math.nan,
            space.bounds,
            workers=evaluated,
            updating="deferred",
            popsize=plan.population // len(space.parameters),
            maxiter=plan.points,
            tol=1e-3,
            polish=False,
            init="latinhypercube",
            seed=plan.seed,
            x0=None if start is None else space.coordinates(start),
            integrality=[parameter.whole for parameter in space.parameters],
        )
    _decide(state, runs)


def _decide(state: Search, runs: Runs) -> None:
    """Evaluate the finalists and the defaults on fresh seeds."""
    good = sorted((one for one in state.tried if one.feasible), key=lambda one: one.score)[:FINALISTS]
    fresh = state.plan.fresh
    by_cell = _by_cell(state.configs, {}, fresh, runs)
    point = state.defaults.point
    state.defaults_fresh = combine_cells(
        [evaluate(goal, point, runs_of) for goal, runs_of in zip(state.goals, by_cell, strict=True)]
    )
    if good:
        finals = _try_points(state, [one.point for one in good], fresh, runs)
        state.finals = sorted(finals, key=lambda one: one.score)


def _try_points(state: Search, points: Sequence[Point], seeds: Sequence[int], runs: Runs) -> list[Evaluation]:
    space, goals = state.plan.space, state.goals
    tables = [space.table(point) for point in points]
    jobs = [job for table in tables for config in state.configs for job in jobs_of(config, table, seeds)]
    figures = iter(runs(jobs))
    return [
        combine_cells([evaluate(goal, point, [next(figures) for _ in seeds]) for goal in goals])
        for point in points
    ]
