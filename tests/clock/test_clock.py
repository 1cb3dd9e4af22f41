"""Virtual time: exact jumps, and an error in place of a hanging run or leaked tasks."""

import asyncio
import gc
import math
import threading
import time
import weakref
from asyncio import sleep as pass_time  # in virtual time, without waiting
from collections.abc import AsyncIterator, Callable, Coroutine
from typing import Any

import pytest

from hil_bridge.clock import (
    VIRTUAL_EPOCH,
    VIRTUAL_WALL_NS,
    Clock,
    Heartbeat,
    LeakedTasks,
    VirtualDeadlock,
    VirtualTimeError,
    run_real,
    run_virtual,
)
from hil_bridge.clock.heartbeat import RECENT_S
from hil_bridge.transports import connect_bytes, connect_can, listen_bytes, listen_can, listen_datagrams


def test_virtual_time_begins_at_epoch_and_jumps_exactly() -> None:
    async def main() -> list[float]:
        clock = Clock.running()
        assert clock.is_virtual
        times = [clock.now()]
        for k in range(1, 4):
            await clock.sleep_until(VIRTUAL_EPOCH + k / 3)
            times.append(clock.now())
        await pass_time(100_000.1)
        times.append(clock.now())
        return times

    epoch = VIRTUAL_EPOCH
    times = run_virtual(main)
    assert times[:4] == [epoch, epoch + 1 / 3, epoch + 2 / 3, epoch + 1]
    assert times[4] == epoch + 1 + 100_000.1


def test_virtual_timers_run_in_order_at_their_times() -> None:
    async def main() -> None:
        clock = Clock.running()
        start, times = clock.now(), []
        # the first two are closer than the nanosecond within which asyncio merges timers
        whens = [start + 1e-3, start + 1e-3 + 1e-11, start + 2e-3, start + 5.0]
        for when in (whens[3], whens[1], whens[0], whens[2]):
            clock.call_at(when, lambda: times.append(clock.now()))
        clock.call_at(start + 1.5e-3, lambda: times.append(0.0)).cancel()
        await clock.sleep_until(start + 6.0)
        assert times == whens

    run_virtual(main)


def test_virtual_past_timer_runs_without_advance() -> None:
    async def main() -> None:
        clock = Clock.running()
        start, times = clock.now(), []
        clock.call_at(start - 1.0, lambda: times.append(clock.now()))
        assert times == []
        await clock.sleep_until(start - 1.0)
        await pass_time(0)
        assert times == [start]

    run_virtual(main)


def test_virtual_cancelled_sleep_leaves_no_timer() -> None:
    async def main() -> float:
        clock = Clock.running()
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.25):
                await clock.sleep_until(clock.now() + 3600)
        return clock.now()

    assert run_virtual(main) == VIRTUAL_EPOCH + 0.25


def test_virtual_deadlock_error_names_waiting_tasks() -> None:
    async def waits_for_godot() -> None:
        await asyncio.get_running_loop().create_future()

    with pytest.raises(VirtualDeadlock, match="in waits_for_godot"):
        run_virtual(waits_for_godot)


def test_virtual_endless_loop_is_error() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()

        def again() -> None:
            loop.call_soon(again)

        again()
        await pass_time(1)

    with pytest.raises(VirtualTimeError, match="time does not advance"):
        run_virtual(main)


def test_virtual_leaked_task_is_error() -> None:
    async def main(cancel: bool) -> int:
        task = asyncio.create_task(pass_time(5), name="forgotten")
        await pass_time(1)
        if cancel:
            task.cancel()
        return 7

    with pytest.raises(LeakedTasks, match="forgotten"):
        run_virtual(main(cancel=False))
    assert run_virtual(main(cancel=True)) == 7


def test_virtual_errors_of_main_and_callback_propagate() -> None:
    async def fails() -> None:
        raise KeyError("main")

    async def callback_fails() -> None:
        asyncio.get_running_loop().call_soon(lambda: dict[str, object]()["callback"])
        await pass_time(1)

    with pytest.raises(KeyError, match="main"):
        run_virtual(fails)
    with pytest.raises(KeyError, match="callback"):
        run_virtual(callback_fails)


def test_virtual_threads_and_files_are_refused() -> None:
    async def main() -> None:
        with pytest.raises(VirtualTimeError, match="no threads"):
            await asyncio.to_thread(threading.get_ident)
        with pytest.raises(VirtualTimeError, match="no file descriptors"):
            asyncio.get_running_loop().add_reader(0, print)

    run_virtual(main)


def test_virtual_async_generators_are_shut_down() -> None:
    closed = []

    async def numbers() -> AsyncIterator[int]:
        try:
            yield 1
            yield 2
        finally:
            closed.append(True)

    kept = numbers()

    async def main() -> int:
        return await anext(kept)

    assert run_virtual(main) == 1
    assert closed == [True]


def test_virtual_wall_time_is_fixed() -> None:
    async def main() -> tuple[int, int]:
        clock = Clock.running()
        await pass_time(12.5)
        assert clock.at_wall(0.0) == clock.now()
        return clock.wall_ns(VIRTUAL_EPOCH), clock.wall_ns(clock.now())

    assert run_virtual(main) == (VIRTUAL_WALL_NS, VIRTUAL_WALL_NS + 12_500_000_000)


def test_run_real_accepts_function_or_coroutine() -> None:
    async def main() -> bool:
        return asyncio.get_running_loop().time() == VIRTUAL_EPOCH

    assert run_real(main) is False
    assert run_real(main()) is False


class Unwritten:
    """Result that counts how often it is formatted as text."""

    def __init__(self) -> None:
        self.written = 0

    def __repr__(self) -> str:
        self.written += 1
        return "a large result"


@pytest.mark.parametrize("run", [run_virtual, run_real])
def test_run_does_not_format_result(
    run: Callable[[Coroutine[Any, Any, Unwritten]], Unwritten],
) -> None:
    async def main() -> Unwritten:
        return Unwritten()

    assert run(main()).written == 0


def test_event_loop_is_released_after_run() -> None:
    """Pending timers and open wires in memory keep no reference to a run that has ended."""

    async def main() -> weakref.ref[asyncio.AbstractEventLoop]:
        clock = Clock.running()
        listening = await listen_bytes("memory:left", clock)
        wires = (
            listening,
            await connect_bytes("memory:left", clock),
            await listen_can("can+memory:left", clock),
            await connect_can("can+memory:left", clock),
            await listen_datagrams("udp+memory:left", clock),
        )
        clock.call_at(clock.now() + 1e6, lambda: wires)
        return weakref.ref(clock.loop)

    left = run_virtual(main)
    gc.collect()
    assert left() is None


def test_heartbeat_late_beat_counts_for_one_second() -> None:
    async def main() -> tuple[float, ...]:
        heart = Heartbeat(Clock.running())
        heart.start()
        await pass_time(0.05)
        time.sleep(0.2)  # noqa: ASYNC251 - the computer does nothing
        await pass_time(0.05)
        late = heart.recent(0.004), heart.recent(math.inf), heart.take()
        await pass_time(RECENT_S + 0.1)
        heart.stop()
        return *late, heart.recent(0.2)

    fast, slow, longest, later = run_real(main())
    assert 0.18 <= fast == slow == longest < 1.0
    assert later < 0.18


def test_heartbeat_in_virtual_time_is_never_late() -> None:
    async def main() -> float:
        heart = Heartbeat(Clock.running())
        heart.start()
        await pass_time(1.0)
        return heart.recent(0.004)

    assert run_virtual(main()) == 0.0
