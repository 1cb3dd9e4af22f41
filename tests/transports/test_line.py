"""Emulated lines with different ends, breaks, a pulled plug and a USB adapter, in virtual time."""

from asyncio import sleep as pass_time  # in virtual time, without waiting
from itertools import pairwise
from typing import Any

import pytest

from hil_bridge.clock import Clock, run_virtual
from hil_bridge.errors import TransportError
from hil_bridge.transports import (
    Damaged,
    LineErrors,
    LineSettings,
    PacedLine,
    Parity,
    Transport,
    Uart,
    UsbAdapter,
    UsbAdapterProfile,
    connect_bytes,
    listen_bytes,
    memory_pair,
)
from hil_bridge.transports.wrappers import Direction

N, E = LineSettings(9600), LineSettings(9600, Parity.EVEN)
ENQ, ACK = b"\x05", b"\x06"
CHARACTER = 11 / 9600
TEXT = b"The quick brown fox jumps over the lazy dog."


class Log:
    """Arrivals at a transport, with the time."""

    def __init__(self, transport: Transport[Any], clock: Clock) -> None:
        self.items: list[tuple[float, bytes]] = []
        self.end: TransportError | None = None
        self._clock = clock
        transport.start(lambda data: self.items.append((clock.now(), data)), self._on_end)

    def _on_end(self, error: TransportError) -> None:
        self.end = error

    @property
    def data(self) -> bytes:
        return b"".join(data for _, data in self.items)


async def memory_line(
    clock: Clock, device: str, client: str
) -> tuple[Log, PacedLine, Log, Transport[bytes], list[str]]:
    """Return device and client of a memory wire: received data, the client's line, the device's wire, notices."""
    listening = await listen_bytes(f"memory:robot{device}", clock)
    notices: list[str] = []
    line = await connect_bytes(f"memory:robot{client}", clock, lambda kind, text: notices.append(text))
    assert isinstance(line, PacedLine)
    return Log(line, clock), line, Log(listening.transport, clock), listening.transport, notices


@pytest.mark.parametrize(
    ("device", "client"),
    [
        ("?baudrate=9600&parity=E", "?baudrate=9600&parity=N"),
        ("?baudrate=9600&parity=N", "?baudrate=9600&parity=E"),
        ("?baudrate=9600&parity=E", "?baudrate=9600&parity=O"),
        ("?baudrate=9600&parity=E", "?baudrate=19200&parity=E"),
        ("?baudrate=19200&parity=E", "?baudrate=9600&parity=E"),
        ("?baudrate=9600&parity=E", "?baudrate=4800&parity=E"),
    ],
)
def test_line_bid_at_wrong_settings_is_not_received(device: str, client: str) -> None:
    async def main() -> None:
        clock = Clock.running()
        near_log, line, far_log, wire, notices = await memory_line(clock, device, client)
        line.send(ENQ)
        await pass_time(0.5)
        assert ENQ not in far_log.data
        wire.send(TEXT)
        await pass_time(0.5)
        # a port that differs only in parity reads some bytes correctly, but reports them as damaged
        assert line.line_errors != LineErrors()
        assert len(notices) == 1
        assert "check baudrate and parity" in notices[0]
        if "parity=E" in device and "parity=E" in client:
            assert TEXT not in near_log.data

    run_virtual(main)


@pytest.mark.parametrize(
    ("device", "client"),
    [
        ("?baudrate=9600&parity=E", "?baudrate=9600&parity=E"),
        ("?baudrate=9600&parity=E", ""),
        ("", "?baudrate=9600&parity=E"),
        ("?baudrate=9600&parity=E", "?baudrate=9600&parity=E&stopbits=2"),
    ],
)
def test_line_default_or_same_settings_are_received(device: str, client: str) -> None:
    async def main() -> None:
        clock = Clock.running()
        near_log, line, far_log, wire, notices = await memory_line(clock, device, client)
        start = clock.now()
        line.send(bytes(range(200)))
        wire.send(bytes(range(200)))
        await pass_time(1)
        assert near_log.data == far_log.data == bytes(range(200))
        bits = 12 if "stopbits" in client else 11
        assert far_log.items[-1][0] == start + 200 * bits / 9600
        assert near_log.items[-1][0] == start + 200 * CHARACTER
        assert notices == []

    run_virtual(main)


