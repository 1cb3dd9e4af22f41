"""Runs of a campaign done again, beside the figures that the campaign keeps of them."""

from collections.abc import Iterator

from msgspec import Struct

from hil_bridge.errors import ConfigError
from hil_bridge.lab.campaign.comparison import Difference, differences
from hil_bridge.lab.campaign.judging import Job, Ran
from hil_bridge.lab.campaign.plan import Plan
from hil_bridge.lab.campaign.store import Done, Store


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
