"""Tests of the emulated CAN gateway, line by line of the firmware's behaviour."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from emulators.devices.jr3 import Gateway, GatewayProfile, Jr3Sensor, SensorProfile
from emulators.sensing import KnownWrench
from protocol.devices.jr3 import (
    decode_triple,
    parse_frame,
)
from protocol.devices.jr3.can_gateway.messages import FORCES, MOMENTS

T0 = 1234.567
AWAKE = T0 + 2.5
TS = 128.5e-6
COUNTS = np.array([1000, -2000, 3000, 400, -500, 600])
UNITS = np.array([115, 111, 185, 5.6, 5.2, 6.1]) / 16384
START_UNFILTERED = "201#000010270000"

Wrench = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def constant(times: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.tile(COUNTS * UNITS, (len(times), 1))


def ramp(times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return 100 000 counts per second on fx from T0 on, so that a value shows its time."""
    wrench = np.zeros((len(times), 6))
    wrench[:, 0] = ((times - AWAKE) * 100_000) % 20_000 * UNITS[0]
    return wrench


KIND = GatewayProfile(
    loop_ms=0.0, period_overhead_us=(0.0, 0.0), joins=False, blocks=False, buffer_loses="newest"
)
"""Settings of a gateway without any delay; `test_jr3_can_transcripts` covers the firmware's own delays."""


def build(wrench_at: Wrench = constant, *, noise: float = 0.0, connected: bool = True) -> Gateway:
    sensor = Jr3Sensor(SensorProfile(noise_counts=noise, connected=connected), KnownWrench(wrench_at), seed=3)
    return Gateway(KIND, sensor, powered_at=T0)


def run(gateway: Gateway, until: float) -> list[tuple[float, str]]:
    """Return everything the gateway sends by itself, with the deadline at which it does."""
    reported = []
    while (due := gateway.next_deadline()) is not None and due <= until:
        gateway.handle_deadline(due)
        reported += [(due, str(frame)) for frame in gateway.data_to_send(due)]
    return reported


def awake(wrench_at: Wrench = constant, *, noise: float = 0.0, connected: bool = True) -> Gateway:
    gateway = build(wrench_at, noise=noise, connected=connected)
    run(gateway, AWAKE)
    return gateway


def ask(gateway: Gateway, text: str, now: float) -> list[str]:
    gateway.receive([parse_frame(text)], now)
    return [str(frame) for frame in gateway.data_to_send(now)]


def value(texts: list[str]) -> tuple[tuple[int, ...], int]:
    """Return counts and counter of a force frame followed by its moment frame."""
    forces, moments = (parse_frame(text) for text in texts)
    assert (forces.identifier, moments.identifier) == (0x601, 0x681)
    one, two = decode_triple(forces.data, FORCES), decode_triple(moments.data, MOMENTS)
    assert one.counter == two.counter
    return (*one.counts, *two.counts), one.counter


# --- power-up


def test_boot_up_follows_calibration_after_2_s() -> None:
    gateway = build()
    gateway.receive([parse_frame("401#")], T0 + 1.99)
    assert run(gateway, T0 + 10) == [(T0 + 2.033, "701#")]
    assert gateway.next_deadline() is None


def test_commands_during_calibration_are_queued() -> None:
    gateway = build()
    gateway.receive([parse_frame("401#")] * 40, T0 + 2.01)
    reported = [text for _, text in run(gateway, T0 + 3)]
    assert reported == ["701#"] + ["101#00"] * 32


def test_gateway_without_sensor_only_acknowledges() -> None:
    gateway = build(connected=False)
    assert run(gateway, T0 + 10) == []
    for text in ("401#", "181#C800", START_UNFILTERED, "281#", "301#", "381#0100", "581#"):
        assert ask(gateway, text, T0 + 11) == ["101#01"]
    for text in ("481#", "501#"):
        assert ask(gateway, text, T0 + 11) == ["101#01000000000000"]
    assert ask(gateway, "080#", T0 + 12) == []
    assert gateway.next_deadline() is None


# --- queries and strangers


def test_queries_are_answered() -> None:
    gateway = awake()
    assert ask(gateway, "401#", AWAKE) == ["101#00"]
    assert ask(gateway, "481#", AWAKE) == ["101#0073006F00B900"]
    assert ask(gateway, "501#", AWAKE) == ["101#00380034003D00"]


@pytest.mark.parametrize(
    "text", ["402#", "001#", "101#00", "601#", "701#", "781#00000000", "081#", "401#R", "00000401#"]
)
def test_unknown_frames_get_no_answer(text: str) -> None:
    assert ask(awake(), text, AWAKE) == []


