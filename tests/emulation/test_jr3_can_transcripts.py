"""Tests of the emulated CAN gateway against its transcripts; frames are built by hand, not by the codec."""

import itertools
import math
import struct
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from emulators.devices.jr3 import Gateway, GatewayProfile, Jr3Sensor, SensorProfile
from emulators.sensing import KnownWrench
from protocol.devices.jr3 import GatewayClient, GatewayClientProfile, parse_frame
from protocol.wrench import SensorNotice, SensorReady, WrenchFrame, Zeroed
from tests.emulation.jr3_can_transcripts import CLIENT_TRANSCRIPT, TRANSCRIPTS, VARIANTS, Transcript

T0 = 4321.0
TS_MS = 0.1285
COUNTS = (1000, -2000, 3000, 400, -500, 600)
UNITS = np.array([115, 111, 185, 5.6, 5.2, 6.1]) / 16384

KIND = GatewayProfile(
    loop_ms=0.0, period_overhead_us=(0.0, 0.0), joins=False, blocks=False, buffer_loses="newest"
)
"""Settings of a gateway without any delay."""

FIRMWARE = GatewayProfile(period_overhead_us=(0.0, 0.0))
"""Settings with the firmware's own delays, but with exact periods."""


def frames(text: str) -> list[str]:
    """Return the frames that a line denotes."""
    word, *rest = text.split()
    counts: tuple[int, ...] = COUNTS
    match word, *rest:
        case ("sample", number):
            pass
        case ("zeros", number):
            counts = (0,) * 6
        case ("filtered", number, cutoff):
            alpha = TS_MS / (TS_MS + 1e3 / (2 * math.pi * float(cutoff)))
            reached = 1 - (1 - alpha) ** int(number)
            counts = tuple(math.floor(count * reached) for count in COUNTS)
        case _:
            return [text]
    halves = ((0x601, counts[:3]), (0x681, counts[3:]))
    return [
        f"{number_:03X}#{struct.pack('<hhhH', *half, int(number)).hex().upper()}" for number_, half in halves
    ]


def constant(times: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.tile(COUNTS * UNITS, (len(times), 1))


def powered(connected: bool = True, profile: GatewayProfile = KIND) -> Gateway:
    sensor = Jr3Sensor(SensorProfile(noise_counts=0.0, connected=connected), KnownWrench(constant), seed=3)
    return Gateway(profile, sensor, powered_at=T0)


@pytest.mark.parametrize("transcript", TRANSCRIPTS, ids=lambda transcript: transcript.sentence[:60])
def test_transcript_matches(transcript: Transcript) -> None:
    _check(transcript, powered(transcript.connected))


@pytest.mark.parametrize("transcript", VARIANTS, ids=lambda transcript: transcript.sentence[:60])
def test_transcript_of_firmware_matches(transcript: Transcript) -> None:
    _check(transcript, powered(transcript.connected, FIRMWARE))


@pytest.mark.parametrize(("loses", "first"), [("oldest", 8), ("newest", 0)])
def test_burst_of_40_commands_overflows_buffer_of_32(loses: Literal["oldest", "newest"], first: int) -> None:
    """Alternating queries of force and moment scales show which were answered."""
    gateway = powered(profile=replace(FIRMWARE, buffer_loses=loses))
    gateway.handle_deadline(T0 + 2.6)
    gateway.data_to_send(T0 + 2.6)
    burst = ["481#", "501#", "401#", "481#", "401#"] * 8
    gateway.receive([parse_frame(text) for text in burst], T0 + 2.6002)
    assert gateway.data_to_send(T0 + 2.6002) == []
    gateway.handle_deadline(T0 + 2.601)
    answers = [str(frame) for frame in gateway.data_to_send(T0 + 2.601)]
    of = {"401#": "101#00", "481#": "101#0073006F00B900", "501#": "101#00380034003D00"}
    assert answers == [of[text] for text in burst[first : first + 32]]


def test_stream_period_includes_sending_and_wake_up() -> None:
    gateway = powered(profile=GatewayProfile())
    gateway.handle_deadline(T0 + 2.6)
    gateway.data_to_send(T0 + 2.6)
    gateway.receive([parse_frame("201#000010270000")], T0 + 2.6)
    times: list[float] = []
    while len(times) < 1000:
        due = gateway.next_deadline()
        assert due is not None
        gateway.handle_deadline(due)
        times += [due] * bool(gateway.data_to_send(due))
    longer_us = np.diff(times) * 1e6 - 10_000
    assert 30.0 - 1e-3 <= longer_us.min() < 31.0
    assert 59.0 < longer_us.max() <= 60.0 + 1e-3


def _check(transcript: Transcript, gateway: Gateway) -> None:
    expected: list[tuple[float, str]] = []
    reported: list[tuple[float, str]] = []

    def take(now: float) -> None:
        at = round((now - T0) * 1e3, 3)
        reported.extend((at, str(frame)) for frame in gateway.data_to_send(now))

    def run(until: float) -> None:
        while (due := gateway.next_deadline()) is not None and due <= until + 1e-9:
            gateway.handle_deadline(due)
            take(due)

    for line in transcript.lines.strip().splitlines():
        milliseconds, direction, text = line.split(maxsplit=2)
        at = float(milliseconds)
        now = T0 + at * 1e-3
        if direction == ">":
            run(now)
            gateway.receive([parse_frame(text)], now)
            take(now)
        elif direction == "!":
            run(now)
            getattr(gateway, text)(now)
        else:
            expected += [(at, frame) for frame in frames(text)]
    if expected:
        run(T0 + expected[-1][0] * 1e-3)
    assert reported == expected


def test_client_sends_commands_of_transcript() -> None:
    """State, start, full scales, a pause and zero; then the sequence continues at the wrap of the counter."""
    gateway = powered()
    now = T0 + 2.5
    gateway.handle_deadline(now)
    gateway.data_to_send(now)
    client = GatewayClient(GatewayClientProfile(cutoff_hz=0.0, period_ms=120.0), now)
    client.zero()
    reported: list[tuple[float, str, str]] = []
    events: list[object] = []
    while now < T0 + 12.5:
        while (down := client.data_to_send(now)) or (up := gateway.data_to_send(now)):
            at = round((now - T0) * 1e3, 3)
            if down:
                gateway.receive(down, now)
                reported += [(at, ">", str(frame)) for frame in down]
            else:
                client.receive(up, now)
                reported += [(at, "<", str(frame)) for frame in up]
        while (event := client.next_event()) is not None:
            events.append(event)
        dues = [due for due in (client.next_deadline(), gateway.next_deadline()) if due is not None]
        now = min(dues)
        gateway.handle_deadline(now)
        client.handle_deadline(now)
    expected = []
    for line in CLIENT_TRANSCRIPT.strip().splitlines():
        at_ms, direction, text = line.split(maxsplit=2)
        expected += [(float(at_ms), direction, frame) for frame in frames(text)]
    assert reported[: len(expected)] == expected
    samples = [event for event in events if isinstance(event, WrenchFrame)]
    assert [type(event) for event in events[:3]] == [SensorReady, SensorNotice, Zeroed]
    assert {b.sequence - a.sequence for a, b in itertools.pairwise(samples)} == {933, 934}
    wraps = [(a.counter, b.counter) for a, b in itertools.pairwise(samples) if b.counter < a.counter]
    assert len(wraps) == 1
    assert samples[-1].sequence > 65536
    assert client.statistics.lost == 0
