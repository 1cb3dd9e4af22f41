"""Wires in virtual time, in addition to the suite: exact times, faults, arbitration, new clients."""

import asyncio
import socket
from asyncio import sleep as pass_time  # in virtual time, without waiting
from contextlib import ExitStack
from itertools import islice
from typing import Any

import pytest

from hil_bridge.clock import Clock, run_virtual
from hil_bridge.errors import (
    TransportBroken,
    TransportClosed,
    TransportError,
    TransportUnavailable,
)
from hil_bridge.testing.wires import Delayed, Faults, Faulty
from hil_bridge.transports import (
    Direction,
    LineSettings,
    PacedLine,
    Parity,
    Reconnecting,
    Tap,
    Transport,
    connect_bytes,
    listen_bytes,
    memory_pair,
)
from hil_bridge.transports.back_off import persistent, waits
from hil_bridge.transports.delivery import Delivery
from hil_bridge.transports.tcp import listen_tcp_clients

LINE = LineSettings(9600, Parity.EVEN, 1)


class Log:
    """Arrivals at a transport, with the time."""

    def __init__(self, transport: Transport[Any], clock: Clock) -> None:
        self.items: list[tuple[float, Any]] = []
        self.end: TransportError | None = None
        self._clock = clock
        transport.start(lambda data: self.items.append((clock.now(), data)), self._on_end)

    def _on_end(self, error: TransportError) -> None:
        self.end = error

    @property
    def times(self) -> list[float]:
        return [at for at, _ in self.items]


def test_line_character_has_11_bits_at_8e1_and_10_at_8n1() -> None:
    assert LINE.bits == 11
    assert LineSettings(19200).bits == 10
    assert LineSettings(300, Parity.ODD, 2).bits == 12


@pytest.mark.parametrize("outward", [True, False])
def test_paced_block_takes_its_character_times(outward: bool) -> None:
    async def main() -> None:
        clock = Clock.running()
        inner, far = memory_pair(clock)
        near = PacedLine(inner, LINE, clock, fifo=14)
        near_log, far_log = Log(near, clock), Log(far, clock)
        await pass_time(0.1)
        start = clock.now()
        block = bytes(range(57))
        (near if outward else far).send(block)
        await pass_time(1.0)
        log = far_log if outward else near_log
        assert b"".join(data for _, data in log.items) == block
        assert [len(data) for _, data in log.items] == [14, 14, 14, 14, 1]
        assert log.times == [start + n * 11 / 9600 for n in (14, 28, 42, 56, 57)]

    run_virtual(main)


def test_paced_bursts_queue_and_idle_time_is_lost() -> None:
    async def main() -> None:
        clock = Clock.running()
        inner, far = memory_pair(clock)
        near, far_log = PacedLine(inner, LINE, clock, fifo=14), Log(far, clock)
        start = clock.now()
        near.send(b"abc")
        near.send(b"de")  # extends the burst
        await clock.sleep_until(start + 2 * 11 / 9600)
        near.send(b"f")
        await clock.sleep_until(start + 1.0)
        near.send(b"g")
        await pass_time(1.0)
        assert far_log.items == [(start + 6 * 11 / 9600, b"abcdef"), (start + 1.0 + 11 / 9600, b"g")]

    run_virtual(main)


def test_paced_times_do_not_drift_over_a_long_burst() -> None:
    async def main() -> None:
        clock = Clock.running()
        inner, far = memory_pair(clock)
        near, far_log = PacedLine(inner, LINE, clock), Log(far, clock)
        start = clock.now()
        near.send(bytes(50_000))
        await pass_time(100)
        assert far_log.times[-1] == start + 50_000 * 11 / 9600

    run_virtual(main)


def test_paced_bounds_both_queues() -> None:
    async def main() -> None:
        clock = Clock.running()
        inner, far = memory_pair(clock)
        near, far_log = PacedLine(inner, LINE, clock), Log(far, clock)
        near_log = Log(near, clock)
        with pytest.raises(TransportError, match="full"):
            near.send(bytes(70_000))
        near.send(b"fits")
        far.send(bytes(60_000))
        await pass_time(0)
        far.send(bytes(10_000))
        await pass_time(100)
        assert far_log.items[0][1] == b"fits"
        assert sum(len(data) for _, data in near_log.items) == 60_000
        assert near.overruns == 10_000

    run_virtual(main)