def test_line_damaged_characters_are_read_as_configured() -> None:
    async def single(damaged: str) -> bytes:
        clock = Clock.running()
        _, line, far_log, wire, _ = await memory_line(
            clock, f"?baudrate=9600&parity=E{damaged}", "?baudrate=9600&parity=N"
        )
        line.send(ENQ)
        await pass_time(0.1)
        assert line.far_line_errors == LineErrors(parity=1)
        await line.aclose()
        await wire.aclose()
        return far_log.data

    async def check() -> None:
        assert await single("") == b""
        assert await single("&damaged=drop") == b""
        assert await single("&damaged=keep") == ENQ
        assert await single("&damaged=zero") == b"\x00"

    run_virtual(check)


def test_line_damaged_characters_are_noted_once_per_second() -> None:
    async def main() -> None:
        clock = Clock.running()
        near_log, line, _, wire, notices = await memory_line(
            clock, "?baudrate=9600&parity=E", "?baudrate=9600&parity=N"
        )
        for _ in range(30):
            wire.send(ACK)
            await pass_time(0.1)
        assert near_log.data == b"\x06\xff" * 30  # the low parity bit begins another character
        assert line.line_errors == LineErrors(framing=30)
        assert notices == [
            f"memory:robot: {count} framing errors on a line set to 9600 8N1; check baudrate and parity"
            for count in (1, 11, 21)
        ]

    run_virtual(main)


def test_line_changed_settings_apply_to_next_burst() -> None:
    async def main() -> None:
        clock = Clock.running()
        inner, far_wire = memory_pair(clock)
        settings = E
        near = PacedLine(
            inner, Uart(lambda: E, Damaged.DROP), clock, far=Uart(lambda: settings, Damaged.DROP)
        )
        near_log, far_log = Log(near, clock), Log(far_wire, clock)
        for settings, arrives in ((E, True), (N, False), (LineSettings(300, Parity.EVEN), False), (E, True)):
            before = len(near_log.data), len(far_log.data)
            far_wire.send(b"ACK")
            near.send(b"ACK")
            await pass_time(1)
            assert (near_log.data[before[0] :] == b"ACK") is arrives
            assert (far_log.data[before[1] :] == b"ACK") is arrives
            if settings.baudrate == 300:
                # at 300 baud each bit of the other end is 32 of ours: only breaks and single high bits
                assert near.line_errors.breaks > 5

    run_virtual(main)


def test_line_break_is_damaged_zero_and_loses_characters() -> None:
    async def main() -> None:
        clock = Clock.running()
        inner, far_wire = memory_pair(clock)
        near = PacedLine(inner, Uart(lambda: E, Damaged.DROP), clock, far=Uart(lambda: E))
        near_log, far_log = Log(near, clock), Log(far_wire, clock)
        start = clock.now()
        near.send_break(0.25)
        near.send_break(0.25, Direction.RECEIVED)
        await pass_time(0.1)
        assert far_log.items == [(pytest.approx(start + CHARACTER, abs=1e-3), b"\x00")]
        assert near_log.data == b""
        assert near.line_errors == near.far_line_errors == LineErrors(breaks=1)
        near.send(b"unseen")
        far_wire.send(b"unseen")
        await clock.sleep_until(start + 1)
        near.send(b"seen")
        far_wire.send(b"seen")
        await pass_time(1)
        assert far_log.data == b"\x00seen"
        assert near_log.data == b"seen"
        assert near.line_errors == near.far_line_errors == LineErrors(breaks=1)

    run_virtual(main)


def test_line_break_within_burst_keeps_other_characters() -> None:
    async def main() -> None:
        clock = Clock.running()
        inner, far_wire = memory_pair(clock)
        near, far_log = PacedLine(inner, E, clock), Log(far_wire, clock)
        start = clock.now()
        near.send(bytes(range(1, 101)))
        await clock.sleep_until(start + 20.4 * CHARACTER)
        near.send_break(30 * CHARACTER)
        await pass_time(1)
        assert far_log.data[:20] == bytes(range(1, 21))
        # the receiver needs some characters to synchronise with an uninterrupted burst
        assert far_log.data.endswith(bytes(range(80, 101)))
        assert 60 <= len(far_log.data) <= 75
        assert near.far_line_errors.breaks == 1

    run_virtual(main)


def test_line_held_low_until_released() -> None:
    async def main() -> None:
        clock = Clock.running()
        inner, far_wire = memory_pair(clock)
        near, far_log = PacedLine(inner, E, clock), Log(far_wire, clock)
        near.hold(True)
        near.send(b"unseen")
        await pass_time(3)
        near.hold(False)
        await pass_time(1)
        near.send(b"seen")
        await pass_time(1)
        assert far_log.data == b"\x00seen"

    run_virtual(main)


