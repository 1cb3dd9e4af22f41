"""Process pool that executes jobs in chunks, and returns results as they complete or in the order of the jobs.

    with own_processes(workers, len(jobs)) as pool:
        results = in_order(pool, work, jobs, advance)

The processes run as long as the context is open. With one worker, the jobs run in this process.
"""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from typing import Generic, NamedTuple, NoReturn, TypeVar

from hil_bridge.errors import BridgeError

CHUNK = 4
"""Number of jobs that a process receives at once. Chosen: a few seconds of work, which is what a power failure
loses.
"""
WAITING = 2
"""Number of chunks that wait for each process. Chosen: enough to keep every process busy."""
THREAD_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables for the number of threads, which numpy's linear algebra libraries read when they are loaded."""

Item = TypeVar("Item")
Outcome = TypeVar("Outcome")


@dataclass(frozen=True, slots=True)
class Workers:
    """Worker processes on this machine or on other machines."""

    executor: Executor | None
    """Executor of the jobs; None to run them in this process."""
    count: Callable[[], int]
    """Function that returns the current number of processes."""


class Chunk(NamedTuple, Generic[Item, Outcome]):
    """Jobs that completed together, with their results."""

    first: int
    """Index of the first job of the chunk among all jobs."""
    items: Sequence[Item]
    results: Sequence[Outcome]


@contextmanager
def own_processes(count: int | None = None, jobs: int | None = None) -> Iterator[Workers]:
    """Provide a pool of `count` processes on this machine.

    The default is one process per core, but no more than `jobs` jobs keep busy. An exception, Ctrl-C or SIGTERM in
    the context ends the processes at once. Raises BridgeError if a process was killed externally.
    """
    count = count or os.cpu_count() or 1
    if jobs is not None:
        count = max(1, min(count, -(-jobs // CHUNK)))
    if count == 1:
        yield Workers(None, lambda: 1)
        return
    # Spawned, not forked: the same on every platform, and no lock is copied while a thread holds it.
    context = multiprocessing.get_context("spawn")
    others = set(multiprocessing.active_children())
    with _end_by_sigterm(), one_thread_each(), ProcessPoolExecutor(count, context, begin_worker) as pool:
        try:
            yield Workers(pool, lambda: count)
        except BaseException as error:
            # Otherwise leaving the pool waits for their current jobs. The pool notices that they ended and drops the
            # queue. Shutting it down here without waiting would leave its thread running at interpreter exit.
            for worker in set(multiprocessing.active_children()) - others:
                worker.terminate()
            if isinstance(error, BrokenProcessPool):
                raise BridgeError(
                    "a worker process was killed externally",
                    remedy="run the same command again, with fewer --workers if memory was short",
                ) from error
            raise


def as_completed(
    workers: Workers, work: Callable[[Item], Outcome], items: Iterable[Item], chunk: int = CHUNK
) -> Iterator[Chunk[Item, Outcome]]:
    """Yield each chunk of items with the results of `work`, in the order of completion. Errors of `work` are
    propagated.
    """
    chunks = _in_chunks(items, chunk)
    if workers.executor is None:
        for first, some in chunks:
            yield Chunk(first, some, _do(work, some))
        return
    waiting: dict[Future[list[Outcome]], tuple[int, list[Item]]] = {}
    while True:
        room = max(workers.count(), 1) * (1 + WAITING) - len(waiting)
        for first, some in islice(chunks, max(room, 0)):
            waiting[workers.executor.submit(_do, work, some)] = first, some
        if not waiting:
            return
        for future in wait(waiting, return_when=FIRST_COMPLETED).done:
            first, some = waiting.pop(future)
            yield Chunk(first, some, future.result())


def in_order(
    workers: Workers,
    work: Callable[[Item], Outcome],
    items: Sequence[Item],
    advance: Callable[[int], object] = lambda count: None,
    chunk: int = CHUNK,
) -> list[Outcome]:
    """Return the results of `work` in the order of the items. `advance` receives the number of newly completed
    items.
    """
    results: dict[int, Outcome] = {}
    alone = workers.executor is None
    for ended in as_completed(workers, work, items, 1 if alone else chunk):
        results.update(enumerate(ended.results, ended.first))
        advance(len(ended.items))
    return [results[place] for place in range(len(items))]


def _do(work: Callable[[Item], Outcome], items: Sequence[Item]) -> list[Outcome]:
    return [work(item) for item in items]


def _in_chunks(items: Iterable[Item], size: int) -> Iterator[tuple[int, list[Item]]]:
    """Yield chunks of `size` items, each with the index of its first item."""
    left, first = iter(items), 0
    while chunk := list(islice(left, size)):
        yield first, chunk
        first += len(chunk)


def begin_worker() -> None:
    """Initialise a worker process.

    The worker ignores Ctrl-C, which reaches every process of a terminal, because only the parent handles it. The
    worker exits if its parent was killed, instead of waiting forever.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:

        def watch() -> None:
            parent.join()
            os._exit(1)

        threading.Thread(target=watch, name="parent", daemon=True).start()


@contextmanager
def _end_by_sigterm() -> Iterator[None]:
    """End this process and its workers on SIGTERM, as on Ctrl-C. By default, the workers would continue to run.

    A handler that is already installed is kept.
    """
    in_main_thread = threading.current_thread() is threading.main_thread()  # handlers can be set only there
    if not in_main_thread or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return

    def end(number: int, frame: object) -> NoReturn:
        sys.exit(128 + number)

    signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Limit the linear algebra of processes that are started in this context to one thread.

    The matrices have three rows. Waking a thread on every core would take longer than computing their product.
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
