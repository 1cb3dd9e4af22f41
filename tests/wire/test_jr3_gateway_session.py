"""Session of both gateway clients, over each wire: pace, repetitions, counters, failures, and end.

Behaviour of a single wire is tested in the other files of this folder.
"""

import functools
import operator
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.devices.jr3.counts import facts_of
from protocol.devices.jr3.firmware import HANGS, first_order_delay
from protocol.devices.jr3.gateway_session import Phase
from protocol.endpoint import LocalProtocolError, Trouble
from protocol.wrench import SensorFailed, SensorNotice, SensorReady, SensorRestarted, SensorStopped, Zeroed

T0 = 1000.25
NOTICE = SensorNotice("the gateway's filter is off (cut-off 0): every sample is as noisy as the sensor")
READY = SensorReady(facts_of((115.0, 111.0, 185.0, 5.6, 5.2, 6.1), 0.01, first_order_delay(10.0)))
SCALES = (50.0, 50.0, 100.0, 4.0, 4.0, 4.0)


def failure(wire: Any, client: Any) -> str:
    """Return the text of the failure, which is the only event left."""
    assert client.phase is Phase.FAILED
    (failed,) = wire.events(client)
    assert isinstance(failed, SensorFailed)
    return str(Trouble(failed.text, failed.remedy))


# --- from the beginning to the end


def test_session_from_the_first_question_to_the_stop(wire: Any) -> None:
    client = wire.ready()
    assert client.phase is Phase.READY
    client.zero()
    client.zero()
    wire.exchange(client, T0 + 10, wire.ok, expect=wire.zero)
    client.receive(wire.sample(5), T0 + 10)
    assert [type(event) for event in wire.events(client)] == [Zeroed]
    assert wire.orders(client, T0 + 19) == []
    client.stop()
    client.stop()
    wire.exchange(client, T0 + 20, wire.ok, expect=wire.stop)
    assert wire.events(client) == [SensorStopped()]
    assert client.next_deadline() is None
    assert wire.orders(client, T0 + 30) == []


def test_known_full_scales_are_not_requested_and_no_filter_noted(wire: Any) -> None:
    client = wire.begin(cutoff_hz=0.0, full_scales=SCALES)
    wire.exchange(client, T0, wire.ok, expect=wire.state)
    wire.exchange(client, T0 + wire.step, wire.ok, expect=wire.start("0000"))
    client.handle_deadline(T0 + wire.step + 0.125)
    assert wire.events(client) == [SensorReady(facts_of(SCALES, 0.01, 0.0)), NOTICE]


def test_streaming_client_waits_only_for_its_command(wire: Any) -> None:
    client = wire.ready()
    wire.feed(client, [5, 83])
    assert (client.next_deadline(), wire.orders(client, T0 + 12)) == (None, [])
    client.zero()
    assert (wire.orders(client, T0 + 12), client.next_deadline()) == ([wire.zero], T0 + 12 + wire.timeout)


def test_zero_before_ready_waits_for_the_filter(wire: Any) -> None:
    client = wire.begin()
    client.zero()
    now = wire.establish(client, T0)
    wire.exchange(client, now, wire.ok, expect=wire.zero)
    client.receive(wire.sample(5), now)
    assert [type(event) for event in wire.events(client)] == [type(READY), Zeroed]


def test_sample_before_the_zero_is_not_reported_after_it(wire: Any) -> None:
    """A gateway takes its zero with the next sample; one already on the line may follow the acknowledge."""
    client = wire.ready()
    client.zero()
    wire.exchange(client, T0 + 10, wire.ok, expect=wire.zero)
    client.receive(wire.sample(5), T0 + 10)
    client.receive(wire.sample(83), T0 + 10)
    zeroed, frame = wire.events(client)
    assert zeroed.crossing.counter == 5
    assert frame.counter == 83