def test_paced_end_arrives_after_pending_bytes() -> None:
    async def main() -> None:
        clock = Clock.running()
        for wrap, last in (
            (lambda wire: PacedLine(wire, LINE, clock), 20 * 11 / 9600),
            (lambda wire: Delayed(wire, 0.25, clock), 0.25),
        ):
            inner, far = memory_pair(clock)
            near = wrap(inner)
            log, start = Log(near, clock), clock.now()
            far.send(bytes(20))
            await far.aclose()
            await pass_time(1)
            assert log.times[-1] == start + last
            assert log.end is not None

    run_virtual(main)


def test_paced_close_waits_up_to_one_second() -> None:
    async def main() -> None:
        clock = Clock.running()
        inner, far = memory_pair(clock)
        near, far_log = PacedLine(inner, LINE, clock, fifo=1), Log(far, clock)
        start = clock.now()
        near.send(bytes(5000))
        await near.aclose()
        assert clock.now() == start + 1.0
        await pass_time(1)
        assert len(far_log.items) == 872  # 9600 / 11 characters

    run_virtual(main)


def test_memory_latency_is_exact_in_both_directions() -> None:
    async def main() -> None:
        clock = Clock.running()
        inner, far = memory_pair(clock, 0.001)
        near = Delayed(inner, 0.0025, clock)
        near_log, far_log = Log(near, clock), Log(far, clock)
        start = clock.now()
        near.send(b"a")
        far.send(b"b")
        await clock.sleep_until(start + 0.0005)
        near.send(b"c")
        await pass_time(1)
        assert far_log.items == [(start + 0.0025 + 0.001, b"a"), (start + 0.0005 + 0.0025 + 0.001, b"c")]
        assert near_log.items == [(start + 0.001 + 0.0025, b"b")]

    run_virtual(main)


def test_memory_full_wire_refuses_and_keeps_order() -> None:
    async def main() -> None:
        clock = Clock.running()
        left, right = memory_pair(clock)
        left.send(bytes(65_000))
        with pytest.raises(TransportError, match="full"):
            left.send(bytes(1000))
        left.send(b"end")
        await pass_time(0)
        log = Log(right, clock)
        assert [len(data) for _, data in log.items] == [65_000, 3]
        left.send(bytes(65_000))

    run_virtual(main)


def test_memory_end_during_delivery_comes_once_and_last() -> None:
    events: list[object] = []
    delivery: Delivery[bytes] = Delivery("wire", 10)

    def cut(data: bytes) -> None:
        events.append(data)
        delivery.end(TransportBroken("wire: cut"))

    for data in (b"one", b"two", b"too much", b"six"):
        delivery.data(data)
    delivery.start(cut, lambda error: events.append(str(error)))
    assert events == [b"one", b"two", b"six", "wire: cut"]
    assert delivery.overruns == 8
    with pytest.raises(RuntimeError, match="already started"):
        delivery.start(cut, print)


def test_tap_reports_both_directions_in_order() -> None:
    async def main() -> None:
        clock, events = Clock.running(), []
        inner, far = memory_pair(clock)
        near = Tap(inner, lambda direction, data: events.append((direction, data)))
        log = Log(near, clock)
        near.send(b"ping")
        far.send(b"pong")
        await pass_time(0.1)
        assert events == [(Direction.SENT, b"ping"), (Direction.RECEIVED, b"pong")]
        assert [data for _, data in log.items] == [b"pong"]

    run_virtual(main)


