"""The one suite that every transport passes. Here it runs in virtual time; tests/live loads the same checks.

A case opens two ends that are connected. The checks speak of bytes; a case says how its wire carries them.
"""

import asyncio
from asyncio import sleep as pass_time  # in virtual time, where nobody waits
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass
from typing import Any

import pytest

from hil_bridge.clock import Clock, run_virtual
from hil_bridge.errors import (
    TransportBroken,
    TransportClosed,
    TransportEnded,
    TransportError,
    TransportUnavailable,
)
from hil_bridge.transports import (
    Delayed,
    Direction,
    Faults,
    Faulty,
    LineSettings,
    MemoryCanBus,
    Paced,
    Parity,
    Reconnecting,
    Tap,
    Transport,
    UsbAdapter,
    UsbAdapterProfile,
    connect_bytes,
    connect_can,
    listen_bytes,
    listen_can,
    memory_pair,
)
from hil_bridge.transports.rfc2217 import Rfc2217Client, Rfc2217Port
from protocol.can import CanFrame

Ends = tuple[Transport[Any], Transport[Any]]


@dataclass(frozen=True)
class Case:
    """One kind of wire. The left end is the one that a client opens."""

    name: str
    open: Callable[[Clock], AbstractAsyncContextManager[Ends]]
    frames: bool = False
    peer_end: type[TransportError] | None = TransportEnded
    """What the left end ends with when the right one closes; None where a wire does not tell."""
    peer_end_right: type[TransportError] | None = TransportEnded
    volume: int = 100_000
    """Bytes for the big transfer; less than a queue where the peer of a slow line can send without limit."""

    def pack(self, data: bytes) -> Any:
        if not self.frames:
            return data
        return [CanFrame(0x100, data[k : k + 8]) for k in range(0, len(data), 8)]

    def unpack(self, data: Any) -> bytes:
        return b"".join(frame.data for frame in data) if self.frames else data


class Ear:
    """Listens to one end."""

    def __init__(self, case: Case, transport: Transport[Any]) -> None:
        self._case = case
        self._news = asyncio.Event()
        self.data = b""
        self.ends: list[TransportError] = []
        transport.start(self._on_data, self._on_end)

    def _on_data(self, data: Any) -> None:
        assert not self.ends, "data after the end"
        assert len(data), "empty data"
        self.data += self._case.unpack(data)
        self._news.set()

    def _on_end(self, error: TransportError) -> None:
        self.ends.append(error)
        self._news.set()

    async def until(self, holds: Callable[[], bool], limit: float = 30.0) -> None:
        async with asyncio.timeout(limit):
            while not holds():
                self._news.clear()
                await self._news.wait()


async def send_all(case: Case, end: Transport[Any], data: bytes) -> None:
    """Send more than a queue holds: wait whenever it is full."""
    for at in range(0, len(data), 2048):
        while True:
            try:
                end.send(case.pack(data[at : at + 2048]))
                break
            except (TransportClosed, TransportBroken, TransportEnded):
                raise
            except TransportError:
                await pass_time(0.02)


async def check_order_both_ways(case: Case, left: Transport[Any], right: Transport[Any]) -> None:
    here, there = Ear(case, left), Ear(case, right)
    for k in range(50):
        left.send(case.pack(b"L%03d" % k))
        right.send(case.pack(b"R%03d" % k))
    await there.until(lambda: len(there.data) >= 200)
    await here.until(lambda: len(here.data) >= 200)
    assert there.data == b"".join(b"L%03d" % k for k in range(50))
    assert here.data == b"".join(b"R%03d" % k for k in range(50))


