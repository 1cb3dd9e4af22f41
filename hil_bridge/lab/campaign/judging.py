"""One run of a campaign: simulated, measured, judged."""

import math
import time
from dataclasses import dataclass, field
from pathlib import Path

from hil_bridge.api import BridgeError, Config, Result, Simulation, run_virtual, simulation
from hil_bridge.errors import ConfigError
from hil_bridge.lab.campaign.criteria import Criterion, Figure, find_unmet
from hil_bridge.lab.campaign.overlay import config_with
from hil_bridge.lab.campaign.store import Done
from hil_bridge.lab.campaign.striking import struck_causes, struck_faults
from hil_bridge.lab.campaign.watching import Watch, recovery_s
from hil_bridge.lab.invariants import (
    Evidence,
    broken_promises,
    judged_forces,
    stated_bound_n,
    violation_words,
)
from hil_bridge.record.analysis.summary import summarise
from hil_bridge.runs.beside import going_on

REFUSED = "refused"
"""Outcome of a run whose settings do not fit each other, or that a device refused before the movement."""


@dataclass(frozen=True, slots=True)
class Job:
    """A run that is to be done."""

    key: str
    number: int
    """Number of its case."""
    config: str
    table: str
    """The values laid over it, as JSON: a fault, or settings and faults that were drawn."""
    seed: int


@dataclass
class _Seen:
    """The rest of a run, from which it is judged."""

    simulation: Simulation | None = None
    watch: Watch | None = None
    error: BridgeError | None = None


@dataclass(frozen=True, slots=True)
class Ran:
    """A run that has ended: its figures, and its records where it had any."""

    figures: dict[str, Figure]
    cause: str
    result: Result | None = field(repr=False, default=None)


def carry_out(job: Job, criteria: tuple[Criterion, ...], folder: Path | None) -> Done:
    """Do a run and judge it. A failing one leaves its recording in `folder`, if there is one."""
    began = time.perf_counter()
    ran = attempt(job)
    broken = find_unmet(criteria, ran.figures)
    name = ""
    if broken and folder is not None and ran.result is not None:
        name = f"{job.key}.mcap"
        folder.mkdir(parents=True, exist_ok=True)
        ran.result.save(folder / name, overwrite=True)  # only the same run can have left it
    wall_s = time.perf_counter() - began
    outcome = str(ran.figures["outcome"])
    return Done(
        job.key, job.number, job.seed, outcome, ran.cause, tuple(broken), ran.figures, wall_s, name, job.table
    )


def attempt(job: Job) -> Ran:
    """Do a run; one that cannot be done, and a bug, are results too."""
    try:
        return run(configure_run(job))
    except ConfigError as error:  # settings that were drawn together and do not fit each other
        return Ran({"outcome": REFUSED, "retracted": True}, str(error))
    except Exception as error:  # no reason to lose the other runs
        lines = str(error).splitlines() or [""]
        return Ran({"outcome": "error"}, f"{type(error).__name__}: {lines[0]}")


def configure_run(job: Job) -> Config:
    """The configuration of a run, with its fault and its seed."""
    return config_with(job.config, job.table, job.seed)


def run(config: Config) -> Ran:
    """One run in virtual time, whose true force is watched. Raises ConfigError for what cannot be run."""
    seen = _Seen()

    async def main() -> None:
        try:
            async with simulation(config) as running:
                seen.simulation = running
                watch = seen.watch = Watch(running)
                try:
                    async with going_on(watch.watch(), "watch"):
                        await running.finished()
                finally:
                    watch.look()
        except BridgeError as error:  # a device refused before the movement began
            seen.error = error

    run_virtual(main)
    if seen.simulation is None:
        assert seen.error is not None
        return Ran({"outcome": REFUSED, "retracted": True}, str(seen.error))
    return _measure(seen, seen.simulation)


def _measure(seen: _Seen, running: Simulation) -> Ran:
    result = running.result
    refused = seen.error is not None
    figures: dict[str, Figure] = {
        "outcome": REFUSED if refused else result.outcome.value,
        "retracted": result.retracted,
        "cycles": len(result.cycles),
    }
    if seen.watch is not None and running.cell is not None:
        times, forces = seen.watch.truth()
        figures |= {"force_true_max_n": float(forces.max()), "force_true_end_n": float(forces[-1])}
        if faults := running.cell.faults:
            figures["struck"] = sum(fault.struck for fault in faults)
            figures["faults_struck"] = {**struck_faults(running.config, faults)}
            if figures["outcome"] == "completed":
                figures["recovery_s"] = recovery_s(result.recording, seen.watch.fault_ends(), times, forces)
        figures |= _promises(running, seen.watch)
    causes = struck_causes(result.recording)
    if seen.error is not None and seen.error.cause is not None:
        causes |= {str(seen.error.cause): 1}
    if causes:
        figures["causes"] = {**causes}
    if result.events:
        figures["duration_s"] = result.events[-1].at - result.events[0].at
    if result.cycles:
        summary = summarise(result.recording)
        figures |= {name: None if v is None or v != v else v for name, v in summary.figures.items()}
        figures["steps_failed"] = len(summary.criteria_failed)
    return Ran(figures, str(seen.error) if refused else result.text, result)


def _promises(running: Simulation, watch: Watch) -> dict[str, Figure]:
    """The promises of the guard that a run did not keep, and how far its true force was beyond the bound."""
    trace = watch.trace()
    evidence = Evidence(running.result.recording, running.config, trace)
    violations = broken_promises(evidence)
    figures: dict[str, Figure] = {"promises_broken": len(violations)}
    if violations:
        broken: dict[str, list[str]] = {}
        for violation in violations:
            broken.setdefault(str(violation.promise), []).append(violation_words(violation))
        figures["promises"] = {name: "; ".join(words) for name, words in broken.items()}
    bound_n = stated_bound_n(evidence)
    if math.isfinite(bound_n):
        figures["force_bound_n"] = bound_n
        beyond = [float(forces.max()) - allowed_n for forces, allowed_n in judged_forces(evidence, trace)]
        if math.isfinite(max(beyond)):
            figures["force_beyond_n"] = max(beyond)
    return figures
