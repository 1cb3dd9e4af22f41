"""Repetition of campaign runs, and comparison with the figures stored in the campaign's results."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

import msgspec
from msgspec import Struct

from hil_bridge.errors import ConfigError
from hil_bridge.lab.campaign.comparison import Difference, differences
from hil_bridge.lab.campaign.judging import Job, RunFigures, attempt
from hil_bridge.lab.campaign.plan import Case, Plan
from hil_bridge.lab.campaign.store import Done, Store
from hil_bridge.lab.processes import as_completed, own_processes
from hil_bridge.record import CycleRecord, read


class RepeatedRun(Struct, frozen=True):
    """Repeated run, with its differences from the run in the campaign."""

    key: str
    seed: int
    cell: str
    fault: str
    phase: str
    outcome: str
    """Outcome of the repeated run."""
    cause: str
    differences: tuple[Difference, ...]
    """Figures whose values differ from the campaign."""
    recording: str = ""
    """Path of the new recording; empty if none was saved."""
    order: tuple[str, ...] = ()
    """Fewest callbacks that must change places for the run to differ, as text; empty unless it broke `order-equal`."""
    cycle: int | None = None
    """Number of the first cycle that differs from the old recording; None if no cycle differs, or there is no old
    recording.
    """

    @property
    def equal(self) -> bool:
        """Whether the repeated run is identical to the original one in every bit."""
        return not self.differences and self.cycle is None

    @property
    def lines(self) -> Iterator[str]:
        """Repeated run as text for the terminal, line by line."""
        case = f"{self.key}: seed {self.seed}, {self.cell}, fault {self.fault} {self.phase}"
        yield case.rstrip()
        yield f"  {self.outcome}{self.cause and f', {self.cause}'}"
        yield from (f"  differs: {one.text}" for one in self.differences)
        yield from (f"  order: {one}" for one in self.order)
        if self.cycle is not None:
            yield f"  differs: the recording, from cycle {self.cycle} on"
        if self.recording:
            yield f"  {self.recording}"


@dataclass(frozen=True, slots=True)
class RepeatJob:
    """Run to be repeated."""

    case: Case
    done: Done
    job: Job
    recording: Path | None = None
    """Old recording of the run, with which every cycle is compared, or None."""
    save: Path | None = None
    """Path for the new recording; None to save none."""


def select_runs(store: Store, key: str | None, seed: int | None) -> list[Done]:
    """Return the run whose key begins with `key`, or all runs of a seed.

    Raises ConfigError unless exactly one of `key` and `seed` is given, if there is no such run, and for an
    ambiguous key.
    """
    if (key is None) == (seed is None):
        raise ConfigError("give either the KEY of a run or --seed N")
    if seed is not None:
        runs = list(store.runs("seed = ?", [seed]))
        selection = f"seed {seed}"
    else:
        runs = list(store.runs("substr(key, 1, length(?1)) = ?1", [key]))
        selection = f"the key {key}"
    if not runs:
        raise ConfigError(f"{store.path} has no run with {selection}")
    if seed is None and len(runs) > 1:
        raise ConfigError(f"{store.path} has {len(runs)} runs whose keys begin with {key}; give a longer key")
    return runs


def repeat_of(plan: Plan, done: Done) -> RepeatJob:
    """Return the job that repeats a run with the configuration of its case."""
    case = plan.cases[done.number]
    return RepeatJob(case, done, Job(done.key, done.number, case.config, done.table, done.seed))


def compare_run(
    repeat: RepeatJob, new: RunFigures, recording: str = "", order: tuple[str, ...] = ()
) -> RepeatedRun:
    """Compare a repeated run with that in the results. `order` describes the callbacks that changed it."""
    case, done = repeat.case, repeat.done
    return RepeatedRun(
        done.key,
        done.seed,
        case.cell,
        case.fault,
        case.phase,
        str(new.figures["outcome"]),
        new.cause,
        tuple(differences(done.figures, new.figures)),
        recording,
        order,
        _first_difference(repeat.recording, () if new.result is None else new.result.cycles),
    )


def repeat_runs(repeats: Sequence[RepeatJob], advance: Callable[[int, int], object]) -> list[RepeatedRun]:
    """Repeat runs on all cores; return the runs that differ, sorted by seed and key."""
    differing: list[RepeatedRun] = []
    with own_processes(jobs=len(repeats)) as pool:
        for chunk in as_completed(pool, _repeat, repeats):
            others = [run for run in chunk.results if not run.equal]
            differing += others
            advance(len(chunk.results), len(others))
    return sorted(differing, key=lambda run: (run.seed, run.key))


def _repeat(repeat: RepeatJob) -> RepeatedRun:
    new = attempt(repeat.job)
    if repeat.save is not None and new.result is not None:
        new.result.save(repeat.save)
    return compare_run(repeat, new)


def _first_difference(recording: Path | None, cycles: Sequence[CycleRecord]) -> int | None:
    """Return the number of the first cycle that differs from a recording in any bit; 0 for an unreadable recording."""
    if recording is None:
        return None
    try:
        before = read(recording).cycles
    except ConfigError:
        return 0
    pairs = enumerate(zip_longest(before, cycles))
    return next((k for k, pair in pairs if len({msgspec.json.encode(one) for one in pair}) > 1), None)
