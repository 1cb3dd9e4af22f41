"""Behaviour specific to the UART gateway client: its pace, its bytes, and the reasons for its silence."""

from typing import Any

import pytest

from protocol.devices.jr3.counts import facts_of
from protocol.devices.jr3.firmware import HANGS, first_order_delay
from protocol.devices.jr3.uart_gateway import Phase, encode_data
from protocol.endpoint import LocalProtocolError
from protocol.wrench import SensorFailed, SensorNotice, SensorReady, SensorStopped, WrenchFrame, Zeroed

T0 = 1000.25
READY = SensorReady(facts_of((115.0, 111.0, 185.0, 5.6, 5.2, 6.1), 0.01, first_order_delay(10.0)))
STATE, SCALES, STOP, ZERO = b"<06>", b"<07>", b"<03>", b"<04>"
START = b"<02" + bytes.fromhex("E80310270000") + b">"
OK, NOT_READY = b"<01\x00>", b"<01\x01>"
OK_SCALES = b"<01\x00" + bytes.fromhex("73006F00B900380034003D00") + b">"
STEP, TIMEOUT = 1.125, 1.25
"""Slightly more than the pause, and the acknowledge time-out, s."""


def exchange(client: Any, now: float, answer: bytes, *, expect: bytes) -> None:
    assert client.data_to_send(now) == expect
    client.receive(answer, now)


def test_session_with_a_pause_after_every_acknowledge(uart: Any) -> None:
    client = uart.begin()
    exchange(client, T0, OK, expect=STATE)
    assert client.data_to_send(T0 + 1.0) == b""
    assert client.next_deadline() == pytest.approx(T0 + 1.1)
    client.handle_deadline(T0 + STEP)
    exchange(client, T0 + STEP, OK_SCALES, expect=SCALES)
    exchange(client, T0 + 2 * STEP, uart.sample(0) + OK, expect=START)
    client.handle_deadline(T0 + 3)
    assert uart.events(client) == [READY]
    assert client.phase is Phase.READY
    client.zero()
    # Ready, but still deaf from the start.
    assert client.data_to_send(T0 + 3) == b""
    exchange(client, T0 + 3 * STEP, OK, expect=ZERO)
    client.receive(uart.sample(0) + uart.sample(78), T0 + 4 * STEP)
    assert isinstance(uart.events(client)[0], Zeroed)


def test_sample_is_reported_complete_with_its_time(uart: Any) -> None:
    client = uart.ready()
    client.receive(encode_data((1, -2, 3, -4, 5, 0x3E3E), 77), T0 + 10)
    assert uart.events(client) == [WrenchFrame((1, -2, 3, -4, 5, 0x3E3E), 77, 77, T0 + 10)]


def test_client_reports_saturated_axes(uart: Any) -> None:
    client = uart.ready()
    client.receive(encode_data((0, 0, 0, 0, -32768, 0), 77), T0 + 10)
    notice, frame = uart.events(client)
    assert notice == SensorNotice("my is at 100% of the sensor's range")
    assert frame.saturated == 0b010000


@pytest.mark.parametrize(
    ("data", "fact", "remedy"),
    [
        (b"", "silent for 3 s", f"power, cable, port? {HANGS}"),
        (b"\xf8\x00\x80", "bytes but no frame of a gateway for 3 s", "not 115200 baud, or another device?"),
        (encode_data([7] * 6, 1), "sends but acknowledges nothing for 3 s", "is the line to it open?"),
    ],
)
def test_reason_for_not_ready_is_reported(uart: Any, data: bytes, fact: str, remedy: str) -> None:
    client = uart.begin(ready_timeout_s=3.0)
    client.receive(data, T0)
    client.handle_deadline(T0 + 3)
    assert uart.events(client) == [SensorFailed(f"UART gateway: {fact}", remedy)]


def test_cut_off_before_the_start_goes_out_with_it_alone(uart: Any) -> None:
    client = uart.begin()
    exchange(client, T0, OK, expect=STATE)
    client.set_filter(2.0)
    exchange(client, T0 + STEP, OK_SCALES, expect=SCALES)
    exchange(client, T0 + 2 * STEP, OK, expect=START.replace(b"\xe8\x03", b"\xc8\x00"))
    assert client.data_to_send(T0 + 3 * STEP) == b""


@pytest.mark.parametrize("cutoff_hz", [0.62, 160.0])
def test_cut_off_resembling_a_delimiter_is_refused(uart: Any, cutoff_hz: float) -> None:
    with pytest.raises(LocalProtocolError, match="cutoff_hz must not be"):
        uart.begin().set_filter(cutoff_hz)


def test_not_ready_is_repeated_after_the_pause(uart: Any) -> None:
    client = uart.begin()
    exchange(client, T0, NOT_READY, expect=STATE)
    assert client.data_to_send(T0 + 1) == b""
    exchange(client, T0 + STEP, OK, expect=STATE)
    exchange(client, T0 + 2 * STEP, b"<01\x01" + bytes(12) + b">", expect=SCALES)
    uart.establish(client, T0 + 3 * STEP)
    assert uart.events(client) == [READY]


def test_unexpected_acknowledge_also_starts_a_pause(uart: Any) -> None:
    """Both answers to a repeated command arrive: the second starts another second without reception."""
    client = uart.begin()
    client.data_to_send(T0)
    client.handle_deadline(T0 + TIMEOUT)
    exchange(client, T0 + TIMEOUT, OK, expect=STATE)
    client.receive(OK, T0 + TIMEOUT + 1.0)
    assert client.data_to_send(T0 + TIMEOUT + STEP) == b""
    assert client.data_to_send(T0 + TIMEOUT + 1.0 + STEP) == SCALES


def test_short_answer_to_the_full_scales_is_no_answer(uart: Any) -> None:
    """The gateway acknowledged another command; the scales are requested again."""
    client = uart.begin()
    exchange(client, T0, OK, expect=STATE)
    exchange(client, T0 + STEP, OK, expect=SCALES)
    client.handle_deadline(T0 + STEP + TIMEOUT)
    exchange(client, T0 + STEP + TIMEOUT, OK_SCALES, expect=SCALES)
    assert client.statistics.malformed == 1
    assert client.data_to_send(T0 + 2 * STEP + TIMEOUT) == START


def test_stop_while_the_full_scales_are_requested(uart: Any) -> None:
    client = uart.begin()
    exchange(client, T0, OK, expect=STATE)
    assert client.data_to_send(T0 + STEP) == SCALES
    client.stop()
    assert client.data_to_send(T0 + STEP) == STOP
    client.receive(OK_SCALES.replace(b"\x73", b">") + OK, T0 + STEP)
    assert client.statistics.malformed == 0
    assert uart.events(client) == [SensorStopped()]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (
            {"cutoff_hz": 160.0},
            "cutoff_hz must not be 160: on the line a byte of it looks like < or > to the gateway; "
            "take 158.71 or 161.28",
        ),
        (
            {"period_ms": 1.5},
            "period_ms must be at least 1.5625, what a frame takes at 115200 baud, got 1.5",
        ),
        (
            {"period_ms": 16.0},
            "period_ms must not be 16: on the line a byte of it looks like < or > to the gateway; "
            "take 15.871 or 16.128",
        ),
        ({"pause_s": -1.0}, "pause_s must be at least 0"),
    ],
)
def test_profile_refuses(uart: Any, wrong: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match="must") as caught:
        uart.profile(**wrong)
    assert str(caught.value).startswith(message)