def test_wire_faults_are_reproducible_at_their_rates() -> None:
    async def damaged(faults: Faults, seed: int, noise: bytes = b"") -> bytes:
        clock = Clock.running()
        inner, far = memory_pair(clock)
        near, log = Faulty(inner, faults, seed), Log(far, clock)
        near.start(lambda data: None, lambda error: None)
        for _ in range(10):
            far.send(noise)
            near.send(bytes(2000))
            await pass_time(0)
        await pass_time(0.1)
        return b"".join(data for _, data in log.items)

    async def main() -> None:
        all_faults = Faults(loss=0.02, corruption=0.03, duplication=0.01)
        first = await damaged(all_faults, 1)
        assert first == await damaged(all_faults, 1, noise=b"the other direction draws its own numbers")
        assert first != await damaged(all_faults, 2)
        assert len(await damaged(Faults(loss=0.1), 1)) == pytest.approx(18_000, abs=200)
        assert len(await damaged(Faults(duplication=0.1), 1)) == pytest.approx(22_000, abs=200)
        corrupted = await damaged(Faults(corruption=0.1), 1)
        assert len(corrupted) == 20_000
        assert {byte.bit_count() for byte in corrupted} == {0, 1}
        assert sum(byte > 0 for byte in corrupted) == pytest.approx(2000, abs=200)
        assert await damaged(Faults(), 1) == bytes(20_000)
        assert await damaged(Faults(loss=1.0), 1) == b""

    run_virtual(main)


def test_cut_cable_breaks_one_end_and_silences_other() -> None:
    async def main() -> None:
        clock = Clock.running()
        inner, far = memory_pair(clock)
        near = Faulty(inner, Faults())
        near_log, far_log = Log(near, clock), Log(far, clock)
        near.cut()
        assert isinstance(near_log.end, TransportBroken)
        with pytest.raises(TransportBroken):
            near.send(b"x")
        far.send(b"y")
        await pass_time(1)
        assert near_log.items == far_log.items == []
        assert far_log.end is None
        await near.aclose()
        assert isinstance(near_log.end, TransportBroken)

    run_virtual(main)


# --- by URL


def test_memory_listener_accepts_successive_clients() -> None:
    async def main() -> None:
        clock = Clock.running()
        with pytest.raises(TransportUnavailable, match="no program listens"):
            await connect_bytes("memory:robot", clock)
        listening = await listen_bytes("memory:robot", clock)
        with pytest.raises(TransportUnavailable, match="already"):
            await listen_bytes("memory:robot", clock)
        assert listening.address == "memory:robot"
        log = Log(listening.transport, clock)
        listening.transport.send(b"into the void")
        for k in range(3):
            client = await connect_bytes(f"{listening.address}?latency_ms=1.5", clock)
            with pytest.raises(TransportUnavailable, match="another client"):
                await connect_bytes("memory:robot", clock)
            received = Log(client, clock)
            start = clock.now()
            client.send(b"hello %d" % k)
            listening.transport.send(b"welcome %d" % k)
            await pass_time(0.1)
            assert received.items == [(start + 0.0015, b"welcome %d" % k)]
            await client.aclose()
            await pass_time(0.1)
        assert [data for _, data in log.items] == [b"hello 0", b"hello 1", b"hello 2"]
        assert log.end is None
        await listening.transport.aclose()
        assert isinstance(log.end, TransportClosed)
        await (await listen_bytes("memory:robot", clock)).transport.aclose()

    run_virtual(main)


def test_memory_url_with_baudrate_is_paced() -> None:
    async def main() -> None:
        clock = Clock.running()
        log = Log((await listen_bytes("memory:robot", clock)).transport, clock)
        client = await connect_bytes("memory:robot?latency_ms=2&baudrate=9600&parity=E", clock)
        start = clock.now()
        client.send(b"12345")
        await pass_time(1)
        assert log.items == [(start + 5 * 11 / 9600 + 0.002, b"12345")]

    run_virtual(main)


def test_memory_names_are_local_to_event_loop() -> None:
    async def main() -> None:
        await listen_bytes("memory:robot", Clock.running())

    run_virtual(main)
    run_virtual(main)


# --- wires that come back


def test_back_off_doubles_wait_up_to_limit() -> None:
    assert list(islice(waits(), 7)) == [0.1, 0.2, 0.4, 0.8, 1.6, 2.0, 2.0]


