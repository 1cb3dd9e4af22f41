"""The client of the UART gateway against scripted bytes: session, pace, repetitions, counters, failures."""

from collections.abc import Iterable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.endpoint import LocalProtocolError
from protocol.jr3 import (
    SensorEvent,
    SensorFailed,
    SensorFrame,
    SensorNotice,
    SensorReady,
    SensorRestarted,
    SensorStopped,
    UartGatewayClient,
    UartGatewayClientProfile,
    Zeroed,
)
from protocol.jr3.uart_gateway import Phase, encode_data

T0 = 1000.25
READY = SensorReady((115.0, 108.0, 185.0, 5.6, 5.2, 6.1))
STATE, SCALES, STOP, ZERO = b"<06>", b"<07>", b"<03>", b"<04>"
START = b"<02" + bytes.fromhex("E80310270000") + b">"
OK, NOT_READY = b"<01\x00>", b"<01\x01>"
OK_SCALES = b"<01\x00" + bytes.fromhex("73006C00B900380034003D00") + b">"
BOOT_UP = b"<10>"
STEP, TIMEOUT = 1.125, 1.25
"""A little more than the pause, and the acknowledge time-out, s."""


def events(client: UartGatewayClient) -> list[SensorEvent]:
    told = []
    while (event := client.next_event()) is not None:
        told.append(event)
    return told


def exchange(client: UartGatewayClient, now: float, answer: bytes, *, expect: bytes) -> None:
    assert client.data_to_send(now) == expect
    client.receive(answer, now)


def establish(client: UartGatewayClient, now: float, start: bytes = START) -> None:
    exchange(client, now, OK, expect=STATE)
    exchange(client, now + STEP, OK_SCALES, expect=SCALES)
    exchange(client, now + 2 * STEP, OK, expect=start)
    assert client.next_deadline() == pytest.approx(now + 2 * STEP + 0.1)
    client.handle_deadline(now + 2 * STEP + 0.125)


def ready(**changes: object) -> UartGatewayClient:
    client = UartGatewayClient(UartGatewayClientProfile(**changes), T0)  # type: ignore[arg-type]
    establish(client, T0)
    assert events(client) == [READY]
    return client


def sample(counter: int, value: int = 7) -> bytes:
    return encode_data([value] * 6, counter % 65536)


def feed(client: UartGatewayClient, counters: Iterable[int], now: float = T0 + 10) -> list[SensorFrame]:
    for counter in counters:
        client.receive(sample(counter), now)
    told = events(client)
    return [event for event in told if isinstance(event, SensorFrame)]


def test_session_with_a_pause_after_every_acknowledge() -> None:
    client = UartGatewayClient(UartGatewayClientProfile(), T0)
    exchange(client, T0, OK, expect=STATE)
    assert client.data_to_send(T0 + 1.0) == b""
    assert client.next_deadline() == pytest.approx(T0 + 1.1)
    client.handle_deadline(T0 + STEP)
    exchange(client, T0 + STEP, OK_SCALES, expect=SCALES)
    exchange(client, T0 + 2 * STEP, sample(0) + OK, expect=START)
    client.handle_deadline(T0 + 3)
    assert events(client) == [READY]
    assert client.phase is Phase.READY
    client.zero()
    client.zero()
    # Ready, but still deaf from the start.
    assert client.data_to_send(T0 + 3) == b""
    exchange(client, T0 + 3 * STEP, OK, expect=ZERO)
    assert events(client) == [Zeroed()]
    assert client.data_to_send(T0 + 9) == b""
    client.stop()
    client.stop()
    exchange(client, T0 + 9, OK, expect=STOP)
    assert events(client) == [SensorStopped()]
    assert client.next_deadline() is None
    assert client.data_to_send(T0 + 20) == b""


