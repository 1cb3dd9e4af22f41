"""Tests of the emulated UART gateway by transcripts, including its misreadings.

A line is milliseconds since power-up, direction (`>` to the gateway, `<` from it) and bytes: plain text, or hex after a
colon; `! unplug` and `! plug_in` are the sensor's plug. `sample N` and `zeros N` denote a data frame with counter N,
built here by hand and not by the codec, of a sensor that reads 1000 −2000 3000 400 −500 600 counts.
"""

import itertools
import struct
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from emulators.devices.jr3 import Jr3Sensor, SensorProfile, UartGateway, UartGatewayProfile
from emulators.sensing import KnownWrench

T0 = 4321.0
COUNTS = (1000, -2000, 3000, 400, -500, 600)
UNITS = np.array([115, 108, 185, 5.6, 5.2, 6.1]) / 16384
SENSOR = SensorProfile(noise_counts=0.0, full_scales_n=(115.0, 108.0, 185.0))
OK, NOT_READY = ":3C3031003E", ":3C3031013E"
START_10_MS = ":3C3032000010270000 3E"

KIND: dict[str, Any] = {"period_overhead_us": (0.0, 0.0), "joins": False, "blocks": False}
"""Settings of a gateway without any delay."""

Wrench = Callable[[NDArray[np.float64]], NDArray[np.float64]]


@dataclass(frozen=True)
class Transcript:
    """Statement about the gateway, and the line traffic that shows it."""

    sentence: str
    lines: str
    connected: bool = True
    profile: dict[str, Any] = field(default_factory=dict)


TRANSCRIPTS = [
    Transcript(
        "boot takes 5 s: silence, then boot-up when the calibration is read",
        f"""
        100    > <06>
        4999   > <06>
        5033   < <10>
        5100   > <06>
        5100   < {OK}
        """,
    ),
    Transcript(
        "without a sensor no boot-up, acknowledges carry 1 and commands have no effect",
        f"""
        6000   > <06>
        6000   < {NOT_READY}
        7500   > {START_10_MS}
        7500   < {NOT_READY}
        9000   > <04>
        9000   < {NOT_READY}
        11000  > <07>
        11000  < :3C303101000000000000000000000000 3E
        13000  > <08>
        13000  < {NOT_READY}
        15000  > <05:C8003E
        15000  < {NOT_READY}
        17000  > <03>
        17000  < {NOT_READY}
        """,
        connected=False,
    ),
    Transcript(
        "it acknowledges first and is deaf for 1 s then: what is said to it is lost",
        f"""
        5033   < <10>
        6000   > <06>
        6000   < {OK}
        6010   > <07>
        6999   > <07>
        7000   > <07>
        7000   < :3C30310073006C00B900380034003D003E
        9000   > <06>
        9000   < {OK}
        """,
    ),
    Transcript(
        "start sends the first frame before the acknowledge, then one every period, also while it is deaf",
        f"""
        5033   < <10>
        6000   > {START_10_MS}
        6000   < zeros 0
        6000   < {OK}
        6010   < sample 77
        6020   < sample 155
        6030   < sample 233
        """,
    ),
    Transcript(
        "the counter counts full six-axis frames and wraps at 65536",
        f"""
        5033   < <10>
        6000   > :3C303200003F420F003E
        6000   < zeros 0
        6000   < {OK}
        6999.999  < sample 7782
        7999.998  < sample 15564
        8999.997  < sample 23346
        9999.996  < sample 31128
        10999.995 < sample 38910
        11999.994 < sample 46692
        12999.993 < sample 54474
        13999.992 < sample 62256
        14999.991 < sample 4502
        """,
    ),
    Transcript(
        "stop ends the stream; the counter is 0 and the offset lost when it starts again",
        f"""
        5033   < <10>
        6000   > :3C30320000400D03003E
        6000   < zeros 0
        6000   < {OK}
        6200   < sample 1556
        6400   < sample 3112
        6600   < sample 4669
        6800   < sample 6225
        7000   < sample 7782
        7100   > <04>
        7100   < {OK}
        7200   < zeros 9338
        7400   < zeros 10894
        7600   < zeros 12451
        7800   < zeros 14007
        8000   < zeros 15564
        8150   > <03>
        8150   < {OK}
        9500   > :3C30320000400D03003E
        9500   < zeros 0
        9500   < {OK}
        9700   < sample 1556
        """,
    ),
    Transcript(
        "zero while stopped takes the first filtered sample after start",
        f"""
        5033   < <10>
        6000   > <04>
        6000   < {OK}
        7500   > {START_10_MS}
        7500   < zeros 0
        7500   < {OK}
        7510   < zeros 77
        """,
    ),
    Transcript(
        "reset stops the stream, re-reads the calibration, acknowledges, sends no boot-up, and is deaf then",
        f"""
        5033   < <10>
        6000   > :3C30320000F04902003E
        6000   < zeros 0
        6000   < {OK}
        6150   < sample 1167
        6300   < sample 2334
        6450   < sample 3501
        6600   < sample 4669
        6750   < sample 5836
        6900   < sample 7003
        7050   > <08>
        7050   < sample 8171
        7083   < {OK}
        8080   > <06>
        8083   > <06>
        8083   < {OK}
        """,
    ),
    Transcript(
        "unknown ops get no answer and make it deaf all the same",
        f"""
        5033   < <10>
        6000   > <11>
        6100   > <06>
        7000   > <99>
        8000   > <01:003E
        9000   > <06>
        9000   < {OK}
        """,
    ),
    Transcript(
        "as fast as the line can when no period is given: a frame of 18 bytes takes 1.5625 ms",
        f"""
        5033   < <10>
        6000   > <02>
        6000   < zeros 0
        6000   < {OK}
        6001.562 < sample 12
        6003.125 < sample 24
        """,
    ),
    Transcript(
        "it looks for delimiters: a byte 3E in a payload ends the command, a byte 3C is overlooked",
        f"""
        5033   < <10>
        6000   > :3C30323E0010270000 3E
        6000   < zeros 0
        6000   < {OK}
        6001.562 < sample 12
        6002   > <03>
        6003.125 < sample 24
        """,
    ),
    Transcript(
        "of several commands that arrive together the first counts",
        f"""
        5033   < <10>
        6000   > <06><07><08>
        6000   < {OK}
        9000   > <06>
        9000   < {OK}
        """,
    ),
    Transcript(
        "a command that arrives in two parts is read with what is left of the one before",
        f"""
        5033   < <10>
        6000   > <06>
        6000   < {OK}
        8000   > <0
        8000   < {OK}
        9500   > 7>
        11000  > <06>
        11000  < {OK}
        """,
    ),
    Transcript(
        "a first read without an end, and an end without a beginning",
        f"""
        5033   < <10>
        6000   > <0
        7500   > <06>
        7500   < {OK}
        9000   > >
        9000   < {OK}
        """,
    ),
    Transcript(
        "where its driver keeps what arrives, one read takes it after the deaf second, and the first command counts",
        f"""
        1000   > <06>
        5010   > <07>
        5033   < <10>
        5033   < :3C30310073006C00B900380034003D003E
        5500   > <06>
        5600   > <08>
        6033   < {OK}
        6500   > <07>
        7033   < :3C30310073006C00B900380034003D003E
        """,
        profile={"kept_bytes": 256},
    ),
]

