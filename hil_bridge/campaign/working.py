"""Runs what a campaign still lacks, on all cores, and keeps each chunk as soon as it is done."""

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
from pathlib import Path

from hil_bridge.campaign.criteria import Criterion
from hil_bridge.campaign.judging import Job, carry_out
from hil_bridge.campaign.plan import Plan, code_version
from hil_bridge.campaign.store import Done, Store, now
from hil_bridge.errors import BridgeError

CHUNK = 4
"""Runs handed to a process at once. Chosen: a second or a few of work; so much is lost when the power fails."""
WAITING = 2
"""Chunks that wait for each process. Chosen: enough that none is ever idle."""
THREAD_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables that the libraries below numpy read when they are loaded."""

Advance = Callable[[int, int], object]
"""Told how many runs have ended since, and how many of them failed."""


def missing(plan: Plan, store: Store) -> list[Job]:
    """Runs of the plan that are not kept yet."""
    code, there = code_version(), store.keys()
    numbers = {case: number for number, case in enumerate(plan.cases)}
    jobs = (
        Job(case.key(code, seed), numbers[case], case.config, case.table, seed) for case, seed in plan.runs()
    )
    return [job for job in jobs if job.key not in there]


def work(
    plan: Plan, store: Store, jobs: list[Job], workers: int, advance: Advance = lambda *told: None
) -> None:
    """Do these runs. Ctrl-C and SIGTERM end it at once; the runs that are kept stay.

    Raises BridgeError when a process was ended from outside.
    """
    began, clock, count = now(), time.monotonic(), 0

    def keep(done: list[Done]) -> None:
        nonlocal count
        store.put(done, plan.cases)
        count += len(done)
        advance(len(done), sum(not run.passed for run in done))

    chunks = (jobs[at : at + CHUNK] for at in range(0, len(jobs), CHUNK))
    workers = max(1, min(workers, -(-len(jobs) // CHUNK)))
    try:
        if workers == 1:
            for chunk in chunks:
                keep(_carry_out(chunk, plan.criteria, store.folder))
        else:
            _in_processes(chunks, plan.criteria, store.folder, workers, keep)
    finally:
        if count:
            store.sat(began, time.monotonic() - clock, count, workers)


def _in_processes(
    chunks: Iterator[list[Job]],
    criteria: tuple[Criterion, ...],
    folder: Path,
    workers: int,
    keep: Callable[[list[Done]], None],
) -> None:
    context = multiprocessing.get_context("spawn")  # no thread's lock is copied while it is held
    with _one_thread_each(), ProcessPoolExecutor(workers, context, _begin) as pool:
        try:
            waiting: set[Future[list[Done]]] = set()
            while True:
                for chunk in islice(chunks, workers * (1 + WAITING) - len(waiting)):
                    waiting.add(pool.submit(_carry_out, chunk, criteria, folder))
                if not waiting:
                    return
                ended, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                for future in ended:
                    keep(future.result())
        except BaseException as error:
            pool.shutdown(wait=False, cancel_futures=True)
            # else leaving the pool waits for their present runs
            for worker in multiprocessing.active_children():
                worker.terminate()
            if isinstance(error, BrokenProcessPool):
                raise BridgeError(
                    "a process of the campaign was ended from outside; the same command goes on"
                ) from error
            raise


def _carry_out(jobs: list[Job], criteria: tuple[Criterion, ...], folder: Path) -> list[Done]:
    return [carry_out(job, criteria, folder) for job in jobs]


def _begin() -> None:
    """A worker begins. Ctrl-C reaches every process of a terminal; only the first is to answer it. A worker whose
    parent was killed ends, instead of waiting for ever.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:

        def watch() -> None:
            parent.join()
            os._exit(1)

        threading.Thread(target=watch, name="parent", daemon=True).start()


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Processes that start meanwhile leave their linear algebra in one thread: theirs are matrices of three rows."""
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