def test_set_filter_now_and_at_the_next_start(wire: Any) -> None:
    client = wire.ready()
    client.set_filter(2.0)
    wire.exchange(client, T0 + 10, wire.ok, expect=wire.set_filter("C800"))
    (reports,) = wire.events(client)
    assert reports == SensorReady(replace(READY.facts, delay=first_order_delay(2.0)))
    client.receive(wire.data(wire.boot_up), T0 + 20)
    wire.establish(client, T0 + 20, "C800")
    client = wire.begin()
    client.set_filter(2.0)
    wire.establish(client, T0, "C800")
    for wrong in (-1.0, 0.004, 655.36, float("nan")):
        with pytest.raises(LocalProtocolError, match=r"cutoff_hz must be 0.01 … 655.35, or 0 for unfiltered"):
            client.set_filter(wrong)


def test_delay_follows_the_cut_off(wire: Any) -> None:
    assert READY.facts.delay == wire.profile().delay == pytest.approx(0.0159, abs=1e-4)
    client = wire.begin()
    client.set_filter(0.0)
    wire.establish(client, T0, "0000")
    ready, notice = wire.events(client)
    assert (ready.facts.delay, notice) == (0.0, NOTICE)


# --- silence, repetitions, late answers


def test_silence_is_repeated_at_its_time_and_fails(wire: Any) -> None:
    client = wire.begin(ready_timeout_s=3 * wire.timeout - 0.125)
    requests, now = [], T0
    while client.phase is Phase.ASKING:
        requests += [(now, text) for text in wire.orders(client, now)]
        now = client.next_deadline() or 0.0
        client.handle_deadline(now)
    assert requests == [(T0 + k * wire.timeout, wire.state) for k in range(3)]
    assert failure(wire, client).startswith(f"{wire.name}: silent")
    assert client.next_deadline() is None
    with pytest.raises(LocalProtocolError, match="failed"):
        client.zero()


def test_sensor_that_never_becomes_ready_is_reported(wire: Any) -> None:
    client = wire.begin(ready_timeout_s=3.0)
    wire.exchange(client, T0, wire.not_ready, expect=wire.state)
    client.handle_deadline(T0 + 3)
    assert failure(wire, client) == f"{wire.name}: acknowledges but is not ready after 3 s; sensor unplugged?"


def test_not_ready_on_the_way_goes_back_to_asking(wire: Any) -> None:
    client = wire.begin()
    (first, answer), (second, answer_to_second), *_ = wire.session()
    wire.exchange(client, T0, answer, expect=first)
    not_ready = answer_to_second.replace(wire.ok.rstrip(">"), wire.not_ready.rstrip(">"))
    wire.exchange(client, T0 + wire.step, not_ready, expect=second)
    now = T0 + wire.step + max(wire.step, wire.timeout)
    client.handle_deadline(now)
    wire.establish(client, now)
    assert wire.events(client) == [READY]


def test_not_ready_after_ready_fails(wire: Any) -> None:
    client = wire.ready()
    client.zero()
    wire.exchange(client, T0 + 10, wire.not_ready, expect=wire.zero)
    assert failure(wire, client) == f"{wire.name}: acknowledges but is not ready any more; sensor unplugged?"


@pytest.mark.parametrize(("place", "axis"), list(enumerate(["fx", "fy", "fz", "mx", "my", "mz"])))
def test_full_scale_0_is_named(wire: Any, place: int, axis: str) -> None:
    scales = [1] * 6
    scales[place] = 0
    answers = dict(wire.session()) | {order: answer(scales) for order, answer in wire.scales}
    client, now = wire.begin(), T0
    while client.phase is not Phase.FAILED:
        (order,) = wire.orders(client, now)
        client.receive(wire.data(answers[order]), now)
        now += wire.step
    assert failure(wire, client) == f"{wire.name}: full scale of {axis} is 0; calibration not read?"


