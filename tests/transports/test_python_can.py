"""CAN interfaces through python-can: reading, and sending to a full kernel queue, at exact times."""

import errno
import sys
from asyncio import sleep as pass_time  # in virtual time, without waiting
from contextlib import closing

import can
import pytest

from hil_bridge.clock import Clock
from hil_bridge.errors import TransportBroken, TransportClosed, TransportError
from hil_bridge.transports import CanStatistics, connect_can
from hil_bridge.transports.can.message import from_message, to_message
from hil_bridge.transports.can.socketcan import interface_up
from hil_bridge.transports.can.wire import MOST_PER_WAKE_UP, RETRY_S, CanWire
from protocol.can.error import ErrorClass
from protocol.can.frame import CanFilter, CanFrame
from tests.transports.socketcan_kernel import PATIENCE, Ear, Kernel, frames, run_check

# --- reading


def test_can_wire_delivers_pending_frames_in_one_batch() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        kernel.arrive(*frames(5))
        await pass_time(0)
        await pass_time(0)
        assert ear.frames == frames(5)
        assert ear.batches == [5]
        assert wire.statistics == CanStatistics(received=5)

    run_check(check)


def test_can_wire_flood_does_not_block_loop() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        kernel.arrive(*[CanFrame(0x100)] * (3 * MOST_PER_WAKE_UP + 1))
        await pass_time(0.1)
        assert ear.batches == [MOST_PER_WAKE_UP] * 3 + [1]

    run_check(check)


def test_can_wire_counts_malformed_frames() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        kernel.pending.append(can.Message(arbitration_id=0x100, is_fd=True, data=bytes(12)))
        kernel.pending.append(can.Message(arbitration_id=0x800, is_extended_id=False, check=False))
        kernel.arrive(CanFrame(0x040, b"short", error=True), CanFrame(0x101))
        await pass_time(0.1)
        assert ear.frames == [CanFrame(0x101)]
        assert ear.reports == []
        assert wire.statistics == CanStatistics(received=1, malformed=3)

    run_check(check)


@pytest.mark.parametrize(
    "frame",
    [
        CanFrame(0x7FF, bytes(range(8))),
        CanFrame(0x1ABCDEF0, b"\x01", extended=True),
        CanFrame(0x123, bytes(6), remote=True),
        CanFrame(0),
    ],
)
def test_can_frames_convert_to_python_can_and_back(frame: CanFrame) -> None:
    message = to_message(frame)
    assert message.dlc == len(frame.data)
    assert from_message(message, 1.0) == frame


# --- sending


def test_can_wire_queues_frames_in_order() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        kernel.room, start = 2, clock.now()
        wire.send(frames(3))
        wire.send(frames(2, 0x103))
        assert kernel.numbers == [0x100, 0x101]
        await clock.sleep_until(start + 10.5 * RETRY_S)
        kernel.room = 2
        await clock.sleep_until(start + 20.5 * RETRY_S)
        kernel.room = 9
        await clock.sleep_until(start + 30 * RETRY_S)
        assert kernel.numbers == [0x100, 0x101, 0x102, 0x103, 0x104]
        assert [round((at - start) / RETRY_S) for at, _ in kernel.sent] == [0, 0, 11, 11, 21]
        assert wire.statistics == CanStatistics(sent=5)
        assert ear.reports == []

    run_check(check)


def test_can_wire_drops_and_reports_late_frame() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        kernel.room, start = 0, clock.now()
        wire.send(frames(2))
        await pass_time(0.05)
        wire.send(frames(1, 0x200))
        await clock.sleep_until(start + PATIENCE + 0.02)
        assert ear.reports == [(start + PATIENCE, ErrorClass.TX_TIMEOUT)]
        kernel.room = 9
        await pass_time(0.01)
        assert kernel.numbers == [0x200]
        statistics = wire.statistics
        assert (statistics.sent, statistics.dropped, statistics.error_frames) == (1, 2, 1)

    run_check(check)


def test_can_wire_slow_queue_drops_nothing() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        kernel.room = 0
        wire.send(frames(10))
        for _ in range(10):
            await pass_time(0.09)
            kernel.room = 1
        await pass_time(0.09)
        assert kernel.numbers == list(range(0x100, 0x10A))
        assert wire.statistics.dropped == 0

    run_check(check)


def test_can_wire_full_queue_refuses_complete_batch() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        kernel.room = 0
        wire.send([CanFrame(0x100)] * 1000)
        with pytest.raises(TransportError, match="can0: the send queue is full"):
            wire.send([CanFrame(0x101)] * 25)
        wire.send([CanFrame(0x102)] * 24)
        kernel.room = 2000
        await pass_time(0.01)
        assert kernel.numbers == [0x100] * 1000 + [0x102] * 24

    run_check(check)


def test_can_wire_close_waits_for_pending_frames() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        kernel.room = 0
        wire.send(frames(1))
        clock.call_at(clock.now() + 0.01, lambda: setattr(kernel, "room", 1))
        await wire.aclose()
        assert kernel.numbers == [0x100]
        with pytest.raises(TransportClosed):
            wire.send(frames(1))

    run_check(check)


def test_can_wire_breaks_for_any_other_error() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        kernel.go_down(errno.EBADF)
        await pass_time(0)
        await pass_time(0)
        assert [type(end) for end in ear.ends] == [TransportBroken]
        with pytest.raises(TransportBroken):
            wire.send(frames(1))

    run_check(check)


# --- the real python-can


async def test_can_filters_are_passed_to_python_can() -> None:
    with closing(Clock.running()) as clock:
        wire = await connect_can("can+virtual://filters", clock, accept=[CanFilter(0x601, 0x77F)])
        assert isinstance(wire, CanWire)
        assert wire._bus.filters == [{"can_id": 0x601, "can_mask": 0x77F, "extended": False}]
        await wire.aclose()


@pytest.mark.skipif(sys.platform != "linux", reason="asks Linux")
def test_can_interface_state_is_read() -> None:
    assert interface_up("lo") in (True, False)
    assert interface_up("nocan7") is None
