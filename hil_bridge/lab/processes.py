"""Process pool: jobs in chunks, with results as they complete or in the order of the jobs.

    with own_processes(workers, len(jobs)) as pool:
        results = in_order(pool, work, jobs, advance)

The processes live as long as the context is open. With one worker, the jobs run in this process.
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
"""Jobs handed to a process at once. Chosen: a few seconds of work, which is what a power failure loses."""
WAITING = 2
"""Chunks queued for each process. Chosen: enough to keep every process busy."""
THREAD_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables that numpy's linear algebra libraries read when they are loaded."""

Item = TypeVar("Item")
Outcome = TypeVar("Outcome")


@dataclass(frozen=True, slots=True)
class Workers:
    """Worker processes on this or other machines."""

    executor: Executor | None
    """None: the jobs run in this process."""
    count: Callable[[], int]
    """Return the current number of processes."""


class Chunk(NamedTuple, Generic[Item, Outcome]):
    """Jobs that completed together, with their results."""

    first: int
    """Index of its first job among all."""
    items: Sequence[Item]
    results: Sequence[Outcome]


@contextmanager
def own_processes(count: int | None = None, jobs: int | None = None) -> Iterator[Workers]:
    """Run a pool of `count` processes on this machine, by default one per core, and no more than `jobs` keep busy.

    An exception, Ctrl-C or SIGTERM in the context ends them at once. Raises BridgeError if one was killed externally.
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
    with _ending_by_sigterm(), one_thread_each(), ProcessPoolExecutor(count, context, begin_worker) as pool:
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
    """Yield each chunk of items with the results of `work`, in the order of completion. Raises what `work` raises."""
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
    """Return the results of `work` in the order of the items. `advance` receives the number of newly ended items."""
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
    """Initialise a worker. Ctrl-C reaches every process of a terminal, but only the parent handles it. A worker whose
    parent was killed exits instead of waiting forever.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:

        def watch() -> None:
            parent.join()
            os._exit(1)

        threading.Thread(target=watch, name="parent", daemon=True).start()


@contextmanager
def _ending_by_sigterm() -> Iterator[None]:
    """End this process and its workers on SIGTERM, as on Ctrl-C; by default the workers would be left running.

    A handler that is already installed is kept.
    """
    in_main_thread = threading.current_thread() is threading.main_thread()  # only there may handlers be set
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
    """Limit the linear algebra of processes started in this context to one thread. Their matrices have three rows, for
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