def test_known_full_scales_are_not_asked_for_and_no_filter_is_said() -> None:
    scales = (50.0, 50.0, 100.0, 4.0, 4.0, 4.0)
    client = UartGatewayClient(UartGatewayClientProfile(cutoff_hz=0.0, full_scales=scales), T0)
    client.zero()
    exchange(client, T0, OK, expect=STATE)
    exchange(client, T0 + STEP, OK, expect=b"<02" + bytes.fromhex("000010270000") + b">")
    client.handle_deadline(T0 + 2)
    ready, notice = events(client)
    assert ready == SensorReady(scales)
    assert isinstance(notice, SensorNotice)
    assert "cut-off 0" in notice.text
    assert client.delay == 0.0
    exchange(client, T0 + 2 * STEP, OK, expect=ZERO)
    assert events(client) == [Zeroed()]


def test_a_sample_is_told_whole_with_its_time() -> None:
    client = ready()
    client.receive(encode_data((1, -2, 3, -4, 5, 0x3E3E), 77), T0 + 10)
    assert events(client) == [SensorFrame((1, -2, 3, -4, 5, 0x3E3E), 77, 77, T0 + 10)]
    assert client.delay == pytest.approx(0.0159, abs=1e-4)


def test_set_filter_now_and_at_the_next_start() -> None:
    client = ready()
    client.set_filter(2.0)
    exchange(client, T0 + 10, OK, expect=b"<05\xc8\x00>")
    assert events(client) == []
    client.receive(BOOT_UP, T0 + 20)
    start = b"<02" + bytes.fromhex("C80010270000") + b">"
    establish(client, T0 + 20, start)
    client = UartGatewayClient(UartGatewayClientProfile(), T0)
    client.set_filter(2.0)
    establish(client, T0, start)
    for wrong in (0.62, 160.0, 700.0, 0.001):
        with pytest.raises(LocalProtocolError, match="cutoff_hz must"):
            client.set_filter(wrong)


# --- silence, repetitions, late answers


def fail(client: UartGatewayClient) -> str:
    """Let it ask until it gives up."""
    asked = 0
    while client.phase is not Phase.FAILED:
        now = client.next_deadline()
        assert now is not None
        client.handle_deadline(now)
        asked += bool(client.data_to_send(now))
        assert asked < 50
    (failed,) = events(client)
    assert isinstance(failed, SensorFailed)
    return failed.text


def test_silence_is_asked_again_at_its_time_and_fails_as_silence() -> None:
    client = UartGatewayClient(UartGatewayClientProfile(ready_timeout_s=3.0), T0)
    asked, now = [], T0
    while client.phase is Phase.ASKING:
        asked += [now] if client.data_to_send(now) else []
        now = client.next_deadline() or 0.0
        client.handle_deadline(now)
    assert asked == [T0 + k * TIMEOUT for k in range(3)]
    (failed,) = events(client)
    assert failed == SensorFailed("UART gateway: silent for 3 s: power, cable, port?")
    assert client.next_deadline() is None
    with pytest.raises(LocalProtocolError, match="failed"):
        client.zero()


@pytest.mark.parametrize(
    ("heard", "text"),
    [
        (b"\xf8\x00\x80", "bytes but no frame of a gateway in 3 s: not 115200 baud, or another device?"),
        (sample(1), "sends but acknowledges nothing in 3 s: is the line to it open?"),
        (NOT_READY, "acknowledges but not ready after 3 s: sensor unplugged?"),
    ],
)
def test_why_it_is_not_ready_is_told(heard: bytes, text: str) -> None:
    client = UartGatewayClient(UartGatewayClientProfile(ready_timeout_s=3.0), T0)
    client.data_to_send(T0)
    client.receive(heard, T0)
    assert fail(client) == f"UART gateway: {text}"


def test_not_ready_is_asked_again_after_the_pause() -> None:
    client = UartGatewayClient(UartGatewayClientProfile(), T0)
    exchange(client, T0, NOT_READY, expect=STATE)
    assert client.data_to_send(T0 + 1) == b""
    exchange(client, T0 + STEP, OK, expect=STATE)
    exchange(client, T0 + 2 * STEP, b"<01\x01" + bytes(12) + b">", expect=SCALES)
    establish(client, T0 + 3 * STEP)
    assert events(client) == [READY]
    client.zero()
    exchange(client, T0 + 10, NOT_READY, expect=ZERO)
    (failed,) = events(client)
    assert failed == SensorFailed("UART gateway: acknowledges but not ready any more: sensor unplugged?")


