"""The one pool: jobs in many processes, some at a time, with results as they come or in the order of the jobs.

    with own_processes(workers, len(jobs)) as pool:
        results = in_order(pool, work, jobs, advance)

A pool stays warm as long as its context is open. One process means this one: nothing is started then.
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
"""Jobs handed to a process at once. Chosen: a second or a few of work; so much is lost when the power fails."""
WAITING = 2
"""Chunks that wait for each process. Chosen: enough that none is ever idle."""
THREAD_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables that the libraries below numpy read when they are loaded."""

Item = TypeVar("Item")
Made = TypeVar("Made")


@dataclass(frozen=True, slots=True)
class Workers:
    """Processes that take work, on this machine or on others."""

    executor: Executor | None
    """None: this process does the work."""
    count: Callable[[], int]
    """Number of processes at present."""


class Chunk(NamedTuple, Generic[Item, Made]):
    """Jobs that have ended together, with their results."""

    first: int
    """Place of its first job among all."""
    items: Sequence[Item]
    results: Sequence[Made]


@contextmanager
def own_processes(count: int | None = None, jobs: int | None = None) -> Iterator[Workers]:
    """So many processes on this machine, by default one a core, and no more than `jobs` keep busy.

    Inside, an exception, Ctrl-C or SIGTERM ends them at once. Raises BridgeError when one was ended from outside.
    """
    count = count or os.cpu_count() or 1
    if jobs is not None:
        count = max(1, min(count, -(-jobs // CHUNK)))
    if count == 1:
        yield Workers(None, lambda: 1)
        return
    # Spawned, not forked: the same on every platform, and no thread's lock is copied while it is held.
    context = multiprocessing.get_context("spawn")
    others = set(multiprocessing.active_children())
    with _ending_by_sigterm(), one_thread_each(), ProcessPoolExecutor(count, context, begin_worker) as pool:
        try:
            yield Workers(pool, lambda: count)
        except BaseException as error:
            # Else leaving the pool waits for their present jobs. The pool sees them go and drops what is waiting; to
            # shut it down without waiting here would let its thread meet the end of the interpreter.
            for worker in set(multiprocessing.active_children()) - others:
                worker.terminate()
            if isinstance(error, BrokenProcessPool):
                raise BridgeError(
                    "a worker process was ended from outside",
                    remedy="give the same command again, with fewer --workers where memory was short",
                ) from error
            raise


def as_completed(
    workers: Workers, work: Callable[[Item], Made], items: Iterable[Item], chunk: int = CHUNK
) -> Iterator[Chunk[Item, Made]]:
    """Each chunk of items with what `work` makes of them, in the order in which they end. Raises what `work` raises."""
    chunks = _in_chunks(items, chunk)
    if workers.executor is None:
        for first, some in chunks:
            yield Chunk(first, some, _do(work, some))
        return
    waiting: dict[Future[list[Made]], tuple[int, list[Item]]] = {}
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
    work: Callable[[Item], Made],
    items: Sequence[Item],
    advance: Callable[[int], object] = lambda count: None,
    chunk: int = CHUNK,
) -> list[Made]:
    """The results of `work`, in the order of the items. `advance` is told how many have ended since."""
    results: dict[int, Made] = {}
    alone = workers.executor is None
    for ended in as_completed(workers, work, items, 1 if alone else chunk):
        results.update(enumerate(ended.results, ended.first))
        advance(len(ended.items))
    return [results[place] for place in range(len(items))]


def _do(work: Callable[[Item], Made], items: Sequence[Item]) -> list[Made]:
    return [work(item) for item in items]


def _in_chunks(items: Iterable[Item], size: int) -> Iterator[tuple[int, list[Item]]]:
    """Place of the first item, and the items, so many at a time."""
    left, first = iter(items), 0
    while chunk := list(islice(left, size)):
        yield first, chunk
        first += len(chunk)


def begin_worker() -> None:
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
def _ending_by_sigterm() -> Iterator[None]:
    """SIGTERM ends this process the way Ctrl-C does, with its workers; by itself it would leave them behind.

    A handler that is set already stays.
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
