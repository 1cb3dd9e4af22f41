"""The CAN bus in memory: exact times, arbitration, acknowledge, and URLs."""

from asyncio import sleep as pass_time  # in virtual time, without waiting
from collections.abc import Callable
from typing import Any

import pytest

from emulators.wires.slcan_adapter import SlcanAdapter, SlcanProfile
from hil_bridge.clock import Clock
from hil_bridge.errors import ConfigError, TransportClosed, TransportError
from hil_bridge.transports import (
    ErrorCounters,
    MemoryCanBus,
    MemoryCanNode,
    connect_can,
    listen_can,
    memory_can_bus,
    memory_pair,
)
from hil_bridge.transports.can.slcan import SlcanWire
from hil_bridge.transports.can.slcan_device import SlcanDevice
from protocol.can.error import ErrorClass, ErrorState
from protocol.can.frame import CanFilter, CanFrame
from protocol.can.line import frame_time_bits, line_bits, stuffed_bits
from tests.transports.memory_bus import (
    BETWEEN,
    DELIMITER_AND_SLOT,
    ERROR_FRAME,
    PATIENCE,
    SUSPEND,
    US,
    Hits,
    Log,
    virtual,
)

# --- frames and arbitration


def test_can_frame_arrives_after_its_bit_times() -> None:
    async def main(clock: Clock) -> None:
        bus = MemoryCanBus(clock, 250_000)
        sender = bus.connect()
        own, log, third = Log(sender, clock), Log(bus.connect(), clock), Log(bus.connect(), clock)
        start = clock.now()
        first, second = CanFrame(0x101, bytes(8)), CanFrame(0x100, b"ab")
        sender.send([first, second])
        await pass_time(1)
        end = frame_time_bits(first)
        assert log.times == [start + end / 250_000, start + (end + 3 + frame_time_bits(second)) / 250_000]
        assert log.frames == [first, second]
        assert log.items == third.items
        assert own.items == []
        assert sender.statistics.sent == 2
        assert bus.busy_s == (line_bits(first) + line_bits(second)) / 250_000
        assert bus.load() == pytest.approx(100 * bus.busy_s)

    virtual(main)


def test_can_dominant_identifier_wins_arbitration() -> None:
    async def main(clock: Clock) -> None:
        bus = MemoryCanBus(clock)
        nodes = [bus.connect() for _ in range(5)]
        log = Log(bus.connect(), clock)
        frames = [
            CanFrame(0x300),
            CanFrame(0x100, remote=True),
            CanFrame(0x100),
            CanFrame(0x100 << 18, extended=True),
            CanFrame(0x0FF << 18 | 5, extended=True),
        ]
        for node, frame in zip(nodes, frames, strict=True):
            node.send([frame])
        await pass_time(1)
        assert log.frames == [frames[4], frames[2], frames[1], frames[3], frames[0]]
        assert bus.collisions == 0

    virtual(main)


def test_can_same_identifier_at_once_counts_as_collision() -> None:
    async def main(clock: Clock) -> None:
        bus = MemoryCanBus(clock)
        one, other, log = bus.connect(), bus.connect(), Log(bus.connect(), clock)
        one.send([CanFrame(0x001), CanFrame(0x100, b"one")])
        await pass_time(1e-6)
        other.send([CanFrame(0x100, b"other")])
        await pass_time(1)
        assert [frame.data for frame in log.frames] == [b"", b"other", b"one"]
        assert bus.collisions == 1

    virtual(main)


def test_can_answering_node_joins_next_arbitration() -> None:
    async def main(clock: Clock) -> None:
        bus = MemoryCanBus(clock)
        talker, answerer = bus.connect(), bus.connect()
        log = Log(bus.connect(), clock)
        answerer.start(lambda frames: answerer.send([CanFrame(0x001)]), lambda error: None)
        talker.send([CanFrame(0x200), CanFrame(0x201)])
        await pass_time(0.0005)
        assert [frame.identifier for frame in log.frames] == [0x200, 0x001, 0x201, 0x001]

    virtual(main)


def test_can_node_joins_at_start_of_frame_or_waits() -> None:
    async def main(clock: Clock) -> None:
        bus = MemoryCanBus(clock)
        first, second, late = (bus.connect() for _ in range(3))
        log = Log(bus.connect(), clock)
        start = clock.now()
        first.send([CanFrame(0x2AA)])
        await pass_time(0)
        second.send([CanFrame(0x155)])
        await clock.sleep_until(start + 1e-6)
        late.send([CanFrame(0x055)])
        await pass_time(1)
        assert [frame.identifier for frame in log.frames] == [0x155, 0x055, 0x2AA]
        ends = [start]
        for frame in log.frames:
            ends.append(ends[-1] + line_bits(frame) * US)
        assert log.times == pytest.approx([end - 3 * US for end in ends[1:]], abs=1e-11)

    virtual(main)


