"""Runs of a campaign done again, beside the figures that the campaign keeps of them."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

import msgspec
from msgspec import Struct

from hil_bridge.errors import ConfigError
from hil_bridge.lab.campaign.comparison import Difference, differences
from hil_bridge.lab.campaign.judging import Job, Ran, attempt
from hil_bridge.lab.campaign.plan import Case, Plan
from hil_bridge.lab.campaign.store import Done, Store
from hil_bridge.lab.processes import as_completed, own_processes
from hil_bridge.record import CycleRecord, read


class RepeatedRun(Struct, frozen=True):
    """A run that was done again."""

    key: str
    seed: int
    cell: str
    fault: str
    phase: str
    outcome: str
    """How it ended this time."""
    cause: str
    differences: tuple[Difference, ...]
    """Figures that are not those of the campaign."""
    recording: str = ""
    """Path of the recording that it left now; empty for none."""
    cycle: int | None = None
    """First cycle that differs from the recording of then; None where none does, or there is no such recording."""

    @property
    def equal(self) -> bool:
        """Whether nothing differs, to the last bit."""
        return not self.differences and self.cycle is None

    @property
    def lines(self) -> Iterator[str]:
        """For people."""
        case = f"{self.key}: seed {self.seed}, {self.cell}, fault {self.fault} {self.phase}"
        yield case.rstrip()
        yield f"  {self.outcome}{self.cause and f', {self.cause}'}"
        yield from (f"  differs: {one.text}" for one in self.differences)
        if self.cycle is not None:
            yield f"  differs: its recording, from cycle {self.cycle} on"
        if self.recording:
            yield f"  {self.recording}"


@dataclass(frozen=True, slots=True)
class Repeat:
    """A run that is to be done again."""

    case: Case
    done: Done
    job: Job
    recording: Path | None = None
    """Its recording from then, with which every cycle is compared."""
    save: Path | None = None
    """Where its recording goes now."""


def select_runs(store: Store, key: str | None, seed: int | None) -> list[Done]:
    """The run whose key begins with these signs, or all runs of a seed.

    Raises ConfigError unless one of the two is given, where there is no such run, and where a key fits several.
    """
    if (key is None) == (seed is None):
        raise ConfigError("name either the KEY of a run or --seed N")
    if seed is not None:
        runs = list(store.runs("seed = ?", [seed]))
        wanted = f"seed {seed}"
    else:
        runs = list(store.runs("substr(key, 1, length(?1)) = ?1", [key]))
        wanted = f"the key {key}"
    if not runs:
        raise ConfigError(f"{store.path} has no run with {wanted}")
    if seed is None and len(runs) > 1:
        raise ConfigError(f"{store.path} has {len(runs)} runs whose keys begin with {key}; give more of it")
    return runs


def repeat_of(plan: Plan, done: Done) -> Repeat:
    """The run that is to be done again, with the settings of its case."""
    case = plan.cases[done.number]
    return Repeat(case, done, Job(done.key, done.number, case.config, done.table, done.seed))


def compare_run(repeat: Repeat, ran: Ran, recording: str = "") -> RepeatedRun:
    """A run as it went now beside the one that the campaign keeps."""
    case, done = repeat.case, repeat.done
    return RepeatedRun(
        done.key,
        done.seed,
        case.cell,
        case.fault,
        case.phase,
        str(ran.figures["outcome"]),
        ran.cause,
        tuple(differences(done.figures, ran.figures)),
        recording,
        _first_difference(repeat.recording, () if ran.result is None else ran.result.cycles),
    )


def repeat_runs(repeats: Sequence[Repeat], advance: Callable[[int, int], object]) -> list[RepeatedRun]:
    """Do runs again on all cores; those that differ, by seed and key."""
    differing: list[RepeatedRun] = []
    with own_processes(jobs=len(repeats)) as pool:
        for chunk in as_completed(pool, _repeat, repeats):
            others = [run for run in chunk.results if not run.equal]
            differing += others
            advance(len(chunk.results), len(others))
    return sorted(differing, key=lambda run: (run.seed, run.key))


def _repeat(repeat: Repeat) -> RepeatedRun:
    ran = attempt(repeat.job)
    if repeat.save is not None and ran.result is not None:
        ran.result.save(repeat.save)
    return compare_run(repeat, ran)


def _first_difference(recording: Path | None, cycles: Sequence[CycleRecord]) -> int | None:
    """Number of the first cycle that is not the same to the last bit in a recording, which may be unreadable."""
    if recording is None:
        return None
    try:
        before = read(recording).cycles
    except ConfigError:
        return 0
    pairs = enumerate(zip_longest(before, cycles))
    return next((k for k, pair in pairs if len({msgspec.json.encode(one) for one in pair}) > 1), None)
