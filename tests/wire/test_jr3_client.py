"""The gateway client against scripted frames: session, repetitions, counters, failures."""

from collections.abc import Iterable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.can import CanFrame
from protocol.can_error import CanErrorReport, ErrorClass, encode_error
from protocol.endpoint import LocalProtocolError
from protocol.jr3 import (
    GatewayClient,
    GatewayClientProfile,
    Phase,
    SensorEvent,
    SensorFailed,
    SensorFrame,
    SensorNotice,
    SensorReady,
    SensorRestarted,
    SensorStopped,
    Zeroed,
    encode_sample,
    parse_frame,
)

T0 = 1000.25
NOTICE = SensorNotice("the gateway's filter is off (cut-off 0): every sample is as noisy as the sensor")
READY = SensorReady((115.0, 111.0, 185.0, 5.6, 5.2, 6.1))
FORCE_SCALES, MOMENT_SCALES = "101#0073006F00B900", "101#0038003400 3D00".replace(" ", "")


def frames(*texts: str) -> list[CanFrame]:
    return [parse_frame(text) for text in texts]


def sent(client: GatewayClient, now: float) -> list[str]:
    return [str(frame) for frame in client.data_to_send(now)]


def events(client: GatewayClient) -> list[SensorEvent]:
    told = []
    while (event := client.next_event()) is not None:
        told.append(event)
    return told


def exchange(client: GatewayClient, now: float, answer: str, *, expect: str) -> None:
    assert sent(client, now) == [expect]
    client.receive(frames(answer), now)


def ready(now: float = T0, **changes: object) -> GatewayClient:
    """A client past its session's beginning, `settle_s` after `now`."""
    client = GatewayClient(GatewayClientProfile(**changes), now)  # type: ignore[arg-type]
    establish(client, now)
    assert events(client) == [READY]
    return client


def establish(client: GatewayClient, now: float, start: str = "201#E80310270000") -> None:
    exchange(client, now, "101#00", expect="401#")
    exchange(client, now, "101#00", expect=start)
    exchange(client, now, FORCE_SCALES, expect="481#")
    exchange(client, now, MOMENT_SCALES, expect="501#")
    assert client.next_deadline() == now + 0.1
    client.handle_deadline(now + 0.1)


def sample(counter: int, value: int = 7) -> tuple[CanFrame, CanFrame]:
    return encode_sample(1, [value] * 6, counter % 65536)


def feed(client: GatewayClient, counters: Iterable[int], now: float = T0 + 1) -> list[SensorEvent]:
    for counter in counters:
        client.receive(sample(counter), now)
    return events(client)


def test_session_in_the_order_of_the_known_client() -> None:
    client = ready()
    assert client.phase is Phase.READY
    client.zero()
    client.zero()
    exchange(client, T0 + 0.2, "101#00", expect="301#")
    assert events(client) == [Zeroed()]
    assert sent(client, T0 + 0.2) == []
    client.stop()
    client.stop()
    exchange(client, T0 + 1, "101#00", expect="281#")
    assert events(client) == [SensorStopped()]
    assert client.next_deadline() is None
    assert sent(client, T0 + 2) == []


def test_synchronous_session_with_known_full_scales() -> None:
    scales = (50.0, 50.0, 100.0, 4.0, 4.0, 4.0)
    client = GatewayClient(GatewayClientProfile(node=3, mode="sync", cutoff_hz=0, full_scales=scales), T0)
    exchange(client, T0, "103#00", expect="403#")
    exchange(client, T0, "103#00", expect="183#0000")
    with pytest.raises(LocalProtocolError, match="settling"):
        client.sync()
    client.handle_deadline(T0 + 0.1)
    # A cut-off of 0 is possible on purpose, and said.
    assert events(client) == [SensorReady(scales), NOTICE]
    client.sync()
    client.sync()
    assert sent(client, T0 + 0.2) == ["080#", "080#"]
    # Any gap is right in synchronous mode, and nothing is counted as lost.
    client.receive([*encode_sample(3, range(6), 9), *encode_sample(3, range(6), 65000)], T0 + 0.3)
    assert [event.sequence for event in events(client)] == [9, 65000]
    assert client.statistics.lost == 0


def test_a_client_that_streams_waits_for_nothing_but_its_command() -> None:
    client = ready()
    feed(client, [5, 83])
    assert (client.next_deadline(), sent(client, T0 + 2)) == (None, [])
    client.zero()
    assert (sent(client, T0 + 2), client.next_deadline()) == (["301#"], T0 + 2.25)