FIRMWARE: dict[str, Any] = {"period_overhead_us": (0.0, 0.0), "joins": True, "blocks": True}
"""Settings with the firmware's own delays, but with exact periods."""
START_100_MS = ":3C30320000A0860100 3E"

VARIANTS = [
    Transcript(
        "stop joins the stream's thread: the acknowledge comes 22.8 ms later, after the rest of 100 ms",
        f"""
        5033   < <10>
        6000   > {START_100_MS}
        6000   < zeros 0
        6000   < {OK}
        6100   < sample 778
        6200   < sample 1556
        6300   < sample 2334
        6400   < sample 3112
        6500   < sample 3891
        6600   < sample 4669
        6700   < sample 5447
        6800   < sample 6225
        6900   < sample 7003
        7000   < sample 7782
        7077.2 > <03>
        7100   < {OK}
        8090   > <06>
        8100   > <06>
        8100   < {OK}
        """,
    ),
    Transcript(
        "stop joins the stream's thread: the acknowledge comes 751 ms later, after the rest of 1 s",
        f"""
        5033   < <10>
        6000   > :3C3032000040420F00 3E
        6000   < zeros 0
        6000   < {OK}
        7000   < sample 7782
        7249   > <03>
        8000   < {OK}
        """,
    ),
    Transcript(
        "reset joins it too, then reads the calibration",
        f"""
        5033   < <10>
        6000   > :3C3032000040420F00 3E
        6000   < zeros 0
        6000   < {OK}
        7000   < sample 7782
        7249   > <08>
        8033   < {OK}
        9032   > <06>
        9034   > <06>
        9034   < {OK}
        """,
    ),
    Transcript(
        "reset with no sensor: no acknowledge, deaf until a sensor sends",
        f"""
        6000   > <06>
        6000   < {NOT_READY}
        7500   > <08>
        9000   > <06>
        60000  > <03>
        90000  ! plug_in
        90033  < {OK}
        91100  > <06>
        91100  < {OK}
        """,
        connected=False,
    ),
    Transcript(
        "unplugged in mid-stream: frames continue with frozen counter and values, stop hangs, deaf for good",
        f"""
        5033   < <10>
        6000   > :3C3032000040420F00 3E
        6000   < zeros 0
        6000   < {OK}
        7000   < sample 7782
        7500   ! unplug
        8000   < sample 11673
        9000   < sample 11673
        9100   > <06>
        9100   < {OK}
        10000  < sample 11673
        10200  > <03>
        12000  > <06>
        99000  > <08>
        """,
    ),
    Transcript(
        "a stop that hangs continues when the sensor sends again",
        f"""
        5033   < <10>
        6000   > :3C3032000040420F00 3E
        6000   < zeros 0
        6000   < {OK}
        6500   ! unplug
        7000   < sample 3891
        7100   > <03>
        60000  ! plug_in
        60000  < {OK}
        """,
    ),
]