# --- streams


def test_asynchronous_stream_at_nominal_absolute_times() -> None:
    gateway = awake()
    # Frame 0 goes out before the first sample is taken, and before the acknowledge.
    *first, acknowledge = ask(gateway, START_UNFILTERED, AWAKE)
    assert (value(first), acknowledge) == (((0,) * 6, 0), "101#00")
    reported = run(gateway, AWAKE + 20.001)
    assert [at for at, _ in reported[::2]] == [AWAKE + k * 0.01 for k in range(1, 2001)]
    frames = [text for _, text in reported]
    for k in (1, 1000, 2000):
        counts, counter = value(frames[2 * k - 2 : 2 * k])
        assert counts == tuple(COUNTS)
        # Sensor samples, not frames: it wraps every 8.4 s.
        assert counter in {math.floor(k * 0.01 / TS) % 65536, math.floor(k * 0.01 / TS - 1e-6) % 65536}


def test_late_call_emits_every_frame_with_its_sample() -> None:
    prompt, late = awake(ramp), awake(ramp)
    ask(prompt, START_UNFILTERED, AWAKE)
    ask(late, START_UNFILTERED, AWAKE)
    late.handle_deadline(AWAKE + 0.1)
    assert [str(frame) for frame in late.data_to_send(AWAKE + 0.1)] == [
        t for _, t in run(prompt, AWAKE + 0.1)
    ]


def test_sample_is_newest_of_8_khz_grid() -> None:
    gateway = awake(ramp)
    ask(gateway, START_UNFILTERED, AWAKE)
    for at, text in run(gateway, AWAKE + 0.15)[::2]:
        counts = decode_triple(parse_frame(text).data, FORCES).counts
        age = (at - AWAKE) - counts[0] / 100_000
        assert -1e-5 < age < 125e-6 + TS + 1e-5


def test_short_payloads_select_unfiltered_full_speed() -> None:
    gateway = awake()
    ask(gateway, "201#", AWAKE)
    reported = run(gateway, AWAKE + 0.01)
    assert len(reported) == 2 * math.floor(0.01 / 260e-6)
    assert value([text for _, text in reported[-2:]])[0] == tuple(COUNTS)


def test_sync_sends_force_then_moment_in_both_modes() -> None:
    gateway = awake()
    assert ask(gateway, "080#", AWAKE) == []
    assert ask(gateway, "181#0000", AWAKE) == ["101#00"]
    assert value(ask(gateway, "080#", AWAKE)) == ((0,) * 6, 0)
    assert value(ask(gateway, "080#", AWAKE + 0.0051)) == (tuple(COUNTS), math.floor(0.0051 / TS))
    assert ask(gateway, START_UNFILTERED, AWAKE + 0.006)[-1] == "101#00"
    # The first asynchronous start since power-up begins to count again.
    assert value(ask(gateway, "080#", AWAKE + 0.0071)) == (tuple(COUNTS), math.floor(0.0011 / TS))


def test_start_sync_ends_asynchronous_stream() -> None:
    gateway = awake()
    ask(gateway, START_UNFILTERED, AWAKE)
    run(gateway, AWAKE + 0.1)
    assert ask(gateway, "181#0000", AWAKE + 0.105) == ["101#00"]
    assert run(gateway, AWAKE + 5) == []
    assert value(ask(gateway, "080#", AWAKE + 5.0001))[1] == math.floor(5.0001 / TS)


def test_new_period_counts_from_awaited_frame() -> None:
    gateway = awake()
    ask(gateway, START_UNFILTERED, AWAKE)
    assert ask(gateway, "201#0000204E0000", AWAKE + 0.005) == ["101#00"]
    assert [at for at, _ in run(gateway, AWAKE + 0.055)[::2]] == pytest.approx(
        [AWAKE + x for x in (0.01, 0.03, 0.05)]
    )


def test_stop_ends_stream_and_resets_counter() -> None:
    gateway = awake()
    ask(gateway, START_UNFILTERED, AWAKE)
    run(gateway, AWAKE + 0.1)
    assert ask(gateway, "281#", AWAKE + 0.105) == ["101#00"]
    assert run(gateway, AWAKE + 9) == []
    assert ask(gateway, "080#", AWAKE + 9) == []
    assert value(ask(gateway, START_UNFILTERED, AWAKE + 9)[:2]) == ((0,) * 6, 0)


def test_gateway_has_no_watchdog() -> None:
    gateway = awake()
    ask(gateway, "201#000040420F00", AWAKE)
    assert len(run(gateway, AWAKE + 60.5)) == 2 * 60