def test_a_command_without_acknowledge_fails_after_its_retries() -> None:
    client = UartGatewayClient(UartGatewayClientProfile(retries=2), T0)
    exchange(client, T0, OK, expect=STATE)
    for attempt in range(3):
        assert client.data_to_send(T0 + STEP + attempt * TIMEOUT) == SCALES
        client.handle_deadline(T0 + STEP + (attempt + 1) * TIMEOUT)
    (failed,) = events(client)
    assert failed == SensorFailed("UART gateway: no acknowledge of get full scales after 3 tries")


def test_an_acknowledge_that_nobody_waits_for_makes_the_gateway_deaf_too() -> None:
    """Both answers to a repeated command come: the second begins another deaf second."""
    client = UartGatewayClient(UartGatewayClientProfile(), T0)
    client.data_to_send(T0)
    client.handle_deadline(T0 + TIMEOUT)
    exchange(client, T0 + TIMEOUT, OK, expect=STATE)
    client.receive(OK, T0 + TIMEOUT + 1.0)
    assert client.data_to_send(T0 + TIMEOUT + STEP) == b""
    assert client.data_to_send(T0 + TIMEOUT + 1.0 + STEP) == SCALES


def test_a_short_answer_to_the_full_scales_is_no_answer() -> None:
    """The gateway understood another command: that one was acknowledged, the scales are asked for again."""
    client = UartGatewayClient(UartGatewayClientProfile(), T0)
    exchange(client, T0, OK, expect=STATE)
    exchange(client, T0 + STEP, OK, expect=SCALES)
    client.handle_deadline(T0 + STEP + TIMEOUT)
    exchange(client, T0 + STEP + TIMEOUT, OK_SCALES, expect=SCALES)
    assert client.statistics.malformed == 1
    assert client.data_to_send(T0 + 2 * STEP + TIMEOUT) == START


@pytest.mark.parametrize(("place", "axis"), list(enumerate(["fx", "fy", "fz", "mx", "my", "mz"])))
def test_full_scale_0_is_named(place: int, axis: str) -> None:
    words = [1] * 6
    words[place] = 0
    client = UartGatewayClient(UartGatewayClientProfile(), T0)
    exchange(client, T0, OK, expect=STATE)
    answer = b"<01\x00" + b"".join(word.to_bytes(2, "little") for word in words) + b">"
    exchange(client, T0 + STEP, answer, expect=SCALES)
    (failed,) = events(client)
    assert failed == SensorFailed(f"UART gateway: full scale of {axis} is 0: calibration not read?")


# --- stop and restart


def test_stop_goes_out_into_the_deaf_second_and_is_repeated() -> None:
    client = ready()
    client.zero()
    assert client.data_to_send(T0 + 10) == ZERO
    client.stop()
    assert client.data_to_send(T0 + 10) == STOP
    client.receive(OK, T0 + 10.01)
    assert events(client) == []
    client.handle_deadline(T0 + 10 + TIMEOUT)
    exchange(client, T0 + 10 + TIMEOUT, BOOT_UP + NOT_READY, expect=STOP)
    assert events(client) == [SensorStopped()]
    assert client.stop_patience > TIMEOUT
    for wish in (client.zero, lambda: client.set_filter(1.0)):
        with pytest.raises(LocalProtocolError):
            wish()


def test_stop_while_the_full_scales_are_asked_for() -> None:
    client = UartGatewayClient(UartGatewayClientProfile(), T0)
    exchange(client, T0, OK, expect=STATE)
    assert client.data_to_send(T0 + STEP) == SCALES
    client.stop()
    assert client.data_to_send(T0 + STEP) == STOP
    client.receive(OK_SCALES.replace(b"\x73", b">") + OK, T0 + STEP)
    assert client.statistics.malformed == 0
    assert events(client) == [SensorStopped()]


