"""CAN interfaces through python-can that go and come, or are bus-off, at exact times."""

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
from tests.transports.socketcan_kernel import BUS_OFF, PATIENCE, RESTARTED, Ear, Kernel, frames, played

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
