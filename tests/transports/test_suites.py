"""The suites for wires detect errors: each faulty wire fails the corresponding test."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import Any

import pytest

from hil_bridge.clock import Clock
from hil_bridge.errors import TransportError
from hil_bridge.testing import datagrams, streams
from hil_bridge.testing import transports as suites
from hil_bridge.testing.ends import run_check
from hil_bridge.transports import connect_datagrams, listen_datagrams, memory_pair
from protocol.datagram import Datagram


class Spoilt:
    """Correct wire; each subclass has one error."""

    def __init__(self, inner: Any) -> None:
        self.inner = inner
        self.on_data: Callable[[Any], None] = lambda data: None
        self.on_end: Callable[[Any], None] = lambda error: None

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)

    def start(self, on_data: Callable[[Any], None], on_end: Callable[[Any], None]) -> None:
        self.on_data, self.on_end = on_data, on_end
        self.inner.start(lambda data: on_data(self.changed(data)), on_end)

    def changed(self, data: Any) -> Any:
        return data


class Splits(Spoilt):
    def changed(self, data: Any) -> Any:
        return [Datagram(part, d.received_at) for d in data for part in (d[:1], d[1:])]


class Joins(Spoilt):
    def changed(self, data: Any) -> Any:
        return [Datagram(b"".join(data) * 2, data[0].received_at)]


class WithoutArrivalTimes(Spoilt):
    def changed(self, data: Any) -> Any:
        return [bytes(datagram) for datagram in data]


class CountsNoLoss(Spoilt):
    @property
    def statistics(self) -> Any:
        return replace(self.inner.statistics, lost=0)


class TakesAnySize(Spoilt):
    def send(self, data: Any) -> None:
        self.inner.send([datagram[:1000] for datagram in data])


class SendsUntilTooLarge(Spoilt):
    def send(self, data: Any) -> None:
        for datagram in data:
            self.inner.send([datagram])


class DeliversAfterTheEnd(Spoilt):
    async def aclose(self) -> None:
        ended = self.inner._delivery.ended
        await self.inner.aclose()
        if not ended:
            self.on_data([Datagram(b"late", 0.0)])


class EndsTwice(Spoilt):
    async def aclose(self) -> None:
        await self.inner.aclose()
        self.on_end(ValueError("again"))


class NeverEnds(Spoilt):
    def start(self, on_data: Callable[[Any], None], on_end: Callable[[Any], None]) -> None:
        self.on_data, self.on_end = on_data, on_end
        self.inner.start(on_data, lambda error: None)


class EndsWithItsPeer(Spoilt):
    def send(self, data: Any) -> None:
        self.inner.send(data)
        if self.inner.statistics.unreachable:
            self.inner.cut()


class DeliversWithinSend(Spoilt):
    other: Any

    def send(self, data: Any) -> None:
        self.inner.send(data)
        self.other.on_data([Datagram(d, 0.0) for d in data])


FAILURES = (AssertionError, TransportError, pytest.fail.Exception)


@pytest.mark.parametrize(
    ("kind", "test"),
    [
        (Splits, "test_boundaries_are_kept"),
        (Joins, "test_boundaries_are_kept"),
        (CountsNoLoss, "test_loss_is_counted"),
        (DeliversWithinSend, "test_nothing_arrives_within_send"),
        (WithoutArrivalTimes, "test_arrivals_have_a_time"),
        (TakesAnySize, "test_a_datagram_that_is_too_large_is_refused"),
        (SendsUntilTooLarge, "test_a_datagram_that_is_too_large_is_refused"),
        (EndsTwice, "test_each_end_closes"),
        (NeverEnds, "test_each_end_closes"),
        (NeverEnds, "test_a_broken_end"),
        (NeverEnds, "test_close_before_the_start"),
        (DeliversAfterTheEnd, "test_nothing_arrives_after_the_end"),
        (EndsWithItsPeer, "test_the_right_end_goes"),
    ],
)
def test_suite_detects_faulty_datagram_wire(kind: type[Spoilt], test: str) -> None:
    @asynccontextmanager
    async def open_ends(clock: Clock) -> AsyncIterator[Any]:
        listening = await listen_datagrams("udp+memory:robot", clock)
        left = kind(await connect_datagrams("udp+memory:robot?loss=0.1&seed=1", clock))
        right = kind(listening.transport)
        left.other, right.other = right, left  # type: ignore[attr-defined]
        yield left, right

    case = suites.DatagramCase("spoilt", open_ends, cut=lambda wire: wire.cut(), virtual=True)
    with pytest.raises(FAILURES):
        getattr(suites.TestDatagramWire(), test)(case)


class Reverses(Spoilt):
    def changed(self, data: Any) -> Any:
        return data[::-1]


@pytest.mark.parametrize(
    ("kind", "test"),
    [
        (Reverses, "test_order_both_ways"),
        (EndsTwice, "test_left_own_close"),
        (NeverEnds, "test_right_own_close"),
    ],
)
def test_suite_detects_faulty_stream(kind: type[Spoilt], test: str) -> None:
    @asynccontextmanager
    async def open_ends(clock: Clock) -> AsyncIterator[Any]:
        left, right = memory_pair(clock)
        yield kind(left), kind(right)

    with pytest.raises(FAILURES):
        getattr(suites.TestStreamWire(), test)(suites.StreamCase("spoilt", open_ends, virtual=True))


def test_suite_contains_every_check() -> None:
    for module, suite, parts in (
        (streams, suites.TestStreamWire, {"check_own_close", "check_peer_closes"}),
        (datagrams, suites.TestDatagramWire, set()),
    ):
        checks = {name for name in vars(module) if name.startswith("check_")} - parts
        assert {name.replace("check_", "test_") for name in checks} == {
            name for name in vars(suite) if name.startswith("test_")
        }


def test_suite_fails_for_exception_in_callback() -> None:
    class Raises(Spoilt):
        def changed(self, data: Any) -> Any:
            assert data != b"early"
            return data

    @asynccontextmanager
    async def open_ends(clock: Clock) -> AsyncIterator[Any]:
        left, right = memory_pair(clock)
        clock.loop.call_soon(left.send, b"early")
        yield left, Raises(right)

    async def wait(case: Any, left: Any, right: Any) -> None:
        right.start(lambda data: None, lambda error: None)
        await asyncio.sleep(0.01)

    with pytest.raises(AssertionError, match="exception"):
        run_check(suites.StreamCase("spoilt", open_ends), wait)
