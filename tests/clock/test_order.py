"""Drawn order of callbacks in virtual time: which callbacks change places, and how a failing order is reduced."""

import asyncio
from collections.abc import Collection
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bridge.clock import VIRTUAL_EPOCH, Clock, run_virtual
from hil_bridge.clock.order import Deviation, OrderDraws, VirtualOrder
from hil_bridge.lab.campaign.orders import fewest

SEEDS = range(20)


def called(order: OrderDraws | None, deferrable: bool = False) -> tuple[str, ...]:
    """Return the order of three timers that are due together, and of two callbacks that are ready together."""

    async def main() -> tuple[str, ...]:
        clock, names = Clock.running(), list[str]()
        at = VIRTUAL_EPOCH + 1e-3
        if deferrable:
            clock.call_deferrable(at, lambda until: at, lambda: names.append("deferrable"))
        for name in ("a", "b", "c"):
            clock.call_at(at, partial(names.append, name))
        await clock.sleep_until(VIRTUAL_EPOCH + 2e-3)
        for name in ("d", "e"):
            clock.call_soon(partial(names.append, name))
        for _ in range(3):
            await asyncio.sleep(0)
        return tuple(names)

    return run_virtual(main, order)


def drawn(shuffled: str, deferrable: bool = False) -> set[tuple[str, ...]]:
    orders = (VirtualOrder(shuffled, seed) for seed in SEEDS)  # type: ignore[arg-type]
    return {called(order.draws(), deferrable) for order in orders}


def test_usual_order_draws_nothing() -> None:
    assert VirtualOrder().draws() is None
    assert drawn("none") == {("a", "b", "c", "d", "e")}


def test_timers_change_places_and_ready_callbacks_do_not() -> None:
    orders = drawn("timers")
    assert len({names[:3] for names in orders}) == 6
    assert {names[3:] for names in orders} == {("d", "e")}


def test_all_changes_ready_callbacks_too() -> None:
    assert {names[3:] for names in drawn("all")} == {("d", "e"), ("e", "d")}


def test_deferrable_timer_changes_places_with_others() -> None:
    places = {names.index("deferrable") for names in drawn("timers", deferrable=True)}
    assert places == {0, 3}


def test_same_seed_draws_same_order() -> None:
    assert len({called(VirtualOrder("all", 3).draws()) for _ in range(3)}) == 1


def test_late_loop_runs_timers_in_their_order_within_bound() -> None:
    async def main() -> list[tuple[int, float]]:
        clock, calls = Clock.running(), list[tuple[int, float]]()

        def call(number: int, at: float) -> None:
            calls.append((number, clock.now() - at))

        for number in range(200):
            at = VIRTUAL_EPOCH + number * 1e-4
            clock.call_at(at, partial(call, number, at))
        await clock.sleep_until(VIRTUAL_EPOCH + 1.0)
        return calls

    calls = run_virtual(main, VirtualOrder(late_us=250.0).draws())
    assert [number for number, _ in calls] == [*range(200)]
    lateness = [late for _, late in calls]
    assert min(lateness) >= 0.0
    assert 240e-6 < max(lateness) <= 250e-6


def test_only_named_iterations_deviate_and_are_observed() -> None:
    order, deviations = VirtualOrder("timers", 2), list[Deviation]()
    usual = called(None)
    assert called(OrderDraws(order, only=())) == usual
    changed = called(OrderDraws(order, observe=deviations.append))
    assert changed != usual
    (deviation,) = deviations
    assert called(OrderDraws(order, only=[deviation.number])) == changed
    assert str(deviation).endswith(f" at {VIRTUAL_EPOCH + 1e-3:.6f} s")
    assert sorted(deviation.usual) == sorted(deviation.drawn)


@given(st.sets(st.integers(0, 300), min_size=1, max_size=4))
def test_reduction_keeps_exactly_what_fails(guilty: set[int]) -> None:
    def fails(numbers: Collection[int]) -> bool:
        return guilty <= set(numbers)

    assert set(fewest([*range(301)], fails)) == guilty


@pytest.mark.parametrize("late_us", [-1.0, 2000.0])
def test_lateness_is_below_shortest_period(late_us: float) -> None:
    with pytest.raises(ValueError, match="late_us"):
        VirtualOrder(late_us=late_us)