# --- filter


def test_filter_matches_loop_over_samples() -> None:
    gateway = awake(ramp, noise=2.0)
    sensor = Jr3Sensor(SensorProfile(noise_counts=2.0), KnownWrench(ramp), seed=3)
    ask(gateway, "201#C80010270000", AWAKE)
    reported = run(gateway, AWAKE + 0.3)
    assert ask(gateway, "381#E803", AWAKE + 0.305) == ["101#00"]
    reported += run(gateway, AWAKE + 0.6)
    y, alpha, loop = [0.0] * 6, TS / (TS + 1 / (2 * math.pi * 2.0)), [[0] * 6]
    for j in range(1, math.floor(0.6 / TS) + 2):
        if j * TS > 0.305:
            alpha = TS / (TS + 1 / (2 * math.pi * 10.0))
        x = sensor.counts(np.array([math.floor((AWAKE + j * TS) * 8000)]))[0]
        y = [old + alpha * (new - old) for old, new in zip(y, x, strict=True)]
        loop.append([math.floor(axis) for axis in y])
    assert len(reported) == 120
    for k in range(60):
        counts, counter = value([text for _, text in reported[2 * k : 2 * k + 2]])
        # One count: floor of sums that are added in another order.
        assert np.abs(np.array(counts) - loop[counter]).max() <= 1


def test_filter_has_cut_off_frequency() -> None:
    """Step response of a first-order low pass: 1 − e⁻¹ after 1/(2π f)."""
    gateway = awake()
    ask(gateway, "181#C800", AWAKE)
    counts, _ = value(ask(gateway, "080#", AWAKE + 1 / (2 * math.pi * 2.0)))
    assert np.array(counts) == pytest.approx(COUNTS * (1 - math.exp(-1)), rel=0.005)


def test_cut_off_0_sends_unfiltered_samples() -> None:
    gateway = awake(noise=1.0)
    sensor = Jr3Sensor(SensorProfile(), KnownWrench(constant), seed=3)
    ask(gateway, "181#0000", AWAKE)
    for k in range(1, 50):
        counts, counter = value(ask(gateway, "080#", AWAKE + k * 0.0031))
        index = math.floor((AWAKE + counter * TS) * 8000)
        assert counts == tuple(sensor.counts(np.array([index]))[0])


# --- zero and reset


def test_zero_takes_filtered_value_and_stop_clears_it() -> None:
    gateway = awake()
    ask(gateway, "181#0000", AWAKE)
    assert ask(gateway, "301#", AWAKE + 0.01) == ["101#00"]
    assert value(ask(gateway, "080#", AWAKE + 0.011))[0] == (0,) * 6
    ask(gateway, "181#0000", AWAKE + 0.02)
    assert value(ask(gateway, "080#", AWAKE + 0.025))[0] == (0,) * 6
    ask(gateway, "281#", AWAKE + 0.03)
    ask(gateway, "181#0000", AWAKE + 0.04)
    assert value(ask(gateway, "080#", AWAKE + 0.05))[0] == tuple(COUNTS)


def test_zero_is_taken_at_time_of_command() -> None:
    gateway = awake(ramp)
    ask(gateway, "181#0000", AWAKE)
    ask(gateway, "301#", AWAKE + 0.01)
    counts, _ = value(ask(gateway, "080#", AWAKE + 0.11))
    assert counts[0] == pytest.approx(10_000, abs=40)


def test_zero_while_stopped_takes_first_sample_after_start() -> None:
    gateway = awake()
    assert ask(gateway, "301#", AWAKE) == ["101#00"]
    ask(gateway, "181#C800", AWAKE)
    alpha = TS / (TS + 1 / (2 * math.pi * 2.0))
    assert value(ask(gateway, "080#", AWAKE + 1.5 * TS))[0] == (0,) * 6
    counts, _ = value(ask(gateway, "080#", AWAKE + 2))
    assert np.array(counts) == pytest.approx(COUNTS * (1 - alpha), abs=1.01)


def test_reset_rereads_calibration_without_boot_up() -> None:
    gateway = awake()
    ask(gateway, START_UNFILTERED, AWAKE)
    run(gateway, AWAKE + 0.1)
    assert ask(gateway, "581#", AWAKE + 0.105) == []
    assert ask(gateway, "401#", AWAKE + 0.11) == []
    assert ask(gateway, "080#", AWAKE + 0.11) == []
    assert [text for _, text in run(gateway, AWAKE + 5)] == ["101#00", "101#00"]
    assert value(ask(gateway, START_UNFILTERED, AWAKE + 6)[:2])[1] == 0
