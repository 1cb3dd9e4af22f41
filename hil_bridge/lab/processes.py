"""Work in many processes, a chunk at a time, whose results are taken as they come."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from typing import TypeVar

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

    executor: Executor
    count: Callable[[], int]
    """Number of processes at present."""


@contextmanager
def own_processes(count: int) -> Iterator[Workers]:
    """So many processes on this machine. Inside, an exception or Ctrl-C ends them at once.

    Raises BridgeError when one was ended from outside.
    """
    # Spawned, not forked: the same on every platform, and no thread's lock is copied while it is held.
    context = multiprocessing.get_context("spawn")
    with one_thread_each(), ProcessPoolExecutor(count, context, begin_worker) as pool:
        try:
            yield Workers(pool, lambda: count)
        except BaseException as error:
            # Else leaving the pool waits for their present jobs. The pool sees them go and drops what is waiting; to
            # shut it down without waiting here would let its thread meet the end of the interpreter.
            for worker in multiprocessing.active_children():
                worker.terminate()
            if isinstance(error, BrokenProcessPool):
                raise BridgeError(
                    "a worker process was ended from outside; give the same command again"
                ) from error
            raise


def in_chunks(items: Iterable[Item]) -> Iterator[list[Item]]:
    """The items, CHUNK at a time."""
    left = iter(items)
    while chunk := list(islice(left, CHUNK)):
        yield chunk


def as_completed(
    workers: Workers, work: Callable[[list[Item]], Made], chunks: Iterator[list[Item]]
) -> Iterator[tuple[list[Item], Made]]:
    """Each chunk with what `work` makes of it, in the order in which they end. Raises what `work` raises."""
    waiting: dict[Future[Made], list[Item]] = {}
    while True:
        room = max(workers.count(), 1) * (1 + WAITING) - len(waiting)
        for chunk in islice(chunks, max(room, 0)):
            waiting[workers.executor.submit(work, chunk)] = chunk
        if not waiting:
            return
        for future in wait(waiting, return_when=FIRST_COMPLETED).done:
            yield waiting.pop(future), future.result()


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