def test_can_frame_sent_in_intermission_waits_for_its_end() -> None:
    async def main(clock: Clock) -> None:
        bus = MemoryCanBus(clock)
        sender, log = bus.connect(), Log(bus.connect(), clock)
        start, frame = clock.now(), CanFrame(0x123)
        sender.send([frame])
        await clock.sleep_until(start + (frame_time_bits(frame) + 1) * US)
        sender.send([frame])
        await pass_time(1)
        assert log.times[1] == start + (line_bits(frame) + frame_time_bits(frame)) / 1_000_000

    virtual(main)


@pytest.mark.parametrize("after", [0, 1, 2])
def test_can_node_joining_in_intermission_arbitrates(after: int) -> None:
    async def main(clock: Clock) -> None:
        bus = MemoryCanBus(clock)
        talker, other, log = bus.connect(), bus.connect(), Log(bus.connect(), clock)
        start, frames = clock.now(), [CanFrame(0x123), CanFrame(0x124)]
        talker.send(frames)
        await clock.sleep_until(start + (frame_time_bits(frames[0]) + after) * US)
        other.send([CanFrame(0x001)])
        late = Log(bus.connect(), clock)
        await pass_time(1)
        assert [frame.identifier for frame in log.frames] == [0x123, 0x001, 0x124]
        assert late.frames == log.frames[1:]
        assert log.times[1] == start + (line_bits(frames[0]) + frame_time_bits(log.frames[1])) / bus.bitrate
        assert bus.busy_s == sum(line_bits(frame) for frame in log.frames) / bus.bitrate

    virtual(main)


def test_can_node_leaving_in_intermission_sends_nothing() -> None:
    async def main(clock: Clock) -> None:
        bus = MemoryCanBus(clock)
        talker, log = bus.connect(), Log(bus.connect(), clock)
        start, frames = clock.now(), [CanFrame(0x123), CanFrame(0x124)]
        talker.send(frames)
        await clock.sleep_until(start + (frame_time_bits(frames[0]) + 1) * US)
        bus.disconnect(talker)
        await pass_time(1)
        assert log.frames == frames[:1]
        assert bus.busy_s == line_bits(frames[0]) / bus.bitrate

    virtual(main)


def test_can_disturbance_in_intermission_spoils_next_frame() -> None:
    async def main(clock: Clock) -> None:
        bus = MemoryCanBus(clock)
        talker, log = bus.connect(), Log(bus.connect(), clock)
        start, frames = clock.now(), [CanFrame(0x123), CanFrame(0x124)]
        talker.send(frames)
        await clock.sleep_until(start + (frame_time_bits(frames[0]) + 1) * US)
        bus.disturb = Hits(20)
        await pass_time(1)
        assert bus.errors == 1
        bits = line_bits(frames[0]) + 20 + ERROR_FRAME + BETWEEN + frame_time_bits(frames[1])
        assert log.times[1] == pytest.approx(start + bits * US, abs=1e-11)

    virtual(main)


def test_can_long_burst_does_not_drift() -> None:
    async def main(clock: Clock) -> None:
        bus = MemoryCanBus(clock)
        sender, log = bus.connect(), Log(bus.connect(), clock)
        start, frame = clock.now(), CanFrame(0x123, bytes(8))
        sender.send([frame] * 1000)
        await pass_time(1)
        assert log.times[-1] == start + (1000 * line_bits(frame) - 3) / 1_000_000

    virtual(main)


def test_can_queue_is_bounded_and_emptied_on_leave() -> None:
    async def main(clock: Clock) -> None:
        bus = MemoryCanBus(clock, 10_000)
        sender, log = bus.connect(), Log(bus.connect(), clock)
        with pytest.raises(TransportError, match="the send queue is full"):
            sender.send([CanFrame(1)] * 1025)
        sender.send([CanFrame(1)] * 1024)
        start = clock.now()
        await sender.aclose()
        assert clock.now() == start + 1.0
        await pass_time(1)
        assert len(log.items) == 10_000 // line_bits(CanFrame(1))
        # a slow bus is not stuck: no frame was abandoned before the close
        assert sender.statistics.dropped == 1024 - len(log.items)

    virtual(main)


