"""Execution of a single run of a campaign: simulation, measurement and verdict."""

import math
import time
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path

from hil_bridge.api import BridgeError, Config, Result, Simulation, run_virtual
from hil_bridge.clock.order import VirtualOrder
from hil_bridge.errors import ConfigError
from hil_bridge.lab.campaign.criteria import Criterion, Figure, find_unmet
from hil_bridge.lab.campaign.fault_effects import struck_causes, struck_faults
from hil_bridge.lab.campaign.overlay import config_with
from hil_bridge.lab.campaign.store import Done
from hil_bridge.lab.campaign.watching import Watch, recovery_s
from hil_bridge.lab.invariants import (
    Evidence,
    bounded_forces,
    broken_promises,
    stated_bound_n,
    violation_detail,
)
from hil_bridge.record import Recording
from hil_bridge.record.analysis.summary import summarise
from hil_bridge.record.topics import RECORDS
from hil_bridge.runs.background_tasks import background_task
from hil_bridge.runs.simulation import simulating

REFUSED = "refused"
"""Outcome of a run that has contradictory settings, or that a device refused before any motion."""


@dataclass(frozen=True, slots=True)
class Job:
    """Run to be executed."""

    key: str
    number: int
    """Index of the case in the plan."""
    config: str
    table: str
    """Overlay of the case's configuration, as JSON: a fault, or drawn settings and faults."""
    seed: int


@dataclass
class _Observation:
    """Data of a run from which the run is judged."""

    usual: Recording | None = None
    """Recording of the same run in the usual order, if its own order was drawn."""
    simulation: Simulation | None = None
    watch: Watch | None = None
    error: BridgeError | None = None


@dataclass(frozen=True, slots=True)
class RunFigures:
    """Figures of an executed run, and its result if the run could start."""

    figures: dict[str, Figure]
    cause: str
    result: Result | None = field(repr=False, default=None)


def carry_out(job: Job, criteria: tuple[Criterion, ...], folder: Path | None) -> Done:
    """Execute and judge a run. If the run fails and `folder` is given, its recording is saved there."""
    began = time.perf_counter()
    run = attempt(job)
    unmet = find_unmet(criteria, run.figures)
    name = ""
    if unmet and folder is not None and run.result is not None:
        name = f"{job.key}.mcap"
        folder.mkdir(parents=True, exist_ok=True)
        run.result.save(folder / name, overwrite=True)  # an existing file can only come from the same run
    wall_s = time.perf_counter() - began
    outcome = str(run.figures["outcome"])
    return Done(
        job.key, job.number, job.seed, outcome, run.cause, tuple(unmet), run.figures, wall_s, name, job.table
    )


def attempt(job: Job) -> RunFigures:
    """Execute a run and return its figures, also if the run cannot start or ends by a bug."""
    try:
        return run(configure_run(job))
    except ConfigError as error:  # settings that were drawn together and contradict each other
        return RunFigures({"outcome": REFUSED, "retracted": True}, str(error))
    except Exception as error:  # an error in one run must not lose the other runs
        lines = str(error).splitlines() or [""]
        return RunFigures({"outcome": "error"}, f"{type(error).__name__}: {lines[0]}")


def configure_run(job: Job) -> Config:
    """Return the configuration of a run, with its faults and its seed."""
    return config_with(job.config, job.table, job.seed)


def run(config: Config, takes: Collection[type] = RECORDS) -> RunFigures:
    """Execute one run in virtual time and sample its true force. Raises ConfigError for a run that cannot start.

    `takes` holds the types of records that the result keeps. `READ_RECORDS` is sufficient for all figures. A run in a
    drawn order is executed in the usual order, too.
    """
    observed = _observe(config, takes)
    if observed.simulation is None:
        assert observed.error is not None
        return RunFigures({"outcome": REFUSED, "retracted": True}, str(observed.error))
    if config.virtual.shuffled != "none" and not config.virtual.late_us:
        usual = _observe(config.model_copy(update={"virtual": VirtualOrder()}), RECORDS).simulation
        observed.usual = None if usual is None else usual.result.recording
    return _measure(observed, observed.simulation)


def _observe(config: Config, takes: Collection[type]) -> _Observation:
    observed = _Observation()

    async def main() -> None:
        try:
            async with simulating(config, None, takes) as running:
                observed.simulation = running
                watch = observed.watch = Watch(running)
                try:
                    async with background_task(watch.watch(), "watch"):
                        await running.finished()
                finally:
                    watch.sample()
        except BridgeError as error:  # a device refused before any motion
            observed.error = error

    run_virtual(main)
    return observed


def _measure(observed: _Observation, running: Simulation) -> RunFigures:
    result = running.result
    refused = observed.error is not None
    figures: dict[str, Figure] = {
        "outcome": REFUSED if refused else result.outcome.value,
        "retracted": result.retracted,
        "cycles": len(result.cycles),
    }
    if observed.watch is not None and running.cell is not None:
        times, forces = observed.watch.truth()
        figures |= {"force_true_max_n": float(forces.max()), "force_true_end_n": float(forces[-1])}
        if faults := running.cell.faults:
            figures["struck"] = sum(fault.struck for fault in faults)
            figures["faults_struck"] = {**struck_faults(running.config, faults)}
            if figures["outcome"] == "completed":
                figures["recovery_s"] = recovery_s(
                    result.recording, observed.watch.fault_ends(), times, forces
                )
        figures |= _promises(running, observed.watch, observed.usual)
    causes = struck_causes(result.recording)
    if observed.error is not None and observed.error.cause is not None:
        causes |= {str(observed.error.cause): 1}
    if causes:
        figures["causes"] = {**causes}
    if result.events:
        figures["duration_s"] = result.events[-1].at - result.events[0].at
    if result.cycles:
        summary = summarise(result.recording)
        values = {**summary.figures, **summary.response}
        figures |= {name: None if v is None or v != v else v for name, v in values.items()}
        figures["steps_failed"] = len(summary.criteria_failed)
    return RunFigures(figures, str(observed.error) if refused else result.text, result)


def _promises(running: Simulation, watch: Watch, usual: Recording | None) -> dict[str, Figure]:
    """Return the guard promises that a run broke, and the largest excess of its true force over the bound."""
    trace = watch.trace()
    evidence = Evidence(running.result.recording, running.config, trace, usual=usual)
    violations = broken_promises(evidence)
    figures: dict[str, Figure] = {"promises_broken": len(violations)}
    if violations:
        broken: dict[str, list[str]] = {}
        for violation in violations:
            broken.setdefault(str(violation.promise), []).append(violation_detail(violation))
        figures["promises"] = {name: "; ".join(texts) for name, texts in broken.items()}
    bound_n = stated_bound_n(evidence)
    if math.isfinite(bound_n):
        figures["force_bound_n"] = bound_n
        beyond = [float(forces.max()) - allowed_n for forces, allowed_n in bounded_forces(evidence, trace)]
        if math.isfinite(max(beyond)):
            figures["force_beyond_n"] = max(beyond)
    return figures
