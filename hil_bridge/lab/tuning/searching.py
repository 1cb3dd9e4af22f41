"""The search: SciPy's differential evolution, whole generations at once, with the same seeds for every point."""

import json
import math
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from hil_bridge.errors import ConfigError
from hil_bridge.lab.campaign.criteria import Figures
from hil_bridge.lab.optimiser import optimiser
from hil_bridge.lab.tuning.evaluating import FAILURE, Goal, Job, Runs, Worth, scales_of, together, worth
from hil_bridge.lab.tuning.space import Point, Space
from hil_bridge.settings.configuration import Config, dump

FINALISTS = 3
"""Chosen: so many of the best points meet the defaults again on fresh seeds."""
FRESH = 2
"""Chosen: fresh seeds for the finalists, for each of those of the search."""
_FRESH_FROM = 1_000_000
"""Fresh seeds begin so far behind those of the search."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """A search. Raises ConfigError for a budget that makes none."""

    space: Space
    weights: dict[str, float]
    force_limit_n: float
    seeds: tuple[int, ...]
    budget: int
    """Most runs, those of the defaults and of the finalists included."""
    seed: int
    """Of the optimiser's draws."""
    cells: int = 1
    """Number of cells in which each point is tried."""

    def __post_init__(self) -> None:
        if self.points < self.population:
            least = self.of_finalists + (self.population + 1) * len(self.seeds) * self.cells
            raise ConfigError(
                f"--budget {self.budget}: with {len(self.seeds)} seeds a search takes {least} runs or more"
            )

    @property
    def fresh(self) -> tuple[int, ...]:
        """Seeds that the search does not see."""
        return tuple(_FRESH_FROM + self.seed * 1000 + number for number in range(FRESH * len(self.seeds)))

    @property
    def points(self) -> int:
        """Points that the search may try beside the defaults."""
        return (self.budget - self.of_finalists) // (len(self.seeds) * self.cells) - 1

    @property
    def of_finalists(self) -> int:
        """Runs that are kept for the finalists and the defaults, with fresh seeds."""
        return (FINALISTS + 1) * len(self.fresh) * self.cells

    @property
    def population(self) -> int:
        """Points of a generation. Chosen: five for each parameter, which is what differential evolution needs."""
        return max(5, 5 * len(self.space.parameters))


@dataclass
class Search:
    """A search and what it has found so far."""

    configs: tuple[str, ...]
    """The configurations of the cells as JSON, with the defaults."""
    wanted: Wanted
    goals: tuple[Goal, ...]
    """One for each cell: each is weighed against its own defaults."""
    defaults: Worth
    tried: list[Worth] = field(default_factory=list)
    """All points, in the order of their trial."""
    finals: list[Worth] = field(default_factory=list)
    """The finalists on fresh seeds, the best first."""
    defaults_fresh: Worth | None = None

    @property
    def best(self) -> Worth | None:
        """The best point so far that no run of failed; None where there is none."""
        found = [one for one in self.finals or self.tried if one.feasible]
        return min(found, key=lambda one: one.score, default=None)


def jobs_of(config: str, parameters: dict[str, Any], seeds: Sequence[int]) -> list[Job]:
    """A run for each seed."""
    return [Job(config, json.dumps(parameters), seed) for seed in seeds]


def begin(configs: Sequence[Config], wanted: Wanted, runs: Runs) -> Search:
    """Measure the defaults in each cell, against which all is weighed.

    Raises ConfigError for a figure that is none, and for a cell that cannot be run.
    """
    scales_of(wanted.weights, [])
    wanted.points  # noqa: B018  its refusal comes before the first run
    texts = tuple(map(dump, configs))
    optimiser()  # before the first run
    goals, defaults = [], []
    for found in _by_cell(texts, {}, wanted.seeds, runs):
        broken = next((one[FAILURE] for one in found if FAILURE in one), None)
        if broken is not None:
            raise ConfigError(f"the configuration cannot be run: {broken}")
        goals.append(Goal(wanted.weights, wanted.force_limit_n, scales_of(wanted.weights, found)))
        defaults.append(worth(goals[-1], wanted.space.start or (), found))
    return Search(texts, wanted, tuple(goals), together(defaults))


def _by_cell(
    configs: Sequence[str], parameters: dict[str, Any], seeds: Sequence[int], runs: Runs
) -> list[list[Figures]]:
    found = runs([job for config in configs for job in jobs_of(config, parameters, seeds)])
    return [found[at : at + len(seeds)] for at in range(0, len(found), len(seeds))]


class _Spent(Exception):
    """The budget is spent."""


def search(state: Search, runs: Runs) -> None:
    """Try points until the budget is spent or the points are alike, then let the best meet fresh seeds."""
    minimise, wanted = optimiser(), state.wanted
    space, known = wanted.space, dict[Point, Worth]()

    def evaluated(function: Callable[[Any], float], generation: Iterable[Any]) -> list[float]:
        points = [space.point(each) for each in generation]
        new = [point for point in dict.fromkeys(points) if point not in known]
        left = wanted.points - len(state.tried)
        for one in _try_points(state, new[:left], wanted.seeds, runs):
            known[one.point] = one
            state.tried.append(one)
        if len(new) > left:
            raise _Spent
        return [known[point].score for point in points]

    start = space.start
    with suppress(_Spent):
        minimise(
            lambda coordinates: math.nan,
            space.bounds,
            workers=evaluated,
            updating="deferred",
            popsize=wanted.population // len(space.parameters),
            maxiter=wanted.points,
            tol=1e-3,
            polish=False,
            init="latinhypercube",
            seed=wanted.seed,
            x0=None if start is None else space.coordinates(start),
            integrality=[parameter.whole for parameter in space.parameters],
        )
    _decide(state, runs)


def _decide(state: Search, runs: Runs) -> None:
    """The finalists and the defaults on fresh seeds."""
    good = sorted((one for one in state.tried if one.feasible), key=lambda one: one.score)[:FINALISTS]
    fresh = state.wanted.fresh
    found = _by_cell(state.configs, {}, fresh, runs)
    point = state.defaults.point
    state.defaults_fresh = together(
        [worth(goal, point, runs_of) for goal, runs_of in zip(state.goals, found, strict=True)]
    )
    if good:
        finals = _try_points(state, [one.point for one in good], fresh, runs)
        state.finals = sorted(finals, key=lambda one: one.score)


def _try_points(state: Search, points: Sequence[Point], seeds: Sequence[int], runs: Runs) -> list[Worth]:
    space, goals = state.wanted.space, state.goals
    tables = [space.table(point) for point in points]
    jobs = [job for table in tables for config in state.configs for job in jobs_of(config, table, seeds)]
    found = iter(runs(jobs))
    return [
        together([worth(goal, point, [next(found) for _ in seeds]) for goal in goals]) for point in points
    ]