def test_can_error_report_cannot_be_sent() -> None:
    async def main(clock: Clock) -> None:
        with pytest.raises(ValueError, match="not a frame"):
            MemoryCanBus(clock).connect().send([CanFrame(0x040, bytes(8), error=True)])

    virtual(main)


def test_can_filters_select_received_frames() -> None:
    async def main(clock: Clock) -> None:
        bus = MemoryCanBus(clock)
        sender, node = bus.connect(), bus.connect([CanFilter(0x600, 0x700), CanFilter(0x101)])
        log = Log(node, clock)
        sender.send([CanFrame(number) for number in (0x100, 0x101, 0x601, 0x6FF, 0x700)])
        await pass_time(1)
        assert [frame.identifier for frame in log.frames] == [0x101, 0x601, 0x6FF]
        assert node.statistics.received == 3
        # a node acknowledges a frame even if it filters it
        assert sender.statistics.sent == 5

    virtual(main)


# --- no acknowledge


def test_can_lone_node_becomes_error_passive_only() -> None:
    async def main(clock: Clock) -> None:
        bus = MemoryCanBus(clock)
        node = bus.connect()
        log, start, frame = Log(node, clock), clock.now(), CanFrame(0x123, b"\x55")
        node.send([frame])
        await pass_time(1)
        attempt = stuffed_bits(frame) + DELIMITER_AND_SLOT + ERROR_FRAME
        # 12 × 8 = 96 and 16 × 8 = 128 transmit errors; up to there without the pause of a passive node
        assert [at for at, _ in log.reports[:2]] == [
            start + (12 * attempt + 11 * BETWEEN) / 1_000_000,
            start + (16 * attempt + 15 * BETWEEN) / 1_000_000,
        ]
        assert log.states == [ErrorState.WARNING, ErrorState.PASSIVE, None]
        assert log.reports[1][1].counters == (128, 0)
        assert ErrorClass.NO_ACKNOWLEDGE in log.reports[1][1].classes
        dropped, report = log.reports[2]
        assert report.classes == ErrorClass.TX_TIMEOUT
        cycle = attempt + BETWEEN + SUSPEND
        assert start + PATIENCE <= dropped < start + PATIENCE + cycle * US
        assert node.counters == ErrorCounters(128, 0)
        assert bus.errors == 16 + round(
            (dropped - start - (16 * (attempt + BETWEEN) + SUSPEND) * US) / (cycle * US)
        )
        assert (node.statistics.sent, node.statistics.dropped, node.statistics.bus_off) == (0, 1, 0)
        await node.aclose()
        assert isinstance(log.end, TransportClosed)

    virtual(main)


def test_can_lone_sender_costs_little_time() -> None:
    async def main(clock: Clock) -> None:
        calls = 0
        call_at = clock.call_at

        def counting(when: float, callback: Callable[[], object]) -> Any:
            nonlocal calls
            calls += 1
            return call_at(when, callback)

        clock.call_at = counting
        node = MemoryCanBus(clock).connect()
        for _ in range(10):
            node.send([CanFrame(0x123)])
            await pass_time(1.0)
        assert node.statistics.dropped == 10
        assert calls < 100

    virtual(main)


def test_can_lone_node_closes_without_acknowledge() -> None:
    async def main(clock: Clock) -> None:
        node = MemoryCanBus(clock).connect()
        start = clock.now()
        node.send([CanFrame(0x123)])
        await node.aclose()
        assert clock.now() - start == pytest.approx(PATIENCE, abs=1e-4)

    virtual(main)


@pytest.mark.parametrize("after", [0.0, 0.0001, 0.05])
def test_can_joining_node_acknowledges_lone_sender(after: float) -> None:
    async def main(clock: Clock) -> None:
        bus = MemoryCanBus(clock)
        sender, frame = bus.connect(), CanFrame(0x123)
        own = Log(sender, clock)
        sender.send([frame])
        await pass_time(after)
        joined, log = clock.now(), Log(bus.connect(), clock)
        await pass_time(1)
        assert log.frames == [frame]
        cycle = stuffed_bits(frame) + DELIMITER_AND_SLOT + ERROR_FRAME + BETWEEN + SUSPEND
        earliest = joined + frame_time_bits(frame) * US
        assert earliest - 1e-11 <= log.times[0] < earliest + cycle * US
        assert sender.statistics.sent == 1
        assert sender.statistics.dropped == 0
        # no miss at 0 s; one or two attempts failed in 0.1 ms; all of 16 in 50 ms; the success takes one off
        assert sender.counters.transmit in {0.0: {0}, 0.0001: {7, 15}, 0.05: {127}}[after]
        if after == 0.05:
            assert own.states == [ErrorState.WARNING, ErrorState.PASSIVE, ErrorState.WARNING]

    virtual(main)


