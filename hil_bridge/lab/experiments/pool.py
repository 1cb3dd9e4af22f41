"""Runs simulations on all cores, in processes of their own, and tells how far they are."""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

from hil_bridge.lab.experiments.results import Job
from hil_bridge.lab.processes import CHUNK, as_completed, in_chunks, own_processes


def run_jobs(
    jobs: Iterable[Job], workers: int | None = None, advance: Callable[[int], None] = lambda count: None
) -> dict[Job, Any]:
    """Results by job; a job that occurs twice runs once. `advance` is told how many have ended since.

    `workers` processes, by default one a core; with 1 everything runs in this one.
    """
    todo = list(dict.fromkeys(jobs))
    workers = max(1, min(workers or os.cpu_count() or 1, -(-len(todo) // CHUNK)))
    results: dict[Job, Any] = {}
    if workers == 1:
        for job in todo:
            results[job] = job()
            advance(1)
        return results
    with _ended_by_sigterm(), own_processes(workers) as found:
        for chunk, told in as_completed(found, _run, in_chunks(todo)):
            results.update(zip(chunk, told, strict=True))
            advance(len(chunk))
    return results


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
