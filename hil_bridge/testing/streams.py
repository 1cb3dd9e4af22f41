"""Contract of reliable, ordered wires: bytes or CAN frames arrive exactly once and in order.

import pytest
from hil_bridge.testing.streams import *

@pytest.fixture
def stream_case():
    return StreamCase("mine", open_two_ends)
"""

import asyncio
from asyncio import sleep as pass_time  # in virtual time, where nothing waits
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from hil_bridge.errors import TransportBroken, TransportClosed, TransportEnded, TransportError
from hil_bridge.testing.ends import Ear, StreamCase, run_check
from hil_bridge.transports import Transport

__all__ = ["StreamCase", "TestStreamWire"]


async def send_all(case: StreamCase, end: Transport[Any], data: bytes) -> None:
    """Send more data than a queue holds; wait whenever the queue is full."""
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
    reason = str(ear.ends[0])
    assert end.name in reason or "pty" in reason
    with pytest.raises(expected):
        end.send(case.pack(b"late"))
    await end.aclose()
    assert len(ear.ends) == 1


async def check_close_before_start(case: StreamCase, left: Transport[Any], right: Transport[Any]) -> None:
    await left.aclose()
    assert [type(error) for error in Ear(case, left).ends] == [TransportClosed]


def _stream(
    check: Callable[[StreamCase, Transport[Any], Transport[Any]], Awaitable[None]],
) -> Callable[[object, StreamCase], None]:
    def test(self: object, stream_case: StreamCase) -> None:
        run_check(stream_case, check)

    return test


class TestStreamWire:
    """Contract of reliable, ordered wires, which tests the fixture `stream_case`."""

    test_order_both_ways = _stream(check_order_both_ways)
    test_big_transfer_both_ways = _stream(check_big_transfer_both_ways)
    test_start_delivers_what_came_before = _stream(check_start_delivers_what_came_before)
    test_left_own_close = _stream(check_left_own_close)
    test_right_own_close = _stream(check_right_own_close)
    test_close_hands_over_what_is_queued = _stream(check_close_hands_over_what_is_queued)
    test_left_closes = _stream(check_left_closes)
    test_right_closes = _stream(check_right_closes)
    test_close_before_start = _stream(check_close_before_start)