def test_line_end_arrives_after_last_character() -> None:
    async def main() -> None:
        clock = Clock.running()
        inner, far_wire = memory_pair(clock)
        near = PacedLine(inner, LineSettings(4800), clock, far=Uart(lambda: N))
        near_log = Log(near, clock)
        far_wire.send(bytes(20))
        await far_wire.aclose()
        await pass_time(1)
        # of a zero and its stop bit the fifth sample is high, and a slow character is two of theirs
        assert near_log.data == b"\x08" * 10
        assert near_log.end is not None

    run_virtual(main)


# --- USB


def adapter(clock: Clock, latency_s: float, far: bool = False) -> tuple[Transport[bytes], Transport[bytes]]:
    """Return computer and device of an adapter, with the model at the computer's or the device's end of a wire."""
    left, right = memory_pair(clock)
    profile = UsbAdapterProfile(latency_s=latency_s)
    if far:
        return left, UsbAdapter(right, profile, clock, Direction.SENT)
    return UsbAdapter(left, profile, clock), right


@pytest.mark.parametrize("far", [False, True])
@pytest.mark.parametrize(("latency_s", "arrives_s"), [(0.016, 0.017), (0.001, 0.006), (0.002, 0.007)])
def test_usb_single_byte_waits_for_timer_and_frame(far: bool, latency_s: float, arrives_s: float) -> None:
    async def main() -> None:
        clock = Clock.running()
        computer, device = adapter(clock, latency_s, far)
        start, log = clock.now(), Log(computer, clock)
        Log(device, clock)
        await clock.sleep_until(start + 0.0047)
        device.send(ACK)
        await pass_time(1)
        assert log.items == [(pytest.approx(start + arrives_s, abs=1e-9), ACK)]

    run_virtual(main)


@pytest.mark.parametrize("far", [False, True])
def test_usb_full_packets_are_sent_at_once(far: bool) -> None:
    async def main() -> None:
        clock = Clock.running()
        computer, device = adapter(clock, 0.016, far)
        start, log = clock.now(), Log(computer, clock)
        Log(device, clock)
        await clock.sleep_until(start + 0.0105)
        device.send(bytes(130))
        await pass_time(1)
        assert [(round((at - start) * 1e3, 6), len(data)) for at, data in log.items] == [
            (11.0, 62),
            (11.0, 62),
            (27.0, 6),  # 10.5 + 16 ms, and the next frame
        ]

    run_virtual(main)


@pytest.mark.parametrize("far", [False, True])
def test_usb_sent_bytes_wait_for_frame_only(far: bool) -> None:
    async def main() -> None:
        clock = Clock.running()
        computer, device = adapter(clock, 0.016, far)
        start, log = clock.now(), Log(device, clock)
        Log(computer, clock)
        await clock.sleep_until(start + 0.0203)
        computer.send(b"a")
        await clock.sleep_until(start + 0.0206)
        computer.send(b"b")
        await pass_time(1)
        assert log.data == b"ab"
        assert {round((at - start) * 1e3, 6) for at, _ in log.items} == {21.0}

    run_virtual(main)


def test_usb_adapter_limits_bytes_in_transit() -> None:
    async def main() -> None:
        clock = Clock.running()
        computer, _ = adapter(clock, 0.016)
        with pytest.raises(TransportError, match="queue of 65536 bytes is full"):
            computer.send(bytes(65537))

    run_virtual(main)


@pytest.mark.parametrize(
    ("latency_ms", "shortest", "longest"), [(16, 0.016, 0.016), (1, 2 * CHARACTER, 2 * CHARACTER + 0.003)]
)
def test_usb_exchange_takes_latency_timer(latency_ms: int, shortest: float, longest: float) -> None:
    async def main() -> None:
        clock = Clock.running()
        listening = await listen_bytes("memory:robot?baudrate=9600&parity=E", clock)
        client = await connect_bytes(f"memory:robot?usb_latency_ms={latency_ms}", clock)
        listening.transport.start(lambda data: listening.transport.send(ACK), lambda error: None)
        answer_times: list[float] = []

        def ask_again(data: bytes) -> None:
            assert data == ACK
            answer_times.append(clock.now())
            client.send(ENQ)

        client.start(ask_again, lambda error: None)
        client.send(ENQ)
        await pass_time(1)
        rounds = [after - before for before, after in pairwise(answer_times)]
        assert len(rounds) > 50
        assert shortest - 1e-9 <= min(rounds)
        assert max(rounds) <= longest + 1e-9

    run_virtual(main)
