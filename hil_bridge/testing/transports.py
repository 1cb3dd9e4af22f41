"""Tests that every wire has to pass, for the test module of those who write one.

    import pytest
    from hil_bridge.testing.transports import StreamCase, TestStreamWire

    @pytest.fixture
    def stream_case():
        return StreamCase("mine", open_two_ends)

pytest then finds the tests of the class in that module. There are two contracts:

- `TestStreamWire`, fixture `stream_case`: bytes or CAN frames that arrive once and in order.
- `TestDatagramWire`, fixture `datagram_case`: datagrams that arrive whole or not at all. Their order may differ, and
  what is lost is counted.

A case opens two ends that are connected. The left end is the one that a client opens, and on a datagram wire it is
the one that speaks first.
"""

import asyncio
import threading
from asyncio import sleep as pass_time  # in virtual time, where nothing waits
from collections.abc import Awaitable, Callable
from contextlib import AbstractAsyncContextManager, suppress
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import pytest

from hil_bridge.clock import Clock, run_real, run_virtual
from hil_bridge.errors import (
    TransportBroken,
    TransportClosed,
    TransportEnded,
    TransportError,
)
from hil_bridge.transports import DatagramWire, Transport
from hil_bridge.transports.datagram import LARGEST_BYTES
from protocol.can import CanFrame
from protocol.datagram import arrived_at

__all__ = ["DatagramCase", "Ear", "StreamCase", "TestDatagramWire", "TestStreamWire"]

Ends: TypeAlias = tuple[Transport[Any], Transport[Any]]


class Case(Protocol):
    """What both kinds of case have."""

    @property
    def open(self) -> Callable[[Clock], AbstractAsyncContextManager[tuple[Any, Any]]]:
        """Opens the left and the right end."""

    @property
    def virtual(self) -> bool:
        """Whether the wire works in virtual time; else the tests take real time."""

    def unpack(self, data: Any) -> bytes:
        """The bytes of what arrived on a stream."""


@dataclass(frozen=True)
class StreamCase:
    """One kind of reliable, ordered wire. The checks speak of bytes; a case says how its wire carries them."""

    name: str
    open: Callable[[Clock], AbstractAsyncContextManager[Ends]]
    frames: bool = False
    """Whether it carries CAN frames."""
    peer_end: type[TransportError] | None = TransportEnded
    """What the left end ends with when the right one closes; None where a wire does not tell."""
    peer_end_right: type[TransportError] | None = TransportEnded
    volume: int = 100_000
    """Bytes for the big transfer; less than a queue where the peer of a slow line can send without limit."""
    virtual: bool = False

    def pack(self, data: bytes) -> Any:
        """Bytes as the wire takes them."""
        if not self.frames:
            return data
        return [CanFrame(0x100, data[k : k + 8]) for k in range(0, len(data), 8)]

    def unpack(self, data: Any) -> bytes:
        """The bytes of what arrived."""
        return b"".join(frame.data for frame in data) if self.frames else data


@dataclass(frozen=True)
class DatagramCase:
    """One kind of unreliable wire for datagrams. A faulty one loses less than half of them."""

    name: str
    open: Callable[[Clock], AbstractAsyncContextManager[tuple[DatagramWire, DatagramWire]]]
    cut: Callable[[Any], None] | None = None
    """Breaks the left end; it may become known when the other side speaks next. None: cannot be done in a test."""
    peer_end: type[TransportError] | None = None
    """What an end ends with when the other one closes; None where a wire does not tell."""
    virtual: bool = False

    def unpack(self, data: Any) -> bytes:
        """Nothing: datagrams are not joined."""
        return b""


class Ear:
    """Listens to one end, and checks what holds for every arrival."""

    def __init__(self, case: Case, transport: Any) -> None:
        self._case = case
        self._news = asyncio.Event()
        self._thread = threading.get_ident()
        self.data = b""
        """Everything that arrived on a stream, joined."""
        self.batches: list[Any] = []
        """What arrived, as it was delivered."""
        self.ends: list[TransportError] = []
        transport.start(self._on_data, self._on_end)

    @property
    def datagrams(self) -> list[bytes]:
        """Datagrams in the order of their arrival."""
        return [datagram for batch in self.batches for datagram in batch]

    def _on_data(self, data: Any) -> None:
        assert threading.get_ident() == self._thread, "called from another thread"
        assert not self.ends, "data after the end"
        assert len(data), "empty data"
        self.batches.append(data)
        self.data += self._case.unpack(data)
        self._news.set()

    def _on_end(self, error: TransportError) -> None:
        assert threading.get_ident() == self._thread, "called from another thread"
        self.ends.append(error)
        self._news.set()

    async def until(self, holds: Callable[[], bool], limit: float = 30.0) -> None:
        """Wait until it holds, for `limit` s at most."""
        async with asyncio.timeout(limit):
            while not holds():
                self._news.clear()
                await self._news.wait()


