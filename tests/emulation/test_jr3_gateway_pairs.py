"""Tests of the clients of both gateways with the emulated gateways, without a transport, in virtual time."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from emulators.devices.jr3 import (
    Gateway,
    GatewayProfile,
    Jr3Sensor,
    SensorProfile,
    UartGateway,
    UartGatewayProfile,
)
from emulators.sensing import KnownWrench
from protocol.can.frame import CanFrame
from protocol.devices.jr3 import (
    GatewayClient,
    GatewayClientProfile,
    UartGatewayClient,
    UartGatewayClientProfile,
)
from protocol.devices.jr3.counts import facts_of
from protocol.devices.jr3.firmware import HANGS, first_order_delay
from protocol.wrench import (
    SensorEvent,
    SensorFailed,
    SensorNotice,
    SensorReady,
    SensorRestarted,
    SensorStopped,
    WrenchFrame,
    Zeroed,
)

T0 = 1234.567
COUNTS = (1000, -2000, 3000, 400, -500, 600)
UNITS = np.array([115, 111, 185, 5.6, 5.2, 6.1]) / 16384
NOTICE = SensorNotice("the gateway's filter is off (cut-off 0): every sample is as noisy as the sensor")
SCALES = (115.0, 111.0, 185.0, 5.6, 5.2, 6.1)
READY = SensorReady(facts_of(SCALES, 0.01, 0.0))
FILTERED = SensorReady(facts_of(SCALES, 0.01, first_order_delay(10.0)))

Wrench = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def of(counts: Sequence[int]) -> Wrench:
    """Return a wrench that always has these counts."""
    return lambda times: np.tile(counts * UNITS, (len(times), 1))


CONSTANT = of(COUNTS)


@dataclass(frozen=True)
class Pair:
    """Gateway and its client."""

    name: str
    gateway: Callable[..., Any]
    gateway_profile: Callable[..., Any]
    client: Callable[..., Any]
    client_profile: Callable[..., Any]

    def powered(
        self, at: float = T0, wrench: Wrench = CONSTANT, connected: bool = True, **profile: object
    ) -> Any:
        """Return the gateway, powered up at a time."""
        sensor = Jr3Sensor(SensorProfile(noise_counts=0.0, connected=connected), KnownWrench(wrench), seed=3)
        return self.gateway(self.gateway_profile(**profile), sensor, powered_at=at)

    def bench(self, gateway: Any = None, now: float = T0, **profile: object) -> "Bench":
        """Return the client in front of a gateway, by default one that is powered up with it."""
        return Bench(gateway or self.powered(), self.client(self.client_profile(**profile), now), now)


CAN = Pair("gateway node 1", Gateway, GatewayProfile, GatewayClient, GatewayClientProfile)
UART = Pair("UART gateway", UartGateway, UartGatewayProfile, UartGatewayClient, UartGatewayClientProfile)
on_both = pytest.mark.parametrize("pair", [CAN, UART], ids=["can", "uart"])


class Bench:
    """Client and gateway on one line; `down` and `up` may drop or change data."""

    def __init__(self, gateway: Any, client: Any, now: float) -> None:
        self.gateway, self.client, self.now = gateway, client, now
        self.events: list[SensorEvent] = []
        self.sent: list[tuple[float, Any]] = []
        self.up: Callable[[Any], Any] = lambda data: data
        self.down: Callable[[Any], Any] = lambda data: data

    def _settle(self) -> None:
        while True:
            if down := self.client.data_to_send(self.now):
                self.sent.append((round(self.now - T0, 3), down))
                self.gateway.receive(self.down(down), self.now)
            if up := self.gateway.data_to_send(self.now):
                self.client.receive(self.up(up), self.now)
            if not down and not up:
                break
        while (event := self.client.next_event()) is not None:
            self.events.append(event)

    def run(self, until: float) -> list[SensorEvent]:
        """Return the messages of the client up to this time."""
        self.events = []
        self._settle()
        while True:
            dues = [
                due for due in (self.client.next_deadline(), self.gateway.next_deadline()) if due is not None
            ]
            if not dues or min(dues) > until:
                self.now = until
                return self.events
            self.now = max(self.now, min(dues))
            self.gateway.handle_deadline(self.now)
            self.client.handle_deadline(self.now)
            self._settle()


def samples(events: list[SensorEvent]) -> list[WrenchFrame]:
    return [event for event in events if isinstance(event, WrenchFrame)]


# --- both


@pytest.mark.parametrize(
    ("pair", "profile"),
    [(CAN, {}), (UART, {}), (UART, {"kept_bytes": 256})],
    ids=["can", "uart", "uart that keeps"],
)
def test_session_runs_over_counter_wrap(pair: Pair, profile: dict[str, Any]) -> None:
    bench = pair.bench(pair.powered(**profile), cutoff_hz=0.0)
    events = bench.run(T0 + 40)
    assert events[:2] == [READY, NOTICE]
    reported = samples(events)
    assert len(reported) == len(events) - 2 > 3000
    assert {event.values for event in reported} == {COUNTS}
    # 10 ms, and what sending and waking up take: 78.1 … 78.3 samples
    assert {b.sequence - a.sequence for a, b in itertools.pairwise(reported)} == {78, 79}
    assert reported[-1].sequence > 3 * 65536
    bench.client.zero()
    events = bench.run(T0 + 42)
    assert sum(isinstance(event, Zeroed) for event in events) == 1
    assert samples(events)[-1].values == (0,) * 6
    bench.client.stop()
    assert bench.run(T0 + 50) == [SensorStopped()]
    statistics = bench.client.statistics
    assert (statistics.lost, statistics.repeated, statistics.malformed, statistics.unpaired) == (0,) * 4


@on_both
def test_missing_sensor_is_reported(pair: Pair) -> None:
    bench = pair.bench(pair.powered(connected=False), ready_timeout_s=12.0)
    (failed,) = bench.run(T0 + 30)
    assert failed == SensorFailed(
        f"{pair.name}: acknowledges but is not ready after 12 s", "sensor unplugged?"
    )


@on_both
def test_stop_waits_for_end_of_long_period(pair: Pair) -> None:
    bench = pair.bench(period_ms=2000.0)
    assert samples(bench.run(T0 + 14.1))
    stopped_at = bench.now - T0
    bench.client.stop()
    assert bench.run(bench.now + 2.1)[-1] == SensorStopped()
    (stop,) = [data for at, data in bench.sent if at >= round(stopped_at, 3)]
    assert str(stop[0] if isinstance(stop, list) else stop) in ("281#", "b'<03>'")


@on_both
def test_unplugged_sensor_is_reported_as_hang(pair: Pair) -> None:
    bench = pair.bench()
    bench.run(T0 + 12)
    bench.gateway.unplug(bench.now)
    assert len(samples(bench.run(T0 + 12.5))) <= 1
    assert bench.client.statistics.stands
    bench.client.stop()
    failed = SensorFailed(f"{pair.name}: no acknowledge of stop, and its counter was stuck before", HANGS)
    assert bench.run(T0 + 15) == [failed]
    bench.gateway.plug_in(bench.now)
    assert bench.run(T0 + 16) == []


@on_both
def test_frozen_counter_ends_session(pair: Pair) -> None:
    bench = pair.bench()
    bench.run(T0 + 12)
    bench.gateway.unplug(bench.now)
    assert len(bench.run(T0 + 12.99)) <= 1
    (failed,) = bench.run(T0 + 13.05)
    assert isinstance(failed, SensorFailed)
    assert failed.text.startswith(f"{pair.name}: its counter has been stuck at ")


@on_both
def test_session_survives_short_unplugging(pair: Pair) -> None:
    bench = pair.bench(cutoff_hz=0.0)
    before = samples(bench.run(T0 + 12))
    bench.gateway.unplug(bench.now)
    bench.run(T0 + 12.3)
    bench.gateway.plug_in(bench.now)
    after = samples(bench.run(T0 + 13))
    assert len(after) > 60
    assert 0 < after[0].sequence - before[-1].sequence < 160
    assert after[-1].values == COUNTS


@on_both
def test_rebooted_gateway_loses_zero_and_is_restarted(pair: Pair) -> None:
    bench = pair.bench(cutoff_hz=0.0)
    bench.client.zero()
    before = samples(bench.run(T0 + 12))
    assert before[-1].values == (0,) * 6
    bench.gateway = pair.powered(at=bench.now)
    rebooted, ready, notice, *after = bench.run(T0 + 20)
    assert (rebooted, ready, notice) == (SensorRestarted(), READY, NOTICE)
    assert samples(after)[0].sequence == before[-1].sequence + 1
    assert samples(after)[-1].values == COUNTS


@on_both
def test_lost_frames_are_counted(pair: Pair) -> None:
    bench = pair.bench()
    bench.run(T0 + 10.005)
    observed = itertools.count(1)
    bench.up = lambda data: data[:0] if next(observed) % 10 == 0 else data
    reported = samples(bench.run(T0 + 11.055))
    assert (len(reported), bench.client.statistics.lost) == (95, 10)


# --- the CAN gateway alone


def test_lost_half_samples_are_counted() -> None:
    bench = CAN.bench()
    bench.run(T0 + 10.005)
    observed = itertools.count(1)

    def without_every_tenth_force_frame(frames: Sequence[CanFrame]) -> list[CanFrame]:
        return [frame for frame in frames if frame.identifier != 0x601 or next(observed) % 10]

    bench.up = without_every_tenth_force_frame
    reported = samples(bench.run(T0 + 11.055))
    assert (len(reported), bench.client.statistics.lost, bench.client.statistics.unpaired) == (95, 10, 10)


def test_unpowered_gateway_is_reported() -> None:
    bench = CAN.bench()
    bench.up = lambda frames: []
    (failed,) = bench.run(T0 + 30)
    assert isinstance(failed, SensorFailed)
    assert "silent: no frame of a gateway on the bus" in failed.text


def test_cell_is_never_read_backwards_or_ahead() -> None:
    requested: list[float] = []

    def wrench_at(times: NDArray[np.float64]) -> NDArray[np.float64]:
        requested.extend(times.tolist())
        assert times[-1] <= bench.now
        return CONSTANT(times)

    bench = CAN.bench(CAN.powered(wrench=wrench_at))
    bench.run(T0 + 3)
    bench.client.set_filter(2.0)
    bench.client.zero()
    bench.run(T0 + 4)
    assert requested == sorted(requested)
    assert requested[-1] > T0 + 3.8


# --- the UART gateway alone


def test_client_polls_through_boot_then_keeps_pace() -> None:
    bench = UART.bench()
    bench.client.zero()
    bench.run(T0 + 12)
    start = b"<02" + bytes.fromhex("E80310270000") + b">"
    assert bench.sent == [
        *((k * 1.25, b"<06>") for k in range(5)),
        (5.033, b"<06>"),
        (6.133, b"<07>"),
        (7.233, start),
        (8.333, b"<04>"),
    ]


def test_counts_like_delimiters_arrive_intact() -> None:
    """Six axes that read 0x3C3E, 0x3E3C and the like, with a filter that passes them."""
    counts = (0x3C3E, 0x3E3C, 0x3E3E, 0x3C3C, 0x3E, 0x3C)

    bench = UART.bench(UART.powered(wrench=of(counts)), cutoff_hz=0.0, period_ms=4.0)
    reported = samples(bench.run(T0 + 30))
    assert len(reported) > 5000
    assert {event.values for event in reported} == {counts}
    assert bench.client.statistics.malformed == 0


def test_damaged_bytes_lose_one_frame_only() -> None:
    bench = UART.bench()
    bench.run(T0 + 10.005)
    observed = itertools.count(1)
    bench.up = lambda data: data[1:] if next(observed) % 10 == 0 else data
    reported = samples(bench.run(T0 + 11.055))
    statistics = bench.client.statistics
    assert (len(reported), statistics.lost, statistics.malformed) == (95, 10, 10)


def test_lost_commands_are_repeated() -> None:
    bench = UART.bench()
    observed = itertools.count()
    bench.down = lambda data: b"" if next(observed) % 2 == 0 else data
    assert FILTERED in bench.run(T0 + 30)


def test_truncated_commands_are_repeated() -> None:
    """A truncated command is read together with the rest of the previous one, answered as such, and costs a second."""
    bench = UART.bench()
    observed = itertools.count()
    bench.down = lambda data: data[: len(data) // 2] if next(observed) % 3 == 0 else data
    assert FILTERED in bench.run(T0 + 30)


def test_client_joins_running_stream() -> None:
    first = UART.bench(cutoff_hz=0.0)
    first.run(T0 + 12)
    second = UART.bench(first.gateway, first.now, cutoff_hz=0.0, period_ms=20.0)
    cut = itertools.count()
    second.up = lambda data: data[7:] if next(cut) == 0 else data
    events = second.run(T0 + 20)
    assert events[0] == SensorReady(facts_of(SCALES, 0.02, 0.0))
    steps = {b.sequence - a.sequence for a, b in itertools.pairwise(samples(events))}
    assert steps == {155, 156, 157}