async def check_big_transfer_both_ways(case: Case, left: Transport[Any], right: Transport[Any]) -> None:
    here, there = Ear(case, left), Ear(case, right)
    data = (bytes(range(256)) * (case.volume // 256 + 1))[: case.volume]
    await asyncio.gather(send_all(case, left, data), send_all(case, right, data[::-1]))
    await there.until(lambda: len(there.data) >= len(data), 600)
    await here.until(lambda: len(here.data) >= len(data), 600)
    assert there.data == data
    assert here.data == data[::-1]


async def check_start_delivers_what_came_before(
    case: Case, left: Transport[Any], right: Transport[Any]
) -> None:
    left.send(case.pack(b"early"))
    right.send(case.pack(b"bird"))
    await pass_time(0.05)
    here, there = Ear(case, left), Ear(case, right)
    await there.until(lambda: there.data == b"early")
    await here.until(lambda: here.data == b"bird")


async def check_left_own_close(case: Case, left: Transport[Any], right: Transport[Any]) -> None:
    await check_own_close(case, left)


async def check_right_own_close(case: Case, left: Transport[Any], right: Transport[Any]) -> None:
    await check_own_close(case, right)


async def check_own_close(case: Case, end: Transport[Any]) -> None:
    ear = Ear(case, end)
    await end.aclose()
    assert [type(error) for error in ear.ends] == [TransportClosed]
    await end.aclose()
    assert len(ear.ends) == 1
    with pytest.raises(TransportClosed):
        end.send(case.pack(b"late"))


async def check_close_hands_over_what_is_queued(
    case: Case, left: Transport[Any], right: Transport[Any]
) -> None:
    there = Ear(case, right)
    left.send(case.pack(b"last words" * 20))
    await left.aclose()
    await there.until(lambda: there.data == b"last words" * 20)


async def check_left_closes(case: Case, left: Transport[Any], right: Transport[Any]) -> None:
    await check_peer_closes(case, right, left, case.peer_end_right)


async def check_right_closes(case: Case, left: Transport[Any], right: Transport[Any]) -> None:
    await check_peer_closes(case, left, right, case.peer_end)


async def check_peer_closes(
    case: Case, end: Transport[Any], peer: Transport[Any], expected: type[TransportError] | None
) -> None:
    ear = Ear(case, end)
    Ear(case, peer)
    peer.send(case.pack(b"bye"))
    await ear.until(lambda: ear.data == b"bye")
    await peer.aclose()
    if expected is None:
        await pass_time(0.05)
        assert ear.ends == []
        return
    await ear.until(lambda: bool(ear.ends))
    assert [type(error) for error in ear.ends] == [expected]
    assert end.name in str(ear.ends[0]) or "pty" in str(ear.ends[0])
    with pytest.raises(expected):
        end.send(case.pack(b"late"))
    await end.aclose()
    assert len(ear.ends) == 1


async def check_close_before_start(case: Case, left: Transport[Any], right: Transport[Any]) -> None:
    await left.aclose()
    assert [type(error) for error in Ear(case, left).ends] == [TransportClosed]


CHECKS: tuple[Callable[[Case, Transport[Any], Transport[Any]], Awaitable[None]], ...] = (
    check_order_both_ways,
    check_big_transfer_both_ways,
    check_start_delivers_what_came_before,
    check_left_own_close,
    check_right_own_close,
    check_close_hands_over_what_is_queued,
    check_left_closes,
    check_right_closes,
    check_close_before_start,
)


async def run_check(check: Callable[..., Awaitable[None]], case: Case) -> None:
    """Open the ends, check, close."""
    clock = Clock.running()
    try:
        async with case.open(clock) as (left, right):
            try:
                await check(case, left, right)
            finally:
                await left.aclose()
                await right.aclose()
    finally:
        clock.close()


def _around(wrap: Callable[[Transport[bytes], Clock], Transport[bytes]]) -> Callable[[Clock], Any]:
    @asynccontextmanager
    async def open_wrapped(clock: Clock) -> AsyncIterator[Ends]:
        left, right = memory_pair(clock, 0.001)
        yield wrap(left, clock), right

    return open_wrapped


@asynccontextmanager
async def _memory(clock: Clock) -> AsyncIterator[Ends]:
    yield memory_pair(clock)


@asynccontextmanager
async def _memory_url(clock: Clock) -> AsyncIterator[Ends]:
    listening = await listen_bytes("memory:robot", clock)
    yield await connect_bytes("memory:robot?latency_ms=2&baudrate=115200", clock), listening.transport


@asynccontextmanager
async def _adapter_url(clock: Clock) -> AsyncIterator[Ends]:
    listening = await listen_bytes("memory:robot?baudrate=115200", clock)
    yield await connect_bytes("memory:robot?usb_latency_ms=16", clock), listening.transport


@asynccontextmanager
async def _rfc2217(clock: Clock) -> AsyncIterator[Ends]:
    left, right = memory_pair(clock, 0.001)
    server = Rfc2217Port(LINE, clock).serve(right)
    client = Rfc2217Client(left, LINE, clock, lambda kind, text: None)
    await client.ready()
    yield client, server


async def _never() -> Transport[bytes]:
    raise TransportUnavailable("nothing here")


@asynccontextmanager
async def _memory_can(clock: Clock) -> AsyncIterator[Ends]:
    bus = MemoryCanBus(clock, 1_000_000)
    yield bus.connect(), bus.connect()


@asynccontextmanager
async def _memory_can_url(clock: Clock) -> AsyncIterator[Ends]:
    listening = await listen_can("can+memory:sensor?bitrate=500000", clock)
    yield await connect_can("can+memory:sensor", clock), listening.transport


LINE = LineSettings(9600, Parity.EVEN)
CASES = (
    Case("memory", _memory),
    Case("paced", _around(lambda wire, clock: Paced(wire, LINE, clock)), volume=60_000),
    Case(
        "usb adapter",
        _around(lambda wire, clock: UsbAdapter(wire, UsbAdapterProfile(), clock)),
        volume=60_000,
    ),
    Case(
        "usb adapter of the peer",
        _around(lambda wire, clock: UsbAdapter(wire, UsbAdapterProfile(), clock, Direction.SENT)),
        volume=60_000,
    ),
    Case("usb adapter on a line", _adapter_url, peer_end_right=None, volume=60_000),
    Case("rfc2217", _rfc2217),
    Case(
        "reconnecting",
        _around(lambda wire, clock: Reconnecting(wire, _never, 0.05, clock, lambda kind, text: None)),
        peer_end=TransportBroken,
    ),
    Case("delayed", _around(lambda wire, clock: Delayed(wire, 0.020, clock))),
    Case("tap", _around(lambda wire, clock: Tap(wire, lambda direction, data: None))),
    Case("faultless", _around(lambda wire, clock: Faulty(wire, Faults()))),
    # a listener stays when its client goes
    Case("memory url", _memory_url, peer_end_right=None, volume=60_000),
    Case("memory CAN", _memory_can, frames=True, peer_end=None, peer_end_right=None),
    Case("memory CAN url", _memory_can_url, frames=True, peer_end=None, peer_end_right=None),
)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_virtual(check: Callable[..., Awaitable[None]], case: Case) -> None:
    run_virtual(lambda: run_check(check, case))