# --- the contract of a stream


async def send_all(case: StreamCase, end: Transport[Any], data: bytes) -> None:
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


async def check_order_both_ways(case: StreamCase, left: Transport[Any], right: Transport[Any]) -> None:
    here, there = Ear(case, left), Ear(case, right)
    for k in range(50):
        left.send(case.pack(b"L%03d" % k))
        right.send(case.pack(b"R%03d" % k))
    await there.until(lambda: len(there.data) >= 200)
    await here.until(lambda: len(here.data) >= 200)
    assert there.data == b"".join(b"L%03d" % k for k in range(50))
    assert here.data == b"".join(b"R%03d" % k for k in range(50))


async def check_big_transfer_both_ways(case: StreamCase, left: Transport[Any], right: Transport[Any]) -> None:
    here, there = Ear(case, left), Ear(case, right)
    data = (bytes(range(256)) * (case.volume // 256 + 1))[: case.volume]
    await asyncio.gather(send_all(case, left, data), send_all(case, right, data[::-1]))
    await there.until(lambda: len(there.data) >= len(data), 600)
    await here.until(lambda: len(here.data) >= len(data), 600)
    assert there.data == data
    assert here.data == data[::-1]


async def check_start_delivers_what_came_before(
    case: StreamCase, left: Transport[Any], right: Transport[Any]
) -> None:
    left.send(case.pack(b"early"))
    right.send(case.pack(b"bird"))
    await pass_time(0.05)
    here, there = Ear(case, left), Ear(case, right)
    await there.until(lambda: there.data == b"early")
    await here.until(lambda: here.data == b"bird")


async def check_left_own_close(case: StreamCase, left: Transport[Any], right: Transport[Any]) -> None:
    await check_own_close(case, left)


async def check_right_own_close(case: StreamCase, left: Transport[Any], right: Transport[Any]) -> None:
    await check_own_close(case, right)


async def check_own_close(case: StreamCase, end: Transport[Any]) -> None:
    ear = Ear(case, end)
    await end.aclose()
    assert [type(error) for error in ear.ends] == [TransportClosed]
    await end.aclose()
    assert len(ear.ends) == 1
    with pytest.raises(TransportClosed):
        end.send(case.pack(b"late"))


async def check_close_hands_over_what_is_queued(
    case: StreamCase, left: Transport[Any], right: Transport[Any]
) -> None:
    there = Ear(case, right)
    left.send(case.pack(b"last words" * 20))
    await left.aclose()
    await there.until(lambda: there.data == b"last words" * 20)


async def check_left_closes(case: StreamCase, left: Transport[Any], right: Transport[Any]) -> None:
    await check_peer_closes(case, right, left, case.peer_end_right)


async def check_right_closes(case: StreamCase, left: Transport[Any], right: Transport[Any]) -> None:
    await check_peer_closes(case, left, right, case.peer_end)


async def check_peer_closes(
    case: StreamCase, end: Transport[Any], peer: Transport[Any], expected: type[TransportError] | None
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


async def check_close_before_start(case: StreamCase, left: Transport[Any], right: Transport[Any]) -> None:
    await left.aclose()
    assert [type(error) for error in Ear(case, left).ends] == [TransportClosed]


# --- the contract of datagrams

TRIES = 300
"""How often a datagram is sent until it is taken for lost on purpose. Chosen: a wire that loses half of them, and a
computer that is busy for a second, pass."""
PAUSE_S = 0.01
"""Between two tries, s. Chosen."""
_HELLO = b"hello"


async def _repeat(sender: DatagramWire, said: list[bytes], ear: Ear) -> None:
    """Send until each was heard."""
    for _ in range(TRIES):
        sender.send(said)
        await pass_time(PAUSE_S)
        if set(said) <= set(ear.datagrams):
            return
    lost = [datagram[:10] for datagram in said if datagram not in ear.datagrams]
    raise AssertionError(f"sent {TRIES} times and never heard: {lost}")


async def _balance(left: DatagramWire, right: DatagramWire) -> None:
    """What left went into the network has come out, or is counted as lost; the right end has sent nothing."""
    for _ in range(TRIES):
        here, there = left.statistics, right.statistics
        gone = here.lost + there.lost + here.unreachable + there.refused + there.overruns
        into, out = here.sent + here.duplicated + there.duplicated, there.received + gone
        if into == out:
            return
        await pass_time(PAUSE_S)
    raise AssertionError(f"{into} datagrams went in, {out} are accounted for: {here}, {there}")


async def check_boundaries_are_kept(case: DatagramCase, left: DatagramWire, right: DatagramWire) -> None:
    here, there = Ear(case, left), Ear(case, right)
    sizes = (0, 1, 2, 9, 100, 1472, 1473, 9000, LARGEST_BYTES)
    said = [bytes([k]) * size for k, size in enumerate(sizes)]
    await _repeat(left, said, there)
    await _repeat(right, said, here)
    for ear in (here, there):
        assert set(ear.datagrams) == set(said), "a datagram arrived that was not sent"
        assert all(isinstance(datagram, bytes) for datagram in ear.datagrams)


async def check_loss_is_counted(case: DatagramCase, left: DatagramWire, right: DatagramWire) -> None:
    there = Ear(case, right)
    said = [b"%04d" % k for k in range(600)]
    for at in range(0, len(said), 20):
        left.send(said[at : at + 20])
        await pass_time(0.001)
    await _balance(left, right)
    assert left.statistics.sent == len(said)
    assert right.statistics.received == len(there.datagrams)
    assert set(there.datagrams) <= set(said)
    copies = len(there.datagrams) - len(set(there.datagrams))
    assert copies <= left.statistics.duplicated + right.statistics.duplicated


async def check_sending_never_blocks(case: DatagramCase, left: DatagramWire, right: DatagramWire) -> None:
    """Nobody reads at the other end, which then has lost what its queue could not hold."""
    clock, flood = asyncio.get_running_loop(), [bytes(1000)] * 100
    began = clock.time()
    for _ in range(50):
        left.send(flood)
    assert clock.time() - began < 2.0
    assert left.statistics.sent + left.statistics.dropped == 5000
    await pass_time(0.5)
    there = Ear(case, right)
    await _repeat(left, [_HELLO], there)
    assert right.statistics.received < 5000
    await _balance(left, right)


async def check_nothing_arrives_within_send(
    case: DatagramCase, left: DatagramWire, right: DatagramWire
) -> None:
    there = Ear(case, right)
    left.send([_HELLO])
    assert there.batches == []
    await _repeat(left, [_HELLO], there)


async def check_arrivals_have_a_time(case: DatagramCase, left: DatagramWire, right: DatagramWire) -> None:
    began = asyncio.get_running_loop().time()
    there = Ear(case, right)
    await _repeat(left, [_HELLO], there)
    now = asyncio.get_running_loop().time()
    # a kernel's stamp is of another clock, and turning it round takes some microseconds
    assert all(began - 0.01 <= arrived_at(datagram, -1.0) <= now for datagram in there.datagrams)


async def check_a_datagram_that_is_too_large_is_refused(
    case: DatagramCase, left: DatagramWire, right: DatagramWire
) -> None:
    there = Ear(case, right)
    with pytest.raises(TransportError, match="too large") as refused:
        left.send([b"small", bytes(LARGEST_BYTES + 1)])
    assert type(refused.value) is TransportError
    await _repeat(left, [_HELLO], there)
    assert set(there.datagrams) == {_HELLO}, "a part of what was refused has arrived"


async def check_start_delivers_earlier_datagrams(
    case: DatagramCase, left: DatagramWire, right: DatagramWire
) -> None:
    left.send([_HELLO] * 50)
    await pass_time(0.3)
    there = Ear(case, right)
    await there.until(lambda: _HELLO in there.datagrams)


async def check_silence_before_the_first_word(
    case: DatagramCase, left: DatagramWire, right: DatagramWire
) -> None:
    here, there = Ear(case, left), Ear(case, right)
    right.send([b"too early"] * 20)
    await pass_time(0.1)
    await _repeat(left, [_HELLO], there)
    await _repeat(right, [b"answer"], here)
    assert set(here.datagrams) == {b"answer"}
    assert right.statistics.dropped == 20


async def check_each_end_closes(case: DatagramCase, left: DatagramWire, right: DatagramWire) -> None:
    for end in (left, right):
        ear = Ear(case, end)
        await end.aclose()
        assert [type(error) for error in ear.ends] == [TransportClosed]
        await end.aclose()
        assert len(ear.ends) == 1
        with pytest.raises(TransportClosed):
            end.send([b"late"])


async def check_close_before_the_start(case: DatagramCase, left: DatagramWire, right: DatagramWire) -> None:
    for end in (left, right):
        await end.aclose()
        assert [type(error) for error in Ear(case, end).ends] == [TransportClosed]


async def check_nothing_arrives_after_the_end(
    case: DatagramCase, left: DatagramWire, right: DatagramWire
) -> None:
    there = Ear(case, right)
    await _repeat(left, [_HELLO], there)
    left.send([b"%d" % k for k in range(50)])
    await right.aclose()
    heard = len(there.datagrams)
    left.send([b"%d" % k for k in range(50)])
    await pass_time(0.3)
    assert len(there.datagrams) == heard
    assert len(there.ends) == 1


async def check_the_left_end_goes(case: DatagramCase, left: DatagramWire, right: DatagramWire) -> None:
    await _check_other_end_goes(case, left, right, leaves=left)


async def check_the_right_end_goes(case: DatagramCase, left: DatagramWire, right: DatagramWire) -> None:
    await _check_other_end_goes(case, left, right, leaves=right)


async def _check_other_end_goes(
    case: DatagramCase, left: DatagramWire, right: DatagramWire, leaves: DatagramWire
) -> None:
    here, there = Ear(case, left), Ear(case, right)
    await _repeat(left, [_HELLO], there)
    await _repeat(right, [_HELLO], here)
    stays, ear = (right, there) if leaves is left else (left, here)
    await leaves.aclose()
    if case.peer_end is not None:
        await ear.until(lambda: bool(ear.ends))
        assert [type(error) for error in ear.ends] == [case.peer_end]
        return
    for _ in range(20):
        stays.send([b"anybody there"])
        await pass_time(PAUSE_S)
    assert ear.ends == []


async def check_a_broken_end(case: DatagramCase, left: DatagramWire, right: DatagramWire) -> None:
    if case.cut is None:
        pytest.skip("this wire cannot be broken in a test")
    here, there = Ear(case, left), Ear(case, right)
    await _repeat(left, [_HELLO], there)
    case.cut(left)
    for _ in range(TRIES):
        if here.ends:
            break
        with suppress(TransportError):
            right.send([b"anybody there"])
        await pass_time(PAUSE_S)
    assert [type(error) for error in here.ends] == [TransportBroken]
    assert left.name in str(here.ends[0])
    with pytest.raises(TransportBroken):
        left.send([b"late"])
    await left.aclose()
    assert len(here.ends) == 1
    assert there.ends == []


# --- the suites


def _run(case: Case, check: Callable[[Any, Any, Any], Awaitable[None]]) -> None:
    """Open the ends, check, close; in virtual time where the wire can. What a callback raised is raised here."""
    raised: list[dict[str, Any]] = []

    async def main() -> None:
        clock = Clock.running()
        if not clock.is_virtual:  # which is strict itself
            clock.loop.set_exception_handler(lambda _, context: raised.append(context))
        try:
            async with case.open(clock) as (left, right):
                try:
                    await check(case, left, right)
                finally:
                    await left.aclose()
                    await right.aclose()
        finally:
            clock.close()

    if case.virtual:
        run_virtual(main)
    else:
        run_real(main)
    assert not raised, raised


def _stream(
    check: Callable[[StreamCase, Transport[Any], Transport[Any]], Awaitable[None]],
) -> Callable[[object, StreamCase], None]:
    def test(self: object, stream_case: StreamCase) -> None:
        _run(stream_case, check)

    return test


def _datagram(
    check: Callable[[DatagramCase, DatagramWire, DatagramWire], Awaitable[None]],
) -> Callable[[object, DatagramCase], None]:
    def test(self: object, datagram_case: DatagramCase) -> None:
        _run(datagram_case, check)

    return test


class TestStreamWire:
    """The contract of reliable, ordered wires, for the fixture `stream_case`."""

    test_order_both_ways = _stream(check_order_both_ways)
    test_big_transfer_both_ways = _stream(check_big_transfer_both_ways)
    test_start_delivers_what_came_before = _stream(check_start_delivers_what_came_before)
    test_left_own_close = _stream(check_left_own_close)
    test_right_own_close = _stream(check_right_own_close)
    test_close_hands_over_what_is_queued = _stream(check_close_hands_over_what_is_queued)
    test_left_closes = _stream(check_left_closes)
    test_right_closes = _stream(check_right_closes)
    test_close_before_start = _stream(check_close_before_start)


class TestDatagramWire:
    """The contract of unreliable wires for datagrams, for the fixture `datagram_case`."""

    test_boundaries_are_kept = _datagram(check_boundaries_are_kept)
    test_loss_is_counted = _datagram(check_loss_is_counted)
    test_sending_never_blocks = _datagram(check_sending_never_blocks)
    test_nothing_arrives_within_send = _datagram(check_nothing_arrives_within_send)
    test_arrivals_have_a_time = _datagram(check_arrivals_have_a_time)
    test_a_datagram_that_is_too_large_is_refused = _datagram(check_a_datagram_that_is_too_large_is_refused)
    test_start_delivers_earlier_datagrams = _datagram(check_start_delivers_earlier_datagrams)
    test_silence_before_the_first_word = _datagram(check_silence_before_the_first_word)
    test_each_end_closes = _datagram(check_each_end_closes)
    test_close_before_the_start = _datagram(check_close_before_the_start)
    test_nothing_arrives_after_the_end = _datagram(check_nothing_arrives_after_the_end)
    test_the_left_end_goes = _datagram(check_the_left_end_goes)
    test_the_right_end_goes = _datagram(check_the_right_end_goes)
    test_a_broken_end = _datagram(check_a_broken_end)
