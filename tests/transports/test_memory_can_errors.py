"""The CAN bus in memory with disturbed frames and with nodes that join and leave."""

from asyncio import sleep as pass_time  # in virtual time, without waiting
from typing import Any

import pytest

from hil_bridge.clock import Clock
from hil_bridge.transports import BitErrors, ErrorCounters, MemoryCanBus
from protocol.can.error import ErrorClass, ErrorState
from protocol.can.frame import CanFrame
from protocol.can.line import frame_time_bits, line_bits
from tests.transports.memory_bus import BETWEEN, ERROR_FRAME, SUSPEND, US, Hits, Log, virtual

# --- disturbed frames


def test_can_corrupted_frame_is_retransmitted() -> None:
    async def main(clock: Clock) -> None:
        bus = MemoryCanBus(clock)
        bus.disturb = Hits(20)
        sender, receiver = bus.connect(), bus.connect()
        log, start, frame = Log(receiver, clock), clock.now(), CanFrame(0x123, b"\x55")
        sender.send([frame])
        await pass_time(1)
        assert log.items == [
            (start + (20 + ERROR_FRAME + BETWEEN + frame_time_bits(frame)) / 1_000_000, frame)
        ]
        assert bus.errors == 1
        # eight more for the error, one less for the success; the receiver one more, one less
        assert (sender.counters, receiver.counters) == (ErrorCounters(7, 0), ErrorCounters(0, 0))
        assert bus.busy_s == pytest.approx((20 + ERROR_FRAME + BETWEEN + line_bits(frame)) * US)

    virtual(main)


def test_can_error_in_last_bit_duplicates_frame() -> None:
    async def main(clock: Clock) -> None:
        bus = MemoryCanBus(clock)
        bus.disturb = Hits(-1)
        sender, receiver = bus.connect(), bus.connect()
        log = Log(receiver, clock)
        sender.send([CanFrame(0x123)])
        await pass_time(1)
        assert log.frames == [CanFrame(0x123)] * 2
        assert (sender.counters.transmit, receiver.counters.receive) == (7, 0)
        assert sender.statistics.sent == 1

    virtual(main)


def test_can_disturbed_node_goes_bus_off_and_recovers() -> None:
    async def main(clock: Clock) -> None:
        bus = MemoryCanBus(clock)
        bus.disturb = Hits(*[20] * 32)
        sender, receiver = bus.connect(), bus.connect()
        own, log, start = Log(sender, clock), Log(receiver, clock), clock.now()
        sender.send([CanFrame(0x123)])
        await pass_time(1)
        assert own.states == [
            ErrorState.WARNING,
            ErrorState.PASSIVE,
            ErrorState.BUS_OFF,
            ErrorState.ACTIVE,
        ]
        attempt = 20 + ERROR_FRAME
        # 32 × 8 = 256; a passive node pauses after each of its last attempts except one
        bus_off_at = start + (32 * attempt + 31 * BETWEEN + 16 * SUSPEND) / 1_000_000
        assert own.reports[2][0] == pytest.approx(bus_off_at, abs=1e-10)
        # 128 times eleven recessive bits: the first are the end of the error frame and the intermission
        recovered_at = bus_off_at + (BETWEEN + 127 * 11) * US
        assert own.reports[3][0] == pytest.approx(recovered_at, abs=1e-10)
        assert own.reports[3][1].classes == ErrorClass.RESTARTED
        assert log.times == [pytest.approx(recovered_at + frame_time_bits(CanFrame(0x123)) * US, abs=1e-10)]
        assert receiver.counters.receive == 31
        assert sender.statistics.bus_off == 1
        assert sender.counters == ErrorCounters()

    virtual(main)


def test_can_bus_off_node_receives_nothing_and_recovers() -> None:
    async def main(clock: Clock) -> None:
        bus = MemoryCanBus(clock)
        sick = bus.connect()
        other = bus.connect()
        received, reports = Log(sick, clock), Log(other, clock)
        bus.disturb = Hits(*[20] * 32)
        sick.send([CanFrame(0x7FF)])
        await pass_time(32 * 34e-6 + 31 * 3e-6 + 16 * 8e-6 + 1e-6)
        assert sick.counters.state is ErrorState.BUS_OFF
        other.send([CanFrame(0x100, bytes(8))] * 4)
        await pass_time(0.0008)
        assert received.frames == []
        assert other.statistics.sent == 0
        assert other.counters.transmit > 0
        await pass_time(1)
        assert received.states[-1] is ErrorState.ACTIVE
        assert received.frames == [CanFrame(0x100, bytes(8))] * 4
        assert reports.frames == [CanFrame(0x7FF)]

    virtual(main)


