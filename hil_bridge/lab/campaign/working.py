"""Execution of a campaign's outstanding runs on all cores or on other machines. Each chunk is stored when it
completes.
"""

import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import partial
from pathlib import Path

from hil_bridge.errors import BridgeError
from hil_bridge.lab.campaign.criteria import Criterion
from hil_bridge.lab.campaign.judging import Job, carry_out
from hil_bridge.lab.campaign.plan import Plan, code_version
from hil_bridge.lab.campaign.store import Done, Store, now
from hil_bridge.lab.processes import Workers, as_completed, own_processes

Advance = Callable[[int, int], object]
"""Progress callback. It receives the number of runs that ended since the last call, and the number of these runs
that failed.
"""


def missing(plan: Plan, store: Store) -> list[Job]:
    """Return the runs of the plan that are not stored yet."""
    code, stored = plan.code, store.keys()
    numbers = {case: number for number, case in enumerate(plan.cases)}
    jobs = (
        Job(case.key(code, seed, table), numbers[case], case.config, table, seed)
        for case, seed in plan.runs()
        for table in (plan.table_of(case, seed),)
    )
    return [job for job in jobs if job.key not in stored]


def work(
    plan: Plan,
    store: Store,
    jobs: list[Job],
    workers: int | AbstractContextManager[Workers],
    advance: Advance = lambda *counts: None,
) -> None:
    """Execute runs in `workers` processes of this machine, or on remote workers.

    Ctrl-C and SIGTERM end the execution at once; stored runs remain. Remote workers save no recordings, so a run
    that fails remotely is repeated on this machine. Raises BridgeError if a process was killed externally, and for
    a worker with another version of the code.
    """
    began, clock, count, most = now(), time.monotonic(), 0, 1
    here = isinstance(workers, int)
    folder = store.folder if here else None
    todo = partial(_carry_out, criteria=plan.criteria, folder=folder, plugins=plan.plugins, code=plan.code)
    try:
        with own_processes(workers, len(jobs)) if isinstance(workers, int) else workers as pool:
            for chunk in as_completed(pool, todo, jobs):
                most, done = max(most, pool.count()), chunk.results
                if not here:
                    done = [
                        _with_recording(job, run, plan.criteria, store.folder)
                        for job, run in zip(chunk.items, done, strict=True)
                    ]
                store.put(done, plan.cases)
                count += len(done)
                advance(len(done), sum(not run.passed for run in done))
    finally:
        if count:
            store.add_sitting(began, time.monotonic() - clock, count, most)


def _carry_out(
    job: Job, criteria: tuple[Criterion, ...], folder: Path | None, plugins: tuple[str, ...], code: str
) -> Done:
    if (there := code_version(plugins)) != code:
        names = " and ".join(("hil-bridge", *plugins))
        raise BridgeError(
            f"a worker has {names} {there}, this computer {code}; install the same version there"
        )
    return carry_out(job, criteria, folder)


def _with_recording(job: Job, done: Done, criteria: tuple[Criterion, ...], folder: Path) -> Done:
    """Repeat a failed remote run on this machine to save its recording."""
    return done if done.passed else replace(done, recording=carry_out(job, criteria, folder).recording)