def test_command_without_acknowledge_fails_after_its_retries(wire: Any) -> None:
    client = wire.begin(retries=2)
    wire.exchange(client, T0, wire.ok, expect=wire.state)
    second = wire.session()[1][0]
    for attempt in range(3):
        assert wire.orders(client, T0 + wire.step + attempt * wire.timeout) == [second]
        client.handle_deadline(T0 + wire.step + (attempt + 1) * wire.timeout)
    assert failure(wire, client) == f"{wire.name}: no acknowledge of {wire.second} after 3 tries; {HANGS}"


# --- stop and restart


def test_lost_stop_is_repeated_within_its_patience(wire: Any) -> None:
    client = wire.ready()
    client.stop()
    assert wire.orders(client, T0 + 10) == [wire.stop]
    repeated_at = client.next_deadline()
    assert repeated_at is not None
    client.handle_deadline(repeated_at)
    assert wire.orders(client, repeated_at) == [wire.stop]
    assert T0 + 10 < repeated_at < T0 + 10 + client.stop_patience


def test_stop_patience_includes_the_stream_period(wire: Any) -> None:
    client = wire.begin(period_ms=2000.0, full_scales=SCALES)
    wire.exchange(client, T0, wire.ok, expect=wire.state)
    client.stop()
    wire.orders(client, T0 + 10)
    assert client.next_deadline() == T0 + 10 + wire.timeout + 2.0
    assert client.stop_patience == 2 * (wire.timeout + 2.0)


def test_unacknowledged_stop_after_a_stuck_counter_fails_at_once(wire: Any) -> None:
    client = wire.ready()
    wire.feed(client, [5, 83, 83, 83, 83])
    client.stop()
    wire.orders(client, T0 + 12)
    client.handle_deadline(T0 + 12 + wire.timeout + 0.01)
    assert failure(wire, client) == (
        f"{wire.name}: no acknowledge of stop, and its counter was stuck before; {HANGS}"
    )


def test_counter_stuck_for_long_fails(wire: Any) -> None:
    client = wire.ready()
    wire.feed(client, [5, 83], T0 + 10)
    at = T0 + 10.99
    for k in range(3):
        wire.feed(client, [83], at)
        assert client.statistics.standing == k + 1
    client.receive(wire.sample(83), T0 + 12)
    assert failure(wire, client) == (
        f"{wire.name}: its counter has been stuck at 83 for 2.0 s while samples continue; "
        "sensor unplugged? plug it in, then switch the gateway off and on"
    )


def test_counter_that_resumes_is_accepted(wire: Any) -> None:
    client = wire.ready()
    wire.feed(client, [5, 83, 83, 83, 83], T0 + 10)
    assert client.statistics.stands
    wire.feed(client, [161], T0 + 10.5)
    assert not client.statistics.stands
    wire.feed(client, [161], T0 + 11.4)
    assert client.phase is Phase.READY


def test_stop_ignores_the_acknowledge_of_a_pending_order(wire: Any) -> None:
    client = wire.ready()
    client.zero()
    assert wire.orders(client, T0 + 10) == [wire.zero]
    client.stop()
    assert wire.orders(client, T0 + 10) == [wire.stop]
    client.receive(wire.data(wire.ok), T0 + 10)
    assert wire.events(client) == []
    client.receive(wire.data(wire.boot_up), T0 + 10)
    client.receive(wire.data(wire.not_ready), T0 + 10)
    assert wire.events(client) == [SensorStopped()]
    for wish in (client.zero, lambda: client.set_filter(1.0)):
        with pytest.raises(LocalProtocolError):
            wish()


def test_stop_after_a_failure_still_goes_out(wire: Any) -> None:
    client = wire.begin()
    client.handle_deadline(T0 + 12)
    assert failure(wire, client)
    client.stop()
    wire.exchange(client, T0 + 13, wire.ok, expect=wire.stop)
    assert wire.events(client) == [SensorStopped()]


