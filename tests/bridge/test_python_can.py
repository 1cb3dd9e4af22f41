"""CAN interfaces through python-can: a kernel that is full, down, gone or bus-off, at exact times.

The kernel's side of a SocketCAN socket is played by a python-can bus, after net/can/raw.c and the drivers.
"""

import errno
import os
import sys
from asyncio import sleep as pass_time  # in virtual time, without waiting
from collections import deque
from collections.abc import Awaitable, Callable
from contextlib import closing
from typing import Any

import can
import pytest

from hil_bridge.clock import Clock, run_virtual
from hil_bridge.errors import TransportBroken, TransportClosed, TransportError
from hil_bridge.transports import CanStatistics, connect_can
from hil_bridge.transports.can.message import from_message, to_message
from hil_bridge.transports.can.socketcan import interface_up
from hil_bridge.transports.can.wire import LINK_PATIENCE_S, MOST_PER_WAKE_UP, PROBE_S, RETRY_S, CanWire, Place
from protocol.can.error import CanErrorReport, Controller, ErrorClass, decode_error, encode_error
from protocol.can.frame import CanFilter, CanFrame

PATIENCE = 0.1
"""The send deadline."""
BUS_OFF = encode_error(CanErrorReport(ErrorClass.BUS_OFF))
RESTARTED = encode_error(CanErrorReport(ErrorClass.RESTARTED))


def failure(number: int) -> can.CanOperationError:
    """An error as python-can raises it."""
    return can.CanOperationError(f"Failed: {os.strerror(number)}", number)


class Kernel(can.BusABC):
    """One socket and the interface it is bound to."""

    def __init__(self, clock: Clock, fd: int = 1000) -> None:
        super().__init__("can0")
        self.clock = clock
        self.fd = fd
        self.room = 1_000_000
        """Frames that the interface takes before it is full."""
        self.up = True
        self.error: int | None = None
        """Next answer of the socket, once."""
        self.pending: deque[can.Message] = deque()
        self.sent: list[tuple[float, can.Message]] = []
        self.closed = False
        self.reader: Callable[[], None] | None = None
        self.renewed: list[Kernel] = []
        clock.loop.add_reader = self._add_reader  # type: ignore[assignment]
        clock.loop.remove_reader = self._remove_reader  # type: ignore[assignment]
        clock.loop.remove_writer = lambda fd: False  # type: ignore[method-assign]

    def _add_reader(self, fd: int, callback: Callable[[], None]) -> None:
        kernel = self._of(fd)
        kernel.reader = callback
        kernel.wake()

    def _remove_reader(self, fd: int) -> bool:
        self._of(fd).reader = None
        return True

    def _of(self, fd: int) -> "Kernel":
        return next(kernel for kernel in (self, *self.renewed) if kernel.fd == fd)

    # --- events of the interface

    def arrive(self, *frames: CanFrame) -> None:
        """Frames of others, or reports of the driver."""
        for frame in frames:
            message = to_message(frame)
            message.is_error_frame = frame.error
            self.pending.append(message)
        self.wake()

    def go_down(self, number: int = errno.ENETDOWN) -> None:
        """The interface is set down, or is gone with ENODEV."""
        self.up = False
        self.error = number
        self.wake()

    def wake(self) -> None:
        """Wake the event loop as long as there is something to read."""
        if self.reader is not None and (self.pending or self.error is not None):
            self.clock.loop.call_soon(self._level)

    def _level(self) -> None:
        if self.reader is not None and (self.pending or self.error is not None):
            self.reader()
            self.wake()

    # --- python-can's side

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        assert timeout == 0
        if not self.up:
            raise failure(errno.ENETDOWN)
        if self.room == 0:
            raise failure(errno.ENOBUFS)
        self.room -= 1
        self.sent.append((self.clock.now(), msg))

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        assert timeout == 0
        assert not self.closed
        if self.error is not None:
            number, self.error = self.error, None
            raise failure(number)
        return (self.pending.popleft() if self.pending else None), True

    def fileno(self) -> int:
        return self.fd

    def shutdown(self) -> None:
        super().shutdown()
        self.closed = True

    # --- the interface as a link

    def renew(self, bus: can.BusABC) -> can.BusABC:
        if not self.renewed:
            return bus
        bus.shutdown()
        return self.renewed[0]

    @property
    def numbers(self) -> list[int]:
        """Identifiers that left, in order."""
        return [message.arbitration_id for _, message in self.sent]