def test_zero_before_ready_waits_for_the_filter() -> None:
    client = GatewayClient(GatewayClientProfile(), T0)
    client.zero()
    establish(client, T0)
    exchange(client, T0 + 0.1, "101#00", expect="301#")
    assert events(client) == [READY, Zeroed()]


def test_set_filter_now_and_at_the_next_start() -> None:
    client = ready()
    client.set_filter(2.0)
    exchange(client, T0 + 1, "101#00", expect="381#C800")
    assert events(client) == []
    client.receive(frames("701#"), T0 + 2)
    establish(client, T0 + 2, start="201#C80010270000")
    client = GatewayClient(GatewayClientProfile(), T0)
    client.set_filter(2.0)
    establish(client, T0, start="201#C80010270000")
    for wrong in (-1.0, 0.004, 655.36, float("nan")):
        with pytest.raises(LocalProtocolError, match=r"cutoff_hz must be 0.01 … 655.35, or 0 for unfiltered"):
            client.set_filter(wrong)


def test_silence_is_asked_again_and_fails_as_silence() -> None:
    client = GatewayClient(GatewayClientProfile(ready_timeout_s=1.0), T0)
    asked, now = [], T0
    while client.phase is Phase.ASKING:
        asked += [(now, text) for text in sent(client, now)]
        now = client.next_deadline() or 0.0
        client.handle_deadline(now)
    assert asked == [(T0 + k * 0.25, "401#") for k in range(4)]
    (failed,) = events(client)
    assert isinstance(failed, SensorFailed)
    assert "silent: nothing of a gateway on the bus" in failed.text
    assert client.next_deadline() is None
    with pytest.raises(LocalProtocolError, match="failed"):
        client.zero()


def test_other_nodes_only() -> None:
    client = GatewayClient(GatewayClientProfile(ready_timeout_s=1.0), T0)
    client.receive(frames("102#00", "601#R", "00000101#00"), T0)
    assert client.phase is Phase.ASKING
    client.handle_deadline(T0 + 1)
    (failed,) = events(client)
    assert "wrong node" in failed.text


def test_not_ready_is_asked_again_at_the_acknowledge_timeout() -> None:
    client = GatewayClient(GatewayClientProfile(ready_timeout_s=1.0), T0)
    exchange(client, T0, "101#01", expect="401#")
    assert sent(client, T0 + 0.1) == []
    assert client.next_deadline() == T0 + 0.25
    client.handle_deadline(T0 + 0.25)
    exchange(client, T0 + 0.25, "101#01", expect="401#")
    client.handle_deadline(T0 + 1)
    (failed,) = events(client)
    assert "acknowledges but not ready" in failed.text
    assert "unplugged" in failed.text


def test_not_ready_during_the_start_goes_back_to_asking() -> None:
    client = GatewayClient(GatewayClientProfile(), T0)
    exchange(client, T0, "101#00", expect="401#")
    exchange(client, T0, "101#01", expect="201#E80310270000")
    client.handle_deadline(T0 + 0.25)
    establish(client, T0 + 0.25)
    assert events(client) == [READY]


def test_not_ready_after_ready_fails() -> None:
    client = ready()
    client.zero()
    exchange(client, T0 + 1, "101#01", expect="301#")
    (failed,) = events(client)
    assert "unplugged" in failed.text


@pytest.mark.parametrize(("place", "axis"), list(enumerate(["fx", "fy", "fz", "mx", "my", "mz"])))
def test_full_scale_0_is_named(place: int, axis: str) -> None:
    words = [1] * 6
    words[place] = 0
    answers = ["101#00" + "".join(f"{word:02X}00" for word in words[half : half + 3]) for half in (0, 3)]
    client = GatewayClient(GatewayClientProfile(), T0)
    for answer in ("101#00", "101#00", *answers):
        client.data_to_send(T0)
        client.receive(frames(answer), T0)
    (failed,) = events(client)
    assert f"full scale of {axis} is 0" in failed.text


def test_a_repeated_command_lets_late_acknowledges_pass() -> None:
    """Both answers to a repeated 481 come: the second must not be taken for the answer to 501."""
    client = GatewayClient(GatewayClientProfile(), T0)
    exchange(client, T0, "101#00", expect="401#")
    exchange(client, T0, "101#00", expect="201#E80310270000")
    assert sent(client, T0) == ["481#"]
    client.handle_deadline(T0 + 0.25)
    exchange(client, T0 + 0.25, FORCE_SCALES, expect="481#")
    assert sent(client, T0 + 0.26) == []
    client.receive(frames(FORCE_SCALES), T0 + 0.27)
    assert client.next_deadline() == T0 + 0.5
    client.handle_deadline(T0 + 0.5)
    exchange(client, T0 + 0.5, MOMENT_SCALES, expect="501#")
    client.handle_deadline(T0 + 0.6)
    assert events(client) == [READY]


