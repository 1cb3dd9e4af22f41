"""Fault hunt: an optimiser searches for the run that exceeds its force bound most, or breaks another promise.

SciPy's differential evolution searches the space of a campaign's draws: cell, settings, faults, times and
parameters. Every run is stored in a results file with the format of a campaign's, so that an interrupted hunt can
be resumed.
"""

import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from hil_bridge.errors import ConfigError
from hil_bridge.lab.campaign.drawing import DRAWN
from hil_bridge.lab.campaign.judging import Job, carry_out
from hil_bridge.lab.campaign.plan import Case, Plan
from hil_bridge.lab.campaign.store import Done, Store, now
from hil_bridge.lab.optimiser import optimiser
from hil_bridge.lab.processes import Chunk, as_completed, own_processes

SEED = 1
"""Seed of every run of a hunt. Everything else is varied by the optimiser."""
POPULATION = 2
"""Number of points in a generation, per dimension. Chosen: many short searches find more than one long search."""
GENERATIONS = 12
"""Number of generations after which a search restarts from new points. Chosen."""
PROMISE_N = 100.0
"""Score of each broken promise, as force beyond the bound, N. Chosen."""
BUG_N = 1000.0
"""Score of a run that ended in an exception, as force beyond the bound, N. Chosen."""
END_N = 3.0
"""Largest true force on a tool that is reported as free, N. Chosen: noise, drift and weight error together."""
NOTHING_N = -1000.0
"""Score of a run without a force bound, N."""

Advance = Callable[[int, int], object]
"""Progress callback. It receives the number of runs that ended since the last call, and the number of these runs
that broke a promise.
"""


def plan_hunt(plan: Plan) -> Plan:
    """Return the plan of a hunt over the draws of a campaign. Raises ConfigError for a plan without drawn faults."""
    if plan.draw is None or not plan.draw.most:
        raise ConfigError("the plan draws no faults; set campaign.faults_per_run for a hunt")
    cases = tuple(replace(case, fault=DRAWN) for case in plan.possible)
    return replace(plan, name=f"hunt of {plan.name}", seeds=(SEED,), cases=cases, cases_per_seed=0)


def badness(done: Done) -> float:
    """Return the score of a run, N; higher is worse.

    The score is the true force beyond the bound, which includes the additions by faults, or the true force at an
    end reported as free. Each broken promise adds PROMISE_N. A run that ended in an exception scores BUG_N.
    """
    figures = done.figures
    if done.outcome == "error":
        return BUG_N
    beyond = _number(figures.get("force_beyond_n"), NOTHING_N)
    end = _number(figures.get("force_true_end_n"), 0.0) - END_N
    if figures.get("cycles") and figures.get("retracted") and end > 0.0:
        beyond = max(beyond, end)
    broken = _number(figures.get("promises_broken"), 0.0)
    return max(beyond, 0.0) + PROMISE_N * broken if broken else beyond


def badness_voided(done: Done) -> float:
    """Return the score of a run, N, with the force bound that excludes the additions by faults."""
    force = _number(done.figures.get("force_true_max_n"), 0.0)
    bound = _number(done.figures.get("force_bound_n"), math.nan)
    return badness(done) if math.isnan(bound) else max(force - bound, badness(done))


def is_broken(done: Done) -> bool:
    """Return whether a run broke a promise, or ended in an exception."""
    return done.outcome == "error" or bool(done.figures.get("promises_broken"))


class TimeIsUp(Exception):
    """Signal that the time of the hunt is over."""


@dataclass
class Runner:
    """Executor of a hunt, which executes each run only once and stores it."""

    plan: Plan
    store: Store
    until: float
    """End of the hunt, s on the monotonic clock."""
    advance: Advance
    run: Callable[[list[Job]], Iterator[Chunk[Job, Done]]]
    """Function that executes jobs and yields their results in chunks."""
    known: dict[str, Done] = field(default_factory=dict)
    """All stored runs, by key."""

    def job(self, case: Case, table: str) -> Job:
        """Return the job of a case with `table` as an overlay of its configuration."""
        number = self.plan.cases.index(case)
        return Job(case.key(self.plan.code, SEED, table), number, case.config, table, SEED)

    def done(self, jobs: Sequence[Job]) -> list[Done]:
        """Return the runs of these jobs, in the order of the jobs. Raises TimeIsUp if time runs out while jobs are
        executed.
        """
        fresh = {job.key: job for job in jobs if job.key not in self.known}
        if fresh:
            for chunk in self.run(list(fresh.values())):
                self.store.put(chunk.results, self.plan.cases)
                self.known.update((run.key, run) for run in chunk.results)
                self.advance(len(chunk.results), sum(map(is_broken, chunk.results)))
                if time.monotonic() > self.until:
                    raise TimeIsUp
        return [self.known[job.key] for job in jobs]


@contextmanager
def running(
    plan: Plan, store: Store, workers: int, minutes: float, advance: Advance = lambda *counts: None
) -> Iterator[Runner]:
    """Provide a runner with `workers` processes. Ctrl-C in the context ends the processes at once; stored runs
    remain.
    """
    began, clock = now(), time.monotonic()
    work = partial(carry_out, criteria=plan.criteria, folder=store.folder)
    known = {done.key: done for done in store.runs()}
    before = len(known)
    try:
        with own_processes(workers) as pool:
            until = clock + minutes * 60.0
            yield Runner(plan, store, until, advance, lambda jobs: as_completed(pool, work, jobs), known)
    finally:
        if len(known) > before:
            store.add_sitting(began, time.monotonic() - clock, len(known) - before, workers)


def hunt(runner: Runner, score: Callable[[Done], float] = badness) -> Done | None:
    """Search until the time is over. Return the worst run, or None if no run was executed."""
    minimise, plan = optimiser(), runner.plan
    assert plan.draw is not None
    dimensions = 1 + plan.draw.dimensions

    def evaluated(function: Callable[[Any], float], generation: Iterable[Any]) -> list[float]:
        points = [[float(number) for number in point] for point in generation]
        return [-score(done) for done in runner.done([job_of(runner, point) for point in points])]

    with suppress(TimeIsUp):
        for number in range(1_000_000):
            minimise(
                lambda point: math.nan,
                [(0.0, 1.0)] * dimensions,
                workers=evaluated,
                updating="deferred",
                popsize=POPULATION,
                maxiter=GENERATIONS,
                polish=False,
                init="latinhypercube",
                seed=number,
            )
            if time.monotonic() > runner.until:
                break
    return max(runner.known.values(), key=score, default=None)


def job_of(runner: Runner, point: Sequence[float]) -> Job:
    """Return the job for a point of the optimiser. Its coordinates are numbers from 0 to 1; the first selects the
    cell.
    """
    cases = runner.plan.possible
    case = cases[min(int(point[0] * len(cases)), len(cases) - 1)]
    return runner.job(case, runner.plan.table_for(case, point[1:]))


def _number(value: object, default: float) -> float:
    return float(value) if isinstance(value, (int, float)) else default