class Ear:
    """Deliveries of the wire."""

    def __init__(self, wire: CanWire, clock: Clock) -> None:
        self.frames: list[CanFrame] = []
        self.reports: list[tuple[float, ErrorClass]] = []
        self.batches: list[int] = []
        self.ends: list[TransportError] = []
        self.within_send = False
        self._clock = clock
        wire.start(self._data, self.ends.append)

    def _data(self, frames: Any) -> None:
        assert not self.within_send
        self.batches.append(len(frames))
        for frame in frames:
            if frame.error:
                self.reports.append((self._clock.now(), decode_error(frame).classes))
            else:
                self.frames.append(frame)

    @property
    def classes(self) -> list[ErrorClass]:
        return [classes for _, classes in self.reports]


def played(check: Callable[[Clock, Kernel, CanWire, Ear], Awaitable[None]]) -> None:
    """Run a check on an open wire in virtual time, then close the wire."""

    async def main() -> None:
        clock = Clock.running()
        kernel = Kernel(clock)
        wire = CanWire(kernel, Place("socketcan", "can0", "can+socketcan://can0"), clock, kernel)
        ear = Ear(wire, clock)
        await check(clock, kernel, wire, ear)
        await wire.aclose()
        assert len(ear.ends) == 1
        assert kernel.closed or kernel.renewed

    run_virtual(main)


def frames(count: int, first: int = 0x100) -> list[CanFrame]:
    return [CanFrame(first + k) for k in range(count)]


# --- reading


def test_all_that_is_pending_comes_in_one_batch() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        kernel.arrive(*frames(5))
        await pass_time(0)
        await pass_time(0)
        assert ear.frames == frames(5)
        assert ear.batches == [5]
        assert wire.statistics == CanStatistics(received=5)

    played(check)


def test_a_flood_leaves_turns_to_others() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        kernel.arrive(*[CanFrame(0x100)] * (3 * MOST_PER_WAKE_UP + 1))
        await pass_time(0.1)
        assert ear.batches == [MOST_PER_WAKE_UP] * 3 + [1]

    played(check)


def test_what_is_no_classical_frame_is_counted() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        kernel.pending.append(can.Message(arbitration_id=0x100, is_fd=True, data=bytes(12)))
        kernel.pending.append(can.Message(arbitration_id=0x800, is_extended_id=False, check=False))
        kernel.arrive(CanFrame(0x040, b"short", error=True), CanFrame(0x101))
        await pass_time(0.1)
        assert ear.frames == [CanFrame(0x101)]
        assert ear.reports == []
        assert wire.statistics == CanStatistics(received=1, malformed=3)

    played(check)


@pytest.mark.parametrize(
    "frame",
    [
        CanFrame(0x7FF, bytes(range(8))),
        CanFrame(0x1ABCDEF0, b"\x01", extended=True),
        CanFrame(0x123, bytes(6), remote=True),
        CanFrame(0),
    ],
)
def test_frames_survive_python_can(frame: CanFrame) -> None:
    message = to_message(frame)
    assert message.dlc == len(frame.data)
    assert from_message(message, 1.0) == frame


# --- sending


def test_frames_without_room_in_the_interface_leave_in_order() -> None:
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

    played(check)


def test_a_frame_that_does_not_leave_in_time_is_dropped_and_told() -> None:
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

    played(check)