def test_can_old_frames_are_dropped() -> None:
    async def main(clock: Clock) -> None:
        bus = MemoryCanBus(clock)
        sender = bus.connect()
        for k in range(5):
            sender.send([CanFrame(0x100 + k)])
            await pass_time(0.04)
        log = Log(bus.connect(), clock)
        await pass_time(1)
        # at 0.20 s those of 0.00, 0.04 and 0.08 have waited for 0.1 s
        assert [frame.identifier for frame in log.frames] == [0x103, 0x104]
        assert sender.statistics.dropped == 3

    virtual(main)


def test_can_node_that_never_wins_drops_frame() -> None:
    async def main(clock: Clock) -> None:
        bus = MemoryCanBus(clock)
        loud, quiet = bus.connect(), bus.connect()
        log, arrivals = Log(bus.connect(), clock), Log(quiet, clock)
        quiet.send([CanFrame(0x700)])
        for _ in range(2):
            loud.send([CanFrame(0x100, bytes(8))] * 850)
            await pass_time(0.1)
        await pass_time(1)
        assert CanFrame(0x700) not in log.frames
        assert [report.classes for _, report in arrivals.reports] == [ErrorClass.TX_TIMEOUT]

    virtual(main)


# --- by URL


def test_can_nodes_must_have_same_bit_rate() -> None:
    async def main(clock: Clock) -> None:
        listening = await listen_can("can+memory:sensor?bitrate=500000", clock)
        with pytest.raises(ConfigError, match="bitrate=250000"):
            await connect_can("can+memory:sensor?bitrate=250000", clock)
        client, log = await connect_can(listening.address, clock), Log(listening.transport, clock)
        start = clock.now()
        client.send([CanFrame(0x100)])
        await pass_time(1)
        assert log.times == [start + frame_time_bits(CanFrame(0x100)) / 500_000]
        await client.aclose()
        await listening.transport.aclose()
        # the bus ends with its last node
        await (await connect_can("can+memory:sensor?bitrate=250000", clock)).aclose()

    virtual(main)


def test_can_bus_of_url_is_accessible() -> None:
    async def main(clock: Clock) -> None:
        with pytest.raises(ConfigError, match="this bus has no nodes"):
            memory_can_bus("sensor", clock)
        node = await connect_can("can+memory:sensor", clock, accept=[CanFilter(0x601)])
        assert isinstance(node, MemoryCanNode)
        log = Log(node, clock)
        sender = memory_can_bus("sensor", clock).connect()
        sender.send([CanFrame(0x601), CanFrame(0x602)])
        await pass_time(1)
        assert log.frames == [CanFrame(0x601)]

    virtual(main)


# --- behind an slcan adapter


def test_slcan_frames_take_bit_times_of_bus() -> None:
    """In both directions, one after the other, although the host's text is transmitted at once."""

    async def main(clock: Clock) -> None:
        rate = 250_000
        here, there = memory_pair(clock)
        device = SlcanDevice(there, SlcanAdapter(SlcanProfile(bus_bit_rate=rate)), clock)
        received, host = Log(device, clock), SlcanWire(here, rate, clock)
        arrivals: list[tuple[float, CanFrame]] = []
        host.start(
            lambda frames: arrivals.extend((clock.now(), frame) for frame in frames), lambda error: None
        )
        await pass_time(0.1)
        frames = [CanFrame(0x200 + k, bytes(8)) for k in range(3)]
        start = clock.now()
        device.send(frames)
        await pass_time(0.1)
        bits = [frame_time_bits(frame) for frame in frames]
        ends = [sum(bits[: k + 1]) + k * BETWEEN for k in range(3)]
        assert [frame for _, frame in arrivals] == frames
        assert [at for at, _ in arrivals] == pytest.approx([start + end / rate for end in ends], abs=1e-9)
        start = clock.now()
        host.send(frames)
        await pass_time(0.1)
        assert received.frames == frames
        assert received.times == pytest.approx([start + end / rate for end in ends], abs=1e-9)
        device.send(frames * 400)  # frames beyond the capacity are lost, and the wire continues
        assert (device.lost, received.end) == (1200, None)
        await device.aclose()
        assert isinstance(received.end, TransportClosed)

    virtual(main)