def test_can_error_passive_sender_yields_to_others() -> None:
    async def main(clock: Clock) -> None:
        bus = MemoryCanBus(clock)
        bus.disturb = Hits(*[20] * 16)
        passive, other, log = bus.connect(), bus.connect(), Log(bus.connect(), clock)
        passive.send([CanFrame(0x055)])
        await pass_time(16 * 34e-6 + 15 * 3e-6 + 5e-6)
        assert passive.counters.state is ErrorState.PASSIVE
        other.send([CanFrame(0x755)])
        await pass_time(1)
        assert [frame.identifier for frame in log.frames] == [0x755, 0x055]

    virtual(main)


def test_can_receivers_count_errors() -> None:
    async def main(clock: Clock) -> None:
        bus = MemoryCanBus(clock)
        bus.disturb = lambda frame, bits: 20 if frame.data else None
        senders, receiver = [bus.connect() for _ in range(5)], bus.connect()
        log = Log(receiver, clock)
        for sender in senders:
            sender.send([CanFrame(0x123, b"x")])
            await pass_time(0.004)
        assert log.states[:2] == [ErrorState.WARNING, ErrorState.PASSIVE]
        assert log.reports[1][1].counters == (0, 128)
        assert receiver.counters.state is not ErrorState.BUS_OFF
        await pass_time(1)
        senders[0].send([CanFrame(0x123)])
        await pass_time(1)
        assert receiver.counters.receive == 127

    virtual(main)


def test_can_bit_errors_are_reproducible_without_loss() -> None:
    async def main(clock: Clock) -> None:
        runs = []
        for seed in (1, 1, 2):
            bus = MemoryCanBus(clock)
            bus.disturb = BitErrors(1e-3, seed)
            sender, log = bus.connect(), Log(bus.connect(), clock)
            sender.send([CanFrame(0x100 + k, bytes(8)) for k in range(500)])
            start = clock.now()
            await pass_time(1)
            runs.append([round((at - start) / US) for at in log.times])
            assert {frame.identifier for frame in log.frames} == {0x100 + k for k in range(500)}
            # 500 frames of about 125 bits, each hit with a probability of 1 − 0.999¹²⁵ = 12 %
            assert 40 < bus.errors < 100
        assert runs[0] == runs[1] != runs[2]

    virtual(main)


@pytest.mark.parametrize("rate", [0.0, 1.0, -1.0])
def test_can_invalid_bit_error_rate_is_refused(rate: float) -> None:
    with pytest.raises(ValueError, match="between 0 and 1"):
        BitErrors(rate)


# --- nodes that come and go


def test_can_sender_leaving_during_frame_loses_it() -> None:
    async def main(clock: Clock) -> None:
        bus = MemoryCanBus(clock)
        sender, other = bus.connect(), bus.connect()
        log, start = Log(other, clock), clock.now()
        sender.send([CanFrame(0x123)])
        await pass_time(2e-5)
        bus.disconnect(sender)
        other.send([CanFrame(0x100)])
        third = Log(bus.connect(), clock)
        await pass_time(1)
        assert log.items == []
        assert third.times == [
            start + (line_bits(CanFrame(0x123)) + frame_time_bits(CanFrame(0x100))) / 1_000_000
        ]

    virtual(main)


def test_can_lone_sender_frees_bus_when_switched_off() -> None:
    async def main(clock: Clock) -> None:
        bus = MemoryCanBus(clock)
        lone = bus.connect()
        lone.send([CanFrame(0x123)])
        await pass_time(0.01)
        bus.disconnect(lone)
        sender, log = bus.connect(), Log(bus.connect(), clock)
        start = clock.now()
        sender.send([CanFrame(0x100)])
        await pass_time(1)
        assert log.times[0] - start < 0.0005

    virtual(main)


def test_can_node_joining_during_frame_does_not_receive_it() -> None:
    async def main(clock: Clock) -> None:
        bus = MemoryCanBus(clock)
        sender, node_log = bus.connect(), Log(bus.connect(), clock)
        sender.send([CanFrame(0x123), CanFrame(0x124)])
        await pass_time(2e-5)
        late = Log(bus.connect(), clock)
        await pass_time(1)
        assert [len(node_log.items), len(late.items)] == [2, 1]

    virtual(main)


def test_can_exception_of_listener_does_not_stop_bus() -> None:
    async def main(clock: Clock) -> None:
        bus = MemoryCanBus(clock)
        sender, bad = bus.connect(), bus.connect()

        def fail(frames: Any) -> None:
            raise ZeroDivisionError

        bad.start(fail, print)
        log = Log(bus.connect(), clock)
        clock.loop.set_exception_handler(lambda loop, context: None)
        sender.send([CanFrame(0x100), CanFrame(0x101)])
        await pass_time(1)
        assert sender.statistics.sent == 2
        assert log.items == []

    virtual(main)