def test_stop_after_a_failure_still_goes_out() -> None:
    client = UartGatewayClient(UartGatewayClientProfile(), T0)
    fail(client)
    client.stop()
    exchange(client, T0 + 50, OK, expect=STOP)
    assert events(client) == [SensorStopped()]


def test_boot_up_starts_over_at_once_and_the_sequence_goes_on() -> None:
    client = ready()
    before = feed(client, [100, 178])
    client.receive(BOOT_UP, T0 + 20)
    assert events(client) == [SensorRestarted()]
    establish(client, T0 + 20)
    assert events(client) == [READY]
    after = feed(client, [5, 83], T0 + 30)
    assert [event.sequence for event in (*before, *after)] == [100, 178, 179, 257]
    assert client.statistics.lost == 0


def test_boot_up_while_asking_is_no_restart() -> None:
    client = UartGatewayClient(UartGatewayClientProfile(), T0)
    client.data_to_send(T0)
    client.receive(BOOT_UP, T0 + 0.1)
    establish(client, T0 + 0.1)
    assert events(client) == [READY]


# --- samples


def test_the_counter_goes_on_over_its_wrap() -> None:
    """At 10 ms the counter steps by 77.8 samples of 128.5 µs and wraps every 8.4 s."""
    client = ready()
    counters = [int(k * 10_000 / 128.5) for k in range(1, 2000)]
    told = feed(client, counters)
    assert [event.sequence for event in told] == counters
    assert [event.counter for event in told] == [counter % 65536 for counter in counters]
    assert client.statistics.lost == 0


@settings(max_examples=40)
@given(st.sets(st.integers(1, 299), max_size=60))
def test_lost_and_repeated_frames_are_counted(missing: set[int]) -> None:
    client = ready()
    kept = [k for k in range(301) if k not in missing]
    counters = [60_000 + int(k * 10_000 / 128.5) for k in kept]
    told = feed(client, [*counters, counters[-1]])
    assert len(told) == len(kept)
    assert client.statistics.lost == len(missing)
    assert client.statistics.repeated == 1


@settings(max_examples=60)
@given(st.data())
def test_any_split_of_the_bytes_tells_the_same(data: st.DataObject) -> None:
    stream = b"noise" + b"".join(sample(65000 + 78 * k, 0x3E3C - k) for k in range(12) if k != 5)
    whole, parts = ready(), ready()
    whole.receive(stream, T0 + 10)
    rest = stream
    while rest:
        size = data.draw(st.integers(1, len(rest)))
        parts.receive(rest[:size], T0 + 10)
        rest = rest[size:]
    assert events(parts) == events(whole)
    assert parts.statistics == whole.statistics
    assert parts.statistics.malformed == 1


@settings(max_examples=100)
@given(st.lists(st.binary(max_size=30), max_size=5))
def test_garbage_then_a_boot_up_recovers(garbage: list[bytes]) -> None:
    client = UartGatewayClient(UartGatewayClientProfile(), T0)
    client.data_to_send(T0)
    for noise in garbage:
        client.receive(noise, T0)
    client.receive(bytes(20) + BOOT_UP, T0 + 1)
    establish(client, T0 + 1)
    assert events(client)[-1] == READY


# --- profile


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"cutoff_hz": 655.36}, "cutoff_hz must be at most 655.35"),
        ({"cutoff_hz": 0.004}, "cutoff_hz must be 0.01 … 655.35, or 0 for unfiltered, got 0.004"),
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
        ({"period_ms": 4001.0}, "period_ms must be at most 4000"),
        ({"full_scales": (1.0, 2.0)}, "full_scales must be six values or none, got 2"),
        ({"pause_s": -1.0}, "pause_s must be at least 0"),
    ],
)
def test_profile_refuses(wrong: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match="must") as caught:
        UartGatewayClientProfile(**wrong)  # type: ignore[arg-type]
    assert str(caught.value).startswith(message)


def test_the_profile_knows_its_delay() -> None:
    assert UartGatewayClientProfile(cutoff_hz=10.0).delay == pytest.approx(0.0159, abs=1e-4)