def decode_line(text: str) -> bytes:
    """Return the bytes that a line denotes."""
    match text.split():
        case ("sample" | "zeros" as word, number):
            counts = COUNTS if word == "sample" else (0,) * 6
            return b"<09" + struct.pack("<6hH", *counts, int(number)) + b">"
    plain, _, hexadecimal = text.partition(":")
    return plain.encode() + bytes.fromhex(hexadecimal)


def constant(times: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.tile(COUNTS * UNITS, (len(times), 1))


def powered(
    at: float = T0, wrench_at: Wrench = constant, connected: bool = True, **profile: Any
) -> UartGateway:
    sensor = Jr3Sensor(replace(SENSOR, connected=connected), KnownWrench(wrench_at), seed=3)
    return UartGateway(UartGatewayProfile(**{**KIND, **profile}), sensor, powered_at=at)


@pytest.mark.parametrize("transcript", TRANSCRIPTS, ids=lambda transcript: transcript.sentence[:60])
def test_transcript_matches(transcript: Transcript) -> None:
    _check(transcript, powered(connected=transcript.connected, **transcript.profile))


@pytest.mark.parametrize("transcript", VARIANTS, ids=lambda transcript: transcript.sentence[:60])
def test_transcript_of_firmware_matches(transcript: Transcript) -> None:
    _check(transcript, powered(connected=transcript.connected, **FIRMWARE))


def _check(transcript: Transcript, gateway: UartGateway) -> None:
    expected: list[tuple[float, bytes]] = []
    reported: list[tuple[float, bytes]] = []

    def take(now: float) -> None:
        if data := gateway.data_to_send(now):
            reported.append((round((now - T0) * 1e3, 3), data))

    def run(until: float) -> None:
        while (due := gateway.next_deadline()) is not None and due <= until + 1e-9:
            gateway.handle_deadline(due)
            take(due)

    for line in transcript.lines.strip().splitlines():
        milliseconds, direction, text = line.split(maxsplit=2)
        at = float(milliseconds)
        if direction == ">":
            run(T0 + at * 1e-3)
            gateway.receive(decode_line(text), T0 + at * 1e-3)
            take(T0 + at * 1e-3)
        elif direction == "!":
            run(T0 + at * 1e-3)
            getattr(gateway, text)(T0 + at * 1e-3)
        else:
            expected.append((at, decode_line(text)))
    run(T0 + expected[-1][0] * 1e-3)

    def joined(lines: list[tuple[float, bytes]]) -> dict[float, bytes]:
        return {
            at: b"".join(data for _, data in group) for at, group in itertools.groupby(lines, lambda x: x[0])
        }

    assert joined(reported) == joined(expected)


def test_late_deadline_sends_same_bytes_as_prompt_ones() -> None:
    prompt, late = powered(kept_bytes=256), powered(kept_bytes=256)
    start = decode_line(START_10_MS)
    for gateway in (prompt, late):
        gateway.handle_deadline(T0 + 6)
        gateway.receive(start, T0 + 6)
        gateway.receive(b"<03>", T0 + 6.5)
    sent = b""
    while (due := prompt.next_deadline()) is not None:
        prompt.handle_deadline(due)
        sent += prompt.data_to_send(due)
    late.handle_deadline(T0 + 20)
    assert late.data_to_send(T0 + 20) == sent
    # The stream of 10 ms ran for the deaf second; then the stop that had waited was read.
    assert (sent.count(b"<09"), sent[-5:]) == (101, decode_line(OK))