def test_the_pause_also_ends_without_its_deadline() -> None:
    client = GatewayClient(GatewayClientProfile(), T0)
    client.data_to_send(T0)
    client.handle_deadline(T0 + 0.25)
    exchange(client, T0 + 0.25, "101#00", expect="401#")
    assert sent(client, T0 + 0.5) == ["201#E80310270000"]


def test_a_command_without_acknowledge_fails_after_its_retries() -> None:
    client = GatewayClient(GatewayClientProfile(retries=2), T0)
    exchange(client, T0, "101#00", expect="401#")
    for attempt in range(3):
        assert sent(client, T0 + attempt * 0.25) == ["201#E80310270000"]
        client.handle_deadline(T0 + (attempt + 1) * 0.25)
    (failed,) = events(client)
    assert failed.text == "gateway node 1: no acknowledge of start async after 3 tries"


def test_a_lost_stop_is_repeated_within_its_patience() -> None:
    client = ready()
    client.stop()
    assert sent(client, T0 + 1) == ["281#"]
    repeated_at = client.next_deadline()
    assert repeated_at is not None
    client.handle_deadline(repeated_at)
    assert sent(client, repeated_at) == ["281#"]
    assert T0 + 1 < repeated_at < T0 + 1 + client.stop_patience


def test_stop_is_not_fooled_by_the_acknowledge_of_what_was_under_way() -> None:
    client = ready()
    client.zero()
    assert sent(client, T0 + 1) == ["301#"]
    client.stop()
    assert sent(client, T0 + 1) == ["281#"]
    client.receive(frames("101#00"), T0 + 1)
    assert events(client) == []
    client.receive(frames("701#", "101#01"), T0 + 1)
    assert events(client) == [SensorStopped()]
    for wish in (client.zero, client.sync, lambda: client.set_filter(1.0)):
        with pytest.raises(LocalProtocolError):
            wish()


def test_stop_after_a_failure_still_goes_out() -> None:
    client = GatewayClient(GatewayClientProfile(), T0)
    client.handle_deadline(T0 + 10)
    client.stop()
    exchange(client, T0 + 11, "101#00", expect="281#")
    assert isinstance(events(client)[-1], SensorStopped)


def test_boot_up_starts_over_and_the_sequence_goes_on() -> None:
    client = ready()
    before = feed(client, [100, 178])
    client.receive(frames("701#"), T0 + 2)
    assert events(client) == [SensorRestarted()]
    establish(client, T0 + 2)
    assert events(client) == [READY]
    after = feed(client, [5, 83])
    assert [event.sequence for event in (*before, *after)] == [100, 178, 179, 257]
    assert client.statistics.lost == 0


def test_boot_up_while_asking_only_asks_at_once() -> None:
    client = GatewayClient(GatewayClientProfile(), T0)
    client.data_to_send(T0)
    client.receive(frames("701#"), T0 + 0.1)
    establish(client, T0 + 0.1)
    assert events(client) == [READY]


def test_samples_before_ready_are_not_told() -> None:
    client = GatewayClient(GatewayClientProfile(), T0)
    client.receive(sample(1), T0)
    assert events(client) == []


def test_a_sample_tells_counts_and_when_it_was_complete() -> None:
    client = ready()
    forces, moments = encode_sample(1, (1, -2, 3, -4, 5, -6), 77)
    client.receive([forces, moments], T0 + 1)
    late = CanFrame(moments.identifier, bytes(6) + b"\x00\x01", received_at=T0 + 1.5)
    client.receive([CanFrame(forces.identifier, bytes(6) + b"\x00\x01"), late], T0 + 2)
    assert events(client) == [
        SensorFrame((1, -2, 3, -4, 5, -6), 77, 77, T0 + 1),
        SensorFrame((0, 0, 0, 0, 0, 0), 256, 256, T0 + 1.5),
    ]


def test_the_counter_goes_on_over_its_wrap() -> None:
    """At 10 ms the counter steps by 77.8 samples of 128.5 µs and wraps every 8.4 s."""
    client = ready()
    counters = [int(k * 10_000 / 128.5) for k in range(1, 2000)]
    told = feed(client, counters)
    assert [event.sequence for event in told] == counters
    assert [event.counter for event in told] == [counter % 65536 for counter in counters]
    assert client.statistics.lost == 0


