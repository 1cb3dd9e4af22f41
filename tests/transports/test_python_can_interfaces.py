"""CAN interfaces through python-can that go down and return, or are bus-off, at exact times."""

import errno
from asyncio import sleep as pass_time  # in virtual time, without waiting

import can
import pytest

from hil_bridge.clock import Clock
from hil_bridge.errors import TransportBroken
from hil_bridge.transports.can.message import to_message
from hil_bridge.transports.can.wire import LINK_PATIENCE_S, PROBE_S, CanWire
from protocol.can.error import CanErrorReport, Controller, ErrorClass, encode_error
from protocol.can.frame import CanFrame
from tests.transports.socketcan_kernel import BUS_OFF, PATIENCE, RESTARTED, Ear, Kernel, frames, run_check

# --- an interface that goes and comes


def test_can_interface_down_for_a_while_is_tolerated() -> None:
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

    run_check(check)


def test_can_interface_down_is_reported_after_send() -> None:
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

    run_check(check)


def test_can_interface_sends_after_reporting_return() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        kernel.go_down()
        await pass_time(PROBE_S / 2)
        kernel.up = True
        wire.send(frames(1))
        assert kernel.numbers == []
        await pass_time(PROBE_S)
        assert kernel.sent[0][0] == ear.reports[-1][0]
        assert ear.classes == [ErrorClass.INTERFACE_DOWN, ErrorClass.RESTARTED]

    run_check(check)


def test_can_replugged_adapter_is_reopened() -> None:
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

    run_check(check)


def test_can_interface_staying_down_breaks_wire() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        start = clock.now()
        kernel.go_down()
        await pass_time(LINK_PATIENCE_S - PROBE_S)
        assert ear.ends == []
        await pass_time(2 * PROBE_S)
        assert [type(end) for end in ear.ends] == [TransportBroken]
        assert "the CAN interface is down; `sudo ip link set can0 up`" in str(ear.ends[0])
        assert ear.reports == [(start, ErrorClass.INTERFACE_DOWN)]

    run_check(check)


def test_can_failed_reopening_is_retried() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        kernel.go_down(errno.ENODEV)
        attempts = 0

        def renew(bus: can.BusABC) -> can.BusABC:
            nonlocal attempts
            attempts += 1
            if attempts < 3:
                raise OSError(errno.ENODEV, "not yet")
            return bus

        kernel.renew = renew  # type: ignore[method-assign]
        kernel.up = True
        await pass_time(4 * PROBE_S)
        assert attempts == 3
        assert ear.classes == [ErrorClass.INTERFACE_DOWN, ErrorClass.RESTARTED]

    run_check(check)


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
def test_can_temporary_bus_off_is_tolerated(news: CanFrame) -> None:
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

    run_check(check)


def test_can_permanent_bus_off_breaks_wire_with_remedy() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        kernel.arrive(BUS_OFF)
        await pass_time(LINK_PATIENCE_S + PROBE_S)
        assert [type(end) for end in ear.ends] == [TransportBroken]
        assert "bus-off" in str(ear.ends[0])
        assert "`sudo ip link set can0 type can restart`" in str(ear.ends[0])

    run_check(check)


def test_can_bus_off_interface_restart_is_tolerated() -> None:
    async def check(clock: Clock, kernel: Kernel, wire: CanWire, ear: Ear) -> None:
        kernel.arrive(BUS_OFF)
        await pass_time(1.0)
        kernel.go_down()
        await pass_time(1.0)
        kernel.up = True
        await pass_time(2 * LINK_PATIENCE_S)
        assert ear.ends == []
        assert ear.classes == [ErrorClass.BUS_OFF, ErrorClass.INTERFACE_DOWN, ErrorClass.RESTARTED]

    run_check(check)