def test_boot_up_restarts_at_once_and_the_sequence_continues(wire: Any) -> None:
    client = wire.ready()
    before = wire.feed(client, [100, 178])
    client.receive(wire.data(wire.boot_up), T0 + 20)
    assert wire.events(client) == [SensorRestarted()]
    wire.establish(client, T0 + 20)
    assert wire.events(client) == [READY]
    after = wire.feed(client, [5, 83], T0 + 30)
    assert [event.sequence for event in (*before, *after)] == [100, 178, 179, 257]
    assert client.statistics.lost == 0


def test_boot_up_while_asking_only_repeats_the_request(wire: Any) -> None:
    client = wire.begin()
    client.data_to_send(T0)
    client.receive(wire.data(wire.boot_up), T0 + 0.1)
    wire.establish(client, T0 + 0.1)
    assert wire.events(client) == [READY]


# --- samples


def test_samples_before_ready_are_not_reported(wire: Any) -> None:
    client = wire.begin()
    client.receive(wire.sample(1), T0)
    assert wire.events(client) == []


def test_counter_continues_over_its_wrap(wire: Any) -> None:
    """At 10 ms the counter steps by 77.8 samples of 128.5 µs and wraps every 8.4 s."""
    client = wire.ready()
    counters = [int(k * 10_000 / 128.5) for k in range(1, 2000)]
    reports = wire.feed(client, counters)
    assert [event.sequence for event in reports] == counters
    assert [event.counter for event in reports] == [counter % 65536 for counter in counters]
    assert client.statistics.lost == 0


@pytest.mark.full
@settings(max_examples=60)
@given(missing=st.sets(st.integers(1, 299), max_size=60))
def test_lost_and_repeated_frames_are_counted(wire: Any, missing: set[int]) -> None:
    client = wire.ready()
    kept = [k for k in range(301) if k not in missing]
    counters = [60_000 + int(k * 10_000 / 128.5) for k in kept]
    reports = wire.feed(client, [*counters, counters[-1]])
    assert len(reports) == len(kept)
    assert client.statistics.lost == len(missing)
    assert client.statistics.repeated == 1


@pytest.mark.full
@settings(max_examples=60)
@given(data=st.data())
def test_any_split_of_the_stream_gives_the_same_events(wire: Any, data: st.DataObject) -> None:
    stream = [wire.sample(65000 + 78 * k & 0xFFFF) for k in range(12) if k != 5]
    rest = functools.reduce(operator.add, stream, wire.noise)
    complete, parts = wire.ready(), wire.ready()
    complete.receive(rest, T0 + 10)
    while rest:
        size = data.draw(st.integers(1, len(rest)))
        parts.receive(rest[:size], T0 + 10)
        rest = rest[size:]
    assert wire.events(parts) == wire.events(complete)
    assert parts.statistics == complete.statistics
    assert parts.statistics.malformed == 1


@pytest.mark.full
@settings(max_examples=100)
@given(data=st.data())
def test_garbage_then_a_boot_up_recovers(wire: Any, data: st.DataObject) -> None:
    client = wire.begin()
    client.data_to_send(T0)
    for noise in data.draw(st.lists(wire.garbage, max_size=5)):
        client.receive(noise, T0)
    client.receive(wire.data(wire.boot_up), T0 + 1)
    wire.establish(client, T0 + 1)
    assert wire.events(client)[-1] == READY


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"cutoff_hz": 655.36}, "cutoff_hz must be at most 655.35"),
        ({"cutoff_hz": 0.004}, "cutoff_hz must be 0.01 … 655.35, or 0 for unfiltered, got 0.004"),
        ({"period_ms": 0.0}, "period_ms must be more than 0"),
        ({"period_ms": 4001.0}, "period_ms must be at most 4000"),
        ({"full_scales": (1.0, 2.0)}, "full_scales must be six values or empty, got 2"),
        ({"full_scales": (1.0,) * 5 + (0.0,)}, "full_scales must be more than 0"),
    ],
)
def test_profile_refuses(wire: Any, wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match="must") as caught:
        wire.profile(**wrong)
    assert str(caught.value).startswith(message)
