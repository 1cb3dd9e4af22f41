"""Runs simulations on all cores, in processes of their own, and tells how far they are."""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing import get_context
from typing import Any, NoReturn

from hil_bridge.experiments.results import Job

CHUNK = 4
"""Jobs handed to a process at once. Chosen: a second or two of work."""

THREAD_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables that the libraries below numpy read when they are loaded."""


def run_jobs(
    jobs: Iterable[Job], workers: int | None = None, advance: Callable[[int], None] = lambda count: None
) -> dict[Job, Any]:
    """Results by job; a job that occurs twice runs once. `advance` is told how many have ended since.

    `workers` processes, by default one a core; with 1 everything runs in this one.
    """
    todo = list(dict.fromkeys(jobs))
    chunks = [todo[at : at + CHUNK] for at in range(0, len(todo), CHUNK)]
    workers = min(workers or os.cpu_count() or 1, max(len(chunks), 1))
    results: dict[Job, Any] = {}
    if workers == 1:
        for job in todo:
            results[job] = job()
            advance(1)
        return results
    # Spawned, not forked: the same on every platform, and no thread's lock is copied while it is held.
    # Ctrl-C reaches every process of a terminal; only this one is to answer it.
    with (
        _one_thread_each(),
        _ended_by_sigterm(),
        ProcessPoolExecutor(
            workers, get_context("spawn"), signal.signal, (signal.SIGINT, signal.SIG_IGN)
        ) as pool,
    ):
        try:
            futures = {pool.submit(_run, chunk): chunk for chunk in chunks}
            for future in as_completed(futures):
                results.update(zip(futures[future], future.result(), strict=True))
                advance(len(futures[future]))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            # else leaving the pool waits for their present jobs
            for worker in multiprocessing.active_children():
                worker.terminate()
            raise
    return results


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Processes that start meanwhile leave their linear algebra in one thread. Theirs are matrices of three rows, for
    which waking a thread on every core takes longer than the product.
    """
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


@contextmanager
def _ended_by_sigterm() -> Iterator[None]:
    """SIGTERM ends this process the way Ctrl-C does, with its workers; by itself it would leave them behind."""
    if threading.current_thread() is not threading.main_thread():  # only there may handlers be set
        yield
        return

    def end(number: int, frame: object) -> NoReturn:
        sys.exit(128 + number)

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _run(jobs: list[Job]) -> list[Any]:
    return [job() for job in jobs]