def test_a_queue_that_moves_slowly_drops_nothing() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        kernel.room = 0
        wire.send(frames(10))
        for _ in range(10):
            await pass_time(0.09)
            kernel.room = 1
        await pass_time(0.09)
        assert kernel.numbers == list(range(0x100, 0x10A))
        assert wire.statistics.dropped == 0

    played(check)


def test_a_full_queue_refuses_the_whole_batch() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        kernel.room = 0
        wire.send([CanFrame(0x100)] * 1000)
        with pytest.raises(TransportError, match="can0: the send queue is full"):
            wire.send([CanFrame(0x101)] * 25)
        wire.send([CanFrame(0x102)] * 24)
        kernel.room = 2000
        await pass_time(0.01)
        assert kernel.numbers == [0x100] * 1000 + [0x102] * 24

    played(check)


def test_closing_waits_for_what_can_still_leave() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        kernel.room = 0
        wire.send(frames(1))
        clock.call_at(clock.now() + 0.01, lambda: setattr(kernel, "room", 1))
        await wire.aclose()
        assert kernel.numbers == [0x100]
        with pytest.raises(TransportClosed):
            wire.send(frames(1))

    played(check)


def test_any_other_error_breaks_the_wire() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        kernel.go_down(errno.EBADF)
        await pass_time(0)
        await pass_time(0)
        assert [type(end) for end in ear.ends] == [TransportBroken]
        with pytest.raises(TransportBroken):
            wire.send(frames(1))

    played(check)


# --- an interface that goes and comes


def test_an_interface_that_is_down_for_a_while_is_told_and_forgiven() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        start = clock.now()
        kernel.arrive(CanFrame(0x600))
        kernel.go_down()
        await clock.sleep_until(start + 1.0)
        wire.send(frames(1))
        await clock.sleep_until(start + 2.0)
        kernel.up = True
        await clock.sleep_until(start + 2.0 + 2 * PROBE_S)
        kernel.arrive(CanFrame(0x601))
        wire.send(frames(1, 0x200))
        await pass_time(0.01)
        # earlier arrivals are handed over before the report
        assert ear.frames == [CanFrame(0x600), CanFrame(0x601)]
        assert ear.classes == [ErrorClass.INTERFACE_DOWN, ErrorClass.TX_TIMEOUT, ErrorClass.RESTARTED]
        assert ear.reports[0][0] == start
        assert ear.reports[1][0] == pytest.approx(start + 1.0 + PATIENCE)
        assert start + 2.0 <= ear.reports[2][0] <= start + 2.0 + PROBE_S + 1e-9
        assert kernel.numbers == [0x200]

    played(check)


def test_an_interface_found_down_calls_back_only_after_send() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        kernel.up = False
        ear.within_send = True
        wire.send(frames(1))
        ear.within_send = False
        kernel.error = errno.ENETDOWN  # not read yet
        kernel.pending.append(to_message(CanFrame(0x600)))
        await pass_time(0)
        await pass_time(0)
        assert ear.frames == [CanFrame(0x600)]
        assert ear.classes == [ErrorClass.INTERFACE_DOWN]
        kernel.up = True
        await pass_time(PROBE_S)
        # it was down for less than the deadline
        assert kernel.numbers == [0x100]
        assert ear.classes == [ErrorClass.INTERFACE_DOWN, ErrorClass.RESTARTED]

    played(check)


def test_nothing_leaves_before_the_owner_knows_the_interface_is_back() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        kernel.go_down()
        await pass_time(PROBE_S / 2)
        kernel.up = True
        wire.send(frames(1))
        assert kernel.numbers == []
        await pass_time(PROBE_S)
        assert kernel.sent[0][0] == ear.reports[-1][0]
        assert ear.classes == [ErrorClass.INTERFACE_DOWN, ErrorClass.RESTARTED]

    played(check)


