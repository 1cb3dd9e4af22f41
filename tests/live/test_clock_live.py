"""Tests of real time: delay of a sleep, and timers of the clock that behave like the loop's."""

import asyncio
import statistics
import sys
from contextlib import closing
from functools import partial

import pytest

from hil_bridge.clock import Clock, run_real

pytestmark = pytest.mark.live


@pytest.mark.skipif(sys.platform != "linux", reason="precise timers need a timerfd")
def test_periodic_sleeps_wake_within_1_ms() -> None:
    async def main() -> float:
        with closing(Clock.running()) as clock:
            start, lateness = clock.now(), []
            for k in range(1, 201):
                await clock.sleep_until(start + k * 0.002 + 0.0003)
                lateness.append(clock.now() - (start + k * 0.002 + 0.0003))
            assert min(lateness) >= 0.0
            return statistics.quantiles(lateness, n=4)[0]  # other programs make the others late

    assert run_real(main) < 0.5e-3


@pytest.mark.parametrize("busy_poll_s", [0.0, 0.004, 1.0], ids=["asleep", "awake at first", "awake"])
def test_timers_run_in_order_and_never_early(busy_poll_s: float) -> None:
    async def main() -> None:
        with closing(Clock.running()) as clock:
            assert not clock.is_virtual
            start = clock.now()
            calls: list[tuple[float, bool]] = []

            def see(delay: float) -> None:
                calls.append((delay, clock.now() >= start + delay))

            for delay in (0.02, 0.005, -1.0, 0.01, 0.005):
                clock.call_at(start + delay, partial(see, delay))
            clock.call_at(start + 0.007, lambda: calls.append((0.007, True))).cancel()
            assert calls == []
            await clock.sleep_until(start + 0.03)
            assert calls == [(-1.0, True), (0.005, True), (0.005, True), (0.01, True), (0.02, True)]

    run_real(main, busy_poll_s)


def test_cancelled_and_failing_timers_affect_no_other() -> None:
    async def main() -> None:
        loop, errors = asyncio.get_running_loop(), []
        loop.set_exception_handler(lambda _, context: errors.append(context["exception"]))
        with closing(Clock.running()) as clock:
            start, done = clock.now(), []
            for k in range(500):
                clock.call_at(start + 60 + k, lambda: done.append("never")).cancel()
            clock.call_at(start + 0.001, lambda: dict[str, object]()["fails"])
            clock.call_at(start + 0.001, lambda: done.append("other"))
            with pytest.raises(TimeoutError):
                async with asyncio.timeout(0.01):
                    await clock.sleep_until(start + 3600)
            assert done == ["other"]
            assert [type(error) for error in errors] == [KeyError]

    run_real(main)


def test_closed_clock_makes_no_call() -> None:
    async def main() -> None:
        clock, calls = Clock.running(), []
        clock.call_at(clock.now() + 0.005, lambda: calls.append(1))
        clock.close()
        clock.close()
        await asyncio.sleep(0.02)
        assert calls == []

    run_real(main)


def test_wall_time_accepts_only_recent_stamps() -> None:
    async def main() -> None:
        with closing(Clock.running()) as clock:
            now = clock.now()
            wall = clock.wall_ns(now)
            assert clock.wall_ns(now + 1.0) - wall == pytest.approx(1_000_000_000, abs=2)
            assert clock.at_wall(wall / 1e9) == pytest.approx(now, abs=0.1)
            assert clock.at_wall(wall / 1e9 - 3600) >= now
            assert clock.at_wall(wall / 1e9 + 3600) >= now

    run_real(main)
