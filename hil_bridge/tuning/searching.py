"""The search: SciPy's differential evolution, whole generations at once, with the same seeds for every point."""

import json
import math
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from hil_bridge.campaign.criteria import Figures
from hil_bridge.errors import ConfigError
from hil_bridge.settings.configuration import Config, dump
from hil_bridge.tuning.evaluating import Goal, Job, Runs, Worth, scales_of, worth
from hil_bridge.tuning.space import Point, Space

FINALISTS = 3
"""Chosen: so many of the best points meet the defaults again on fresh seeds."""
FRESH = 2
"""Chosen: fresh seeds for the finalists, for each of those of the search."""
_FRESH_FROM = 1_000_000
"""Fresh seeds begin so far behind those of the search."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """A search."""

    space: Space
    weights: dict[str, float]
    force_limit_n: float
    seeds: tuple[int, ...]
    budget: int
    """Most runs, those of the defaults and of the finalists included."""
    seed: int
    """Of the optimiser's draws."""

    @property
    def fresh(self) -> tuple[int, ...]:
        """Seeds that the search does not see."""
        return tuple(_FRESH_FROM + self.seed * 1000 + number for number in range(FRESH * len(self.seeds)))

    @property
    def points(self) -> int:
        """Points that the search may try beside the defaults. Raises ConfigError where that makes no search."""
        of_finalists = (FINALISTS + 1) * len(self.fresh)
        points = (self.budget - of_finalists) // len(self.seeds) - 1
        least = self.population
        if points < least:
            need = of_finalists + (least + 1) * len(self.seeds)
            raise ConfigError(
                f"--budget {self.budget}: with {len(self.seeds)} seeds a search takes {need} runs or more"
            )
        return points

    @property
    def population(self) -> int:
        """Points of a generation. Chosen: five for each parameter, which is what differential evolution needs."""
        return max(5, 5 * len(self.space.parameters))


@dataclass
class Search:
    """A search and what it has found so far."""

    config: str
    """The configuration as JSON, with the defaults."""
    wanted: Wanted
    goal: Goal
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


def begin(config: Config, wanted: Wanted, runs: Runs) -> Search:
    """Measure the defaults, against which all is weighed. Raises ConfigError for a figure that is none."""
    scales_of(wanted.weights, [])
    wanted.points  # noqa: B018  its refusal comes before the first run
    text = dump(config)
    found = runs(jobs_of(text, {}, wanted.seeds))
    broken = next((one["outcome"] for one in found if ":" in str(one["outcome"])), None)
    if broken is not None:
        raise ConfigError(f"the configuration cannot be run: {broken}")
    goal = Goal(wanted.weights, wanted.force_limit_n, scales_of(wanted.weights, found))
    return Search(text, wanted, goal, worth(goal, wanted.space.start or (), found))


class _Spent(Exception):
    """The budget is spent."""


def search(state: Search, runs: Runs) -> None:
    """Try points until the budget is spent or the points are alike, then let the best meet fresh seeds."""
    from scipy.optimize import differential_evolution

    wanted = state.wanted
    space, known = wanted.space, dict[Point, Worth]()

    def evaluated(function: Callable[[Any], float], generation: Iterable[Any]) -> list[float]:
        points = [space.point(each) for each in generation]
        new = [point for point in dict.fromkeys(points) if point not in known]
        left = wanted.points - len(state.tried)
        for one in _tried(state, new[:left], wanted.seeds, runs):
            known[one.point] = one
            state.tried.append(one)
        if len(new) > left:
            raise _Spent
        return [known[point].score for point in points]

    start = space.start
    with suppress(_Spent):
        differential_evolution(
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
    found = runs(jobs_of(state.config, {}, fresh))
    state.defaults_fresh = worth(state.goal, state.defaults.point, found)
    if good:
        finals = _tried(state, [one.point for one in good], fresh, runs)
        state.finals = sorted(finals, key=lambda one: one.score)


def _tried(state: Search, points: Sequence[Point], seeds: Sequence[int], runs: Runs) -> list[Worth]:
    space = state.wanted.space
    jobs = [job for point in points for job in jobs_of(state.config, space.table(point), seeds)]
    found: list[Figures] = runs(jobs)
    count = len(seeds)
    return [
        worth(state.goal, point, found[number * count : (number + 1) * count])
        for number, point in enumerate(points)
    ]
