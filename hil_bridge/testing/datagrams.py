"""Contract of unreliable wires: datagrams arrive complete or not at all, and lost datagrams are counted.

import pytest
from hil_bridge.testing.datagrams import *

@pytest.fixture
def datagram_case():
    return DatagramCase("mine", open_two_ends)
"""

import asyncio
from asyncio import sleep as pass_time  # in virtual time, where nothing waits
from collections.abc import Awaitable, Callable
from contextlib import suppress

import pytest

from hil_bridge.errors import TransportBroken, TransportClosed, TransportError
from hil_bridge.testing.ends import DatagramCase, Ear, run_check
from hil_bridge.transports import DatagramWire
from hil_bridge.transports.datagram import LARGEST_BYTES
from protocol.datagram import arrived_at

__all__ = ["DatagramCase", "TestDatagramWire"]

TRIES = 300
"""Maximum number of attempts to send a datagram before it counts as deliberately dropped.

Chosen: a wire that loses half of the datagrams passes, and so does a computer that is busy for a second.
"""
PAUSE_S = 0.01
"""Pause between two attempts, s. Chosen."""
_HELLO = b"hello"


async def _repeat(sender: DatagramWire, payloads: list[bytes], ear: Ear) -> None:
    """Send the datagrams repeatedly until each has been received."""
    for _ in range(TRIES):
        sender.send(payloads)
        await pass_time(PAUSE_S)
        if set(payloads) <= set(ear.datagrams):
            return
    lost = [datagram[:10] for datagram in payloads if datagram not in ear.datagrams]
    raise AssertionError(f"sent {TRIES} times but never received: {lost}")


async def _balance(left: DatagramWire, right: DatagramWire) -> None:
    """Check that every datagram from the left end was received or counted as lost, and that the right end sent
    nothing.
    """
    for _ in range(TRIES):
        here, there = left.statistics, right.statistics
        gone = here.lost + there.lost + here.unreachable + there.refused + there.overruns
        into, out = here.sent + here.duplicated + there.duplicated, there.received + gone
        if into == out:
            return
        await pass_time(PAUSE_S)
    raise AssertionError(f"{into} datagrams were sent, but {out} are accounted for: {here}, {there}")


async def check_boundaries_are_kept(case: DatagramCase, left: DatagramWire, right: DatagramWire) -> None:
    here, there = Ear(case, left), Ear(case, right)
    sizes = (0, 1, 2, 9, 100, 1472, 1473, 9000, LARGEST_BYTES)
    payloads = [bytes([k]) * size for k, size in enumerate(sizes)]
    await _repeat(left, payloads, there)
    await _repeat(right, payloads, here)
    for ear in (here, there):
        assert set(ear.datagrams) == set(payloads), "a datagram arrived that was not sent"
        assert all(isinstance(datagram, bytes) for datagram in ear.datagrams)


async def check_loss_is_counted(case: DatagramCase, left: DatagramWire, right: DatagramWire) -> None:
    there = Ear(case, right)
    payloads = [b"%04d" % k for k in range(600)]
    for at in range(0, len(payloads), 20):
        left.send(payloads[at : at + 20])
        await pass_time(0.001)
    await _balance(left, right)
    assert left.statistics.sent == len(payloads)
    assert right.statistics.received == len(there.datagrams)
    assert set(there.datagrams) <= set(payloads)
    copies = len(there.datagrams) - len(set(there.datagrams))
    assert copies <= left.statistics.duplicated + right.statistics.duplicated


async def check_sending_never_blocks(case: DatagramCase, left: DatagramWire, right: DatagramWire) -> None:
    """Check that sending never blocks, even if the other end does not read: datagrams beyond its queue are lost."""
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
    # the kernel stamps with another clock, and the conversion takes some microseconds
    assert all(began - 0.01 <= arrived_at(datagram, -1.0) <= now for datagram in there.datagrams)


async def check_a_datagram_that_is_too_large_is_refused(
    case: DatagramCase, left: DatagramWire, right: DatagramWire
) -> None:
    there = Ear(case, right)
    with pytest.raises(TransportError, match="too large") as refused:
        left.send([b"small", bytes(LARGEST_BYTES + 1)])
    assert type(refused.value) is TransportError
    await _repeat(left, [_HELLO], there)
    assert set(there.datagrams) == {_HELLO}, "part of a refused datagram arrived"


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
    received = len(there.datagrams)
    left.send([b"%d" % k for k in range(50)])
    await pass_time(0.3)
    assert len(there.datagrams) == received
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
        stays.send([_HELLO])
        await pass_time(PAUSE_S)
    assert ear.ends == []


async def check_a_broken_end(case: DatagramCase, left: DatagramWire, right: DatagramWire) -> None:
    if case.cut is None:
        pytest.skip("this wire cannot be cut in a test")
    here, there = Ear(case, left), Ear(case, right)
    await _repeat(left, [_HELLO], there)
    case.cut(left)
    for _ in range(TRIES):
        if here.ends:
            break
        with suppress(TransportError):
            right.send([_HELLO])
        await pass_time(PAUSE_S)
    assert [type(error) for error in here.ends] == [TransportBroken]
    reason = str(here.ends[0])
    assert left.name in reason
    with pytest.raises(TransportBroken):
        left.send([b"late"])
    await left.aclose()
    assert len(here.ends) == 1
    assert there.ends == []


def _datagram(
    check: Callable[[DatagramCase, DatagramWire, DatagramWire], Awaitable[None]],
) -> Callable[[object, DatagramCase], None]:
    def test(self: object, datagram_case: DatagramCase) -> None:
        run_check(datagram_case, check)

    return test


class TestDatagramWire:
    """Contract of unreliable wires for datagrams, which tests the fixture `datagram_case`."""

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