@settings(max_examples=60)
@given(st.sets(st.integers(1, 299), max_size=60))
def test_lost_frames_are_counted(missing: set[int]) -> None:
    client = ready()
    kept = [k for k in range(301) if k not in missing]
    told = feed(client, [60_000 + int(k * 10_000 / 128.5) for k in kept])
    assert len(told) == len(kept)
    assert client.statistics.lost == len(missing)


def test_duplicates_and_stragglers_are_dropped() -> None:
    client = ready()
    told = feed(client, [65500, 65500, 65578, 65500, 65656, 65578, 65734])
    assert [event.sequence for event in told] == [65500, 65578, 65656, 65734]
    assert client.statistics.repeated == 3
    assert client.statistics.lost == 0


def test_halves_count_only_together() -> None:
    client = ready()
    (f1, m1), (f2, m2), (f3, m3) = sample(100), sample(178), sample(256)
    client.receive([f1, f2, m1, m2, m3, f3], T0 + 1)
    assert [event.counter for event in events(client)] == [178]
    assert client.statistics.unpaired == 3
    client.receive([m3], T0 + 1)
    assert [event.counter for event in events(client)] == [256]


def test_malformed_payloads_are_counted_and_the_session_goes_on() -> None:
    client = GatewayClient(GatewayClientProfile(), T0)
    exchange(client, T0, "101#", expect="401#")
    client.receive(frames("101#00"), T0)
    exchange(client, T0, "101#00", expect="201#E80310270000")
    exchange(client, T0, "101#00", expect="481#")
    client.receive(frames(FORCE_SCALES), T0)
    exchange(client, T0, MOMENT_SCALES, expect="501#")
    client.handle_deadline(T0 + 0.1)
    client.receive(frames("601#00", "681#0102"), T0 + 1)
    assert client.statistics.malformed == 4
    assert [event.counter for event in feed(client, [5]) if isinstance(event, SensorFrame)] == [5]


@settings(max_examples=50)
@given(st.data())
def test_any_split_of_the_frames_tells_the_same(data: st.DataObject) -> None:
    stream = [frame for k in range(12) if k != 5 for frame in sample(65000 + 78 * k, k)]
    whole, parts = ready(), ready()
    whole.receive(stream, T0 + 1)
    rest = stream
    while rest:
        size = data.draw(st.integers(1, len(rest)))
        parts.receive(rest[:size], T0 + 1)
        rest = rest[size:]
    assert events(parts) == events(whole)
    assert parts.statistics == whole.statistics


@settings(max_examples=150)
@given(st.lists(st.builds(CanFrame, st.sampled_from(range(0x7FF)) | st.just(0x101), st.binary(max_size=8))))
def test_garbage_then_a_boot_up_recovers(garbage: list[CanFrame]) -> None:
    client = GatewayClient(GatewayClientProfile(), T0)
    client.data_to_send(T0)
    client.receive(garbage, T0)
    client.receive(frames("701#"), T0 + 1)
    establish(client, T0 + 1)
    assert events(client)[-1] == READY


@pytest.mark.parametrize(
    "wrong",
    [
        {"node": 0},
        {"node": 128},
        {"cutoff_hz": 655.36},
        {"cutoff_hz": 0.004},
        {"period_ms": 0.0},
        {"mode": "both"},
        {"full_scales": (1.0, 2.0)},
        {"full_scales": (1.0,) * 5 + (0.0,)},
    ],
)
def test_profile_refuses(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        GatewayClientProfile(**wrong)  # type: ignore[arg-type]


def test_the_delay_follows_the_cut_off() -> None:
    client = ready()
    assert client.delay == GatewayClientProfile().delay == pytest.approx(0.0159, abs=1e-4)
    client.set_filter(0.0)
    assert client.delay == 0.0


def test_what_the_interface_reports_of_the_bus_is_told_and_ends_nothing() -> None:
    client = GatewayClient(GatewayClientProfile(), T0)
    report = encode_error(CanErrorReport(ErrorClass.BUS_OFF))
    garbled = CanFrame(report.identifier, b"\0", error=True, extended=report.extended)
    client.receive([report, garbled], T0)
    notice = client.next_event()
    assert isinstance(notice, SensorNotice)
    assert notice.text == f"CAN bus: {CanErrorReport(ErrorClass.BUS_OFF)}"
    assert client.next_event() is None
    assert client.statistics.malformed == 1
    assert client.phase is Phase.ASKING
