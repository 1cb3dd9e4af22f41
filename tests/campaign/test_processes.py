"""Process pool: order, progress, warm workers, a crash, Ctrl-C, SIGTERM."""

import multiprocessing
import os
import signal
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from hil_bridge.errors import BridgeError
from hil_bridge.lab.processes import as_completed, in_order, own_processes

JOBS: tuple[Callable[[], Any], ...] = (os.getpid, partial(time.sleep, 60.0))
"""Jobs of which the first ends immediately, and the second not within a test."""
FAILING: tuple[Callable[[], Any], ...] = (partial(time.sleep, 60.0), partial(int, "x"))


def perform(job: Callable[[], Any]) -> Any:
    return job()


def slow_square(number: int) -> int:
    """Square a number; the first ones take longest."""
    time.sleep(0.05 * max(4 - number, 0))
    return number * number


@pytest.mark.sweep
@pytest.mark.parametrize("workers", [1, 3])
@pytest.mark.parametrize("chunk", [1, 4])
def test_pool_results_keep_job_order(workers: int, chunk: int) -> None:
    ended: list[int] = []
    with own_processes(workers) as pool:
        result = in_order(pool, slow_square, range(10), ended.append, chunk)
        assert in_order(pool, slow_square, []) == []
    assert result == [number * number for number in range(10)]
    assert sum(ended) == 10
    assert (len(ended) == 10) == (1 in (workers, chunk))


def test_pool_keeps_workers_between_calls() -> None:
    jobs = [os.getpid] * 6
    with own_processes(2) as pool:
        first, second = (set(in_order(pool, perform, jobs, chunk=1)) for _ in range(2))
    assert os.getpid() not in first
    assert len(first | second) <= 2
    with own_processes(8, jobs=4) as pool:
        assert set(in_order(pool, perform, jobs)) == {os.getpid()}


def crash() -> list[Any]:
    """Kill a worker, as Linux does when memory is low."""
    with own_processes(2) as pool:
        return in_order(pool, signal.raise_signal, [signal.SIGKILL, signal.SIGKILL], chunk=1)


def fail() -> list[Any]:
    with own_processes(2) as pool:
        return in_order(pool, perform, FAILING, chunk=1)


def interrupt() -> None:
    with own_processes(2) as pool:
        for chunk in as_completed(pool, perform, JOBS, 1):
            assert chunk.first == 0
            raise KeyboardInterrupt


def terminate() -> None:
    with own_processes(2) as pool:
        for _ in as_completed(pool, perform, JOBS, 1):
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(10.0)


@pytest.mark.parametrize(
    ("end", "kind", "message"),
    [
        (crash, BridgeError, "a worker process was killed externally; run the same command again"),
        (fail, ValueError, "invalid literal"),
        (interrupt, KeyboardInterrupt, "^$"),
        (terminate, SystemExit, "143"),
    ],
)
def test_pool_exit_is_reported_and_leaves_no_process(
    end: Callable[[], Any], kind: type[BaseException], message: str
) -> None:
    other = multiprocessing.get_context("spawn").Process(target=time.sleep, args=(120.0,))
    other.start()
    handler, began = signal.getsignal(signal.SIGTERM), time.monotonic()
    with pytest.raises(kind, match=message) as caught:
        end()
    assert time.monotonic() - began < 30.0
    assert "\n" not in str(caught.value)
    assert multiprocessing.active_children() == [other]
    assert signal.getsignal(signal.SIGTERM) is handler
    other.kill()
    other.join()