def test_back_off_ends_with_time_limit_and_last_reason() -> None:
    async def main() -> None:
        clock, attempts = Clock.running(), []

        async def fails() -> None:
            attempts.append(clock.now() - start)
            raise TransportUnavailable(f"try {len(attempts)}")

        for patience, expected in ((0.0, [0.0]), (1.0, [0.0, 0.1, 0.3, 0.7])):
            start = clock.now()
            attempts.clear()
            with pytest.raises(TransportUnavailable, match=f"try {len(expected)}"):
                await persistent(fails, patience, clock)
            assert attempts == pytest.approx(expected)
            assert clock.now() - start <= patience

    run_virtual(main)


def reconnecting(clock: Clock, absent: int) -> tuple[Reconnecting, list[Transport[bytes]], list[str]]:
    """Return a wire in memory that returns after this many failed attempts, its far ends, and the notices."""
    far_ends: list[Transport[bytes]] = []
    notices: list[str] = []
    attempts = iter(range(1000))

    def pair() -> Transport[bytes]:
        near, far = memory_pair(clock)
        far_ends.append(far)
        return near

    async def again() -> Transport[bytes]:
        if next(attempts) % (absent + 1) < absent:
            raise TransportUnavailable("no server")
        return pair()

    wire = Reconnecting(pair(), again, 30.0, clock, lambda kind, text: notices.append(text))
    return wire, far_ends, notices


def test_reconnecting_wire_loses_bytes_sent_meanwhile() -> None:
    async def main() -> None:
        clock = Clock.running()
        wire, far_ends, notices = reconnecting(clock, absent=2)
        log = Log(wire, clock)
        for k in range(3):
            far_log = Log(far_ends[-1], clock)
            wire.send(b"%d" % k)
            far_ends[-1].send(b"answer")
            await pass_time(0.1)
            assert [data for _, data in far_log.items] == [b"%d" % k]
            await far_ends[-1].aclose()
            await pass_time(0.05)
            wire.send(b"lost")
            await pass_time(1)
        assert wire.lost == 12
        assert len(log.items) == 3
        assert log.end is None
        assert [text.split(";")[-1] for text in notices] == [
            " trying to reconnect for 30 s",
            "memory:pair: back after 0.3 s",
        ] * 3
        await wire.aclose()
        assert isinstance(log.end, TransportClosed)

    run_virtual(main)


def test_reconnecting_wire_breaks_after_time_limit() -> None:
    async def main() -> None:
        clock = Clock.running()
        wire, far_ends, _ = reconnecting(clock, absent=999)
        log = Log(wire, clock)
        start = clock.now()
        await far_ends[0].aclose()
        await pass_time(60)
        assert isinstance(log.end, TransportBroken)
        assert "no return within 30 s: no server" in str(log.end)
        assert clock.now() - start == 60
        with pytest.raises(TransportBroken):
            wire.send(b"late")

    run_virtual(main)


def test_reconnecting_wire_closes_during_outage() -> None:
    async def main() -> None:
        clock = Clock.running()
        wire, far_ends, _ = reconnecting(clock, absent=999)
        log = Log(wire, clock)
        await far_ends[0].aclose()
        await pass_time(1)
        await wire.aclose()
        assert isinstance(log.end, TransportClosed)
        full, _, _ = reconnecting(clock, absent=0)
        with pytest.raises(TransportError, match="queue of 65536 bytes is full"):
            full.send(bytes(70_000))
        assert full.lost == 0
        await full.aclose()

    run_virtual(main)


def test_tcp_twelve_clients_wait_for_busy_server() -> None:
    clients_connected: list[Any] = []

    async def storm() -> None:
        all_connected = asyncio.Event()

        def welcome(wire: Any) -> None:
            clients_connected.append(wire)
            if len(clients_connected) == 12:
                all_connected.set()

        stop, host, port = await listen_tcp_clients("127.0.0.1", 0, Clock.running(), "here", welcome)
        with ExitStack() as stack:
            for _ in range(12):  # meanwhile the server's loop does not run
                stack.enter_context(socket.create_connection((host, port), timeout=5.0))
            await all_connected.wait()
        stop()
        for wire in clients_connected:
            await wire.aclose()

    asyncio.run(asyncio.wait_for(storm(), 30.0))
    assert len(clients_connected) == 12
