"""Runs of a campaign done again, beside the figures that the campaign keeps of them."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
from msgspec import Struct

from hil_bridge.errors import ConfigError
from hil_bridge.lab.campaign.comparison import Difference, differences
from hil_bridge.lab.campaign.criteria import Figures
from hil_bridge.lab.campaign.judging import Job, Ran, attempt
from hil_bridge.lab.campaign.plan import Plan
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

    @property
    def lines(self) -> Iterator[str]:
        """For people."""
        case = f"{self.key}: seed {self.seed}, {self.cell}, fault {self.fault} {self.phase}"
        yield case.rstrip()
        yield f"  {self.outcome}{self.cause and f', {self.cause}'}"
        yield from (f"  differs: {one.text}" for one in self.differences)
        if self.recording:
            yield f"  {self.recording}"


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


def job_again(plan: Plan, done: Done) -> Job:
    """The job whose run this was."""
    return Job(done.key, done.number, plan.cases[done.number].config, done.table, done.seed)


def compare_run(plan: Plan, done: Done, ran: Ran, recording: str = "") -> RepeatedRun:
    """A run as it went now beside the one that the campaign keeps."""
    case = plan.cases[done.number]
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
    )


@dataclass(frozen=True, slots=True)
class Repeat:
    """A run that is to be done again."""

    job: Job
    figures: Figures
    """Figures that it had."""
    recording: Path | None = None
    """Its recording from then, with which every cycle is compared."""
    save: Path | None = None
    """Where its recording goes now."""


class CheckedRun(Struct, frozen=True):
    """A run that was done again, beside what is kept of it."""

    key: str
    seed: int
    differences: tuple[Difference, ...]
    """Figures that are not the same."""
    cycles: int | None
    """Control cycles that were compared with its recording; None where it has none."""
    cycle: int | None
    """The first of them that is not the same; None where all are."""
    fields: tuple[str, ...] = ()
    """Names of the values that differ in this cycle."""

    @property
    def equal(self) -> bool:
        """Nothing differs, to the last bit."""
        return not self.differences and self.cycle is None

    @property
    def lines(self) -> Iterator[str]:
        """For people; none where it is equal."""
        name = f"  seed {self.seed}, run {self.key}"
        if self.differences:
            yield f"{name}: {'; '.join(one.text for one in self.differences)}"
        if self.cycle is not None:
            yield f"{name}: its recording differs from cycle {self.cycle} on: {', '.join(self.fields)}"


def repeat_runs(repeats: Sequence[Repeat], advance: Callable[[int, int], object]) -> list[CheckedRun]:
    """Do runs again on all cores; what came of them, by seed and key."""
    checked: list[CheckedRun] = []
    with own_processes(jobs=len(repeats)) as pool:
        for chunk in as_completed(pool, _repeat, repeats):
            checked += chunk.results
            advance(len(chunk.results), sum(not run.equal for run in chunk.results))
    return sorted(checked, key=lambda run: (run.seed, run.key))


def _repeat(repeat: Repeat) -> CheckedRun:
    job, ran = repeat.job, attempt(repeat.job)
    cycles = () if ran.result is None else ran.result.cycles
    if repeat.save is not None and ran.result is not None:
        ran.result.save(repeat.save)
    other = tuple(differences(repeat.figures, ran.figures))
    if repeat.recording is None:
        return CheckedRun(job.key, job.seed, other, None, None)
    try:
        before = read(repeat.recording).cycles
    except ConfigError:
        return CheckedRun(job.key, job.seed, other, 0, 0, ("it cannot be read",))
    count = max(len(before), len(cycles))
    return CheckedRun(job.key, job.seed, other, count, *_first_difference(before, cycles))


def _first_difference(
    before: Sequence[CycleRecord], after: Sequence[CycleRecord]
) -> tuple[int | None, tuple[str, ...]]:
    """Number of the first cycle that is not the same to the last bit, and the names of its values that differ."""
    for number, (one, other) in enumerate(zip(before, after, strict=False)):
        if msgspec.json.encode(one) != msgspec.json.encode(other):
            old, new = msgspec.to_builtins(one), msgspec.to_builtins(other)
            return number, tuple(name for name in old | new if repr(old.get(name)) != repr(new.get(name)))
    if len(before) != len(after):
        return min(len(before), len(after)), ("the number of cycles",)
    return None, ()