def test_an_adapter_that_is_plugged_in_again_is_opened_again() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        kernel.go_down(errno.ENODEV)
        await pass_time(1.0)
        again = Kernel(clock, fd=1001)
        clock.loop.add_reader, clock.loop.remove_reader = kernel._add_reader, kernel._remove_reader  # type: ignore
        kernel.renewed.append(again)
        kernel.up = True
        await pass_time(PROBE_S)
        assert kernel.closed
        again.arrive(CanFrame(0x601))
        wire.send(frames(1))
        await pass_time(0.01)
        assert ear.frames == [CanFrame(0x601)]
        assert again.numbers == [0x100]
        assert ear.classes == [ErrorClass.INTERFACE_DOWN, ErrorClass.RESTARTED]

    played(check)


def test_an_interface_that_stays_down_breaks_the_wire_after_a_time() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        start = clock.now()
        kernel.go_down()
        await pass_time(LINK_PATIENCE_S - PROBE_S)
        assert ear.ends == []
        await pass_time(2 * PROBE_S)
        assert [type(end) for end in ear.ends] == [TransportBroken]
        assert "the CAN interface is down; `sudo ip link set can0 up`" in str(ear.ends[0])
        assert ear.reports == [(start, ErrorClass.INTERFACE_DOWN)]

    played(check)


def test_a_failing_reopening_is_tried_again() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        kernel.go_down(errno.ENODEV)
        tries = 0

        def renew(bus: can.BusABC) -> can.BusABC:
            nonlocal tries
            tries += 1
            if tries < 3:
                raise OSError(errno.ENODEV, "not yet")
            return bus

        kernel.renew = renew  # type: ignore[method-assign]
        kernel.up = True
        await pass_time(4 * PROBE_S)
        assert tries == 3
        assert ear.classes == [ErrorClass.INTERFACE_DOWN, ErrorClass.RESTARTED]

    played(check)


# --- bus-off


@pytest.mark.parametrize(
    "news",
    [
        RESTARTED,
        CanFrame(0x600),
        encode_error(CanErrorReport(ErrorClass.CONTROLLER, Controller.ACTIVE)),
    ],
    ids=["restart-ms", "traffic", "error active"],
)
def test_bus_off_is_told_and_forgiven_when_the_controller_comes_back(news: CanFrame) -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        kernel.arrive(BUS_OFF, BUS_OFF)
        await pass_time(1.0)
        kernel.arrive(news)
        await pass_time(2 * LINK_PATIENCE_S)
        assert ear.ends == []
        assert ear.classes[:2] == [ErrorClass.BUS_OFF] * 2
        statistics = wire.statistics
        assert statistics.bus_off == 2
        assert statistics.error_frames == 2 + news.error

    played(check)


def test_bus_off_for_good_breaks_the_wire_and_says_what_to_do() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        kernel.arrive(BUS_OFF)
        await pass_time(LINK_PATIENCE_S + PROBE_S)
        assert [type(end) for end in ear.ends] == [TransportBroken]
        assert "bus-off" in str(ear.ends[0])
        assert "`sudo ip link set can0 type can restart`" in str(ear.ends[0])

    played(check)


def test_a_bus_off_interface_that_is_set_down_and_up_is_forgiven() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        kernel.arrive(BUS_OFF)
        await pass_time(1.0)
        kernel.go_down()
        await pass_time(1.0)
        kernel.up = True
        await pass_time(2 * LINK_PATIENCE_S)
        assert ear.ends == []
        assert ear.classes == [ErrorClass.BUS_OFF, ErrorClass.INTERFACE_DOWN, ErrorClass.RESTARTED]

    played(check)


# --- the real python-can


async def test_filters_reach_python_can() -> None:
    with closing(Clock.running()) as clock:
        wire = await connect_can("can+virtual://filters", clock, accept=[CanFilter(0x601, 0x77F)])
        assert isinstance(wire, CanWire)
        assert wire._bus.filters == [{"can_id": 0x601, "can_mask": 0x77F, "extended": False}]
        await wire.aclose()


@pytest.mark.skipif(sys.platform != "linux", reason="asks Linux")
def test_whether_an_interface_is_up() -> None:
    assert interface_up("lo") in (True, False)
    assert interface_up("nocan7") is None
