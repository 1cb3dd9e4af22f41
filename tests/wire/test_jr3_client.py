"""Behaviour specific to the CAN gateway client: SYNC, nodes, halves of samples, pauses after repetitions."""

from typing import Any

import pytest

from protocol.can.error import CanErrorReport, ErrorClass, encode_error
from protocol.can.frame import CanFrame
from protocol.devices.jr3 import Phase, encode_sample
from protocol.devices.jr3.counts import facts_of
from protocol.devices.jr3.firmware import HANGS, first_order_delay
from protocol.wrench import SensorFailed, SensorNotice, SensorReady, WrenchFrame

T0 = 1000.25
NOTICE = SensorNotice("the gateway's filter is off (cut-off 0): every sample is as noisy as the sensor")
READY = SensorReady(facts_of((115.0, 111.0, 185.0, 5.6, 5.2, 6.1), 0.01, first_order_delay(10.0)))
FORCE_SCALES, MOMENT_SCALES = "101#0073006F00B900", "101#00380034003D00"


@pytest.mark.parametrize(
    ("data", "fact", "remedy"),
    [
        ("", "silent: no frame of a gateway on the bus for 1 s", f"power, bit rate, wiring? {HANGS}"),
        (
            "102#00 601#R 00000101#00",
            "silent for 1 s while other nodes are on the bus",
            "wrong node number?",
        ),
    ],
)
def test_reason_for_not_ready_is_reported(can: Any, data: str, fact: str, remedy: str) -> None:
    client = can.begin(ready_timeout_s=1.0)
    client.receive(can.data(data), T0)
    assert client.phase is Phase.ASKING
    client.handle_deadline(T0 + 1)
    assert can.events(client) == [SensorFailed(f"gateway node 1: {fact}", remedy)]


def test_period_untested_by_the_firmware_warns(can: Any) -> None:
    warning = (
        "period_ms is 0.5, but the gateway's firmware was tested from 1 on: "
        "below that it may have no time left for anything else"
    )
    assert can.events(can.begin(period_ms=0.5)) == [SensorNotice(warning)]
    assert can.events(can.begin(period_ms=1.0)) == []


def test_not_ready_is_repeated_at_the_acknowledge_timeout(can: Any) -> None:
    client = can.begin(ready_timeout_s=1.0)
    can.exchange(client, T0, "101#01", expect="401#")
    assert can.orders(client, T0 + 0.1) == []
    assert client.next_deadline() == T0 + 0.25
    client.handle_deadline(T0 + 0.25)
    assert can.orders(client, T0 + 0.25) == ["401#"]


def test_repeated_command_lets_late_acknowledges_pass(can: Any) -> None:
    """Both answers to a repeated 481 arrive: the second must not count as the answer to 501."""
    client = can.begin()
    can.exchange(client, T0, "101#00", expect="401#")
    can.exchange(client, T0, "101#00", expect="201#E80310270000")
    assert can.orders(client, T0) == ["481#"]
    client.handle_deadline(T0 + 0.25)
    can.exchange(client, T0 + 0.25, FORCE_SCALES, expect="481#")
    assert can.orders(client, T0 + 0.26) == []
    client.receive(can.data(FORCE_SCALES), T0 + 0.27)
    assert client.next_deadline() == T0 + 0.5
    client.handle_deadline(T0 + 0.5)
    can.exchange(client, T0 + 0.5, MOMENT_SCALES, expect="501#")
    client.handle_deadline(T0 + 0.6)
    assert can.events(client) == [READY]


def test_pause_also_ends_without_its_deadline(can: Any) -> None:
    client = can.begin()
    client.data_to_send(T0)
    client.handle_deadline(T0 + 0.25)
    can.exchange(client, T0 + 0.25, "101#00", expect="401#")
    assert can.orders(client, T0 + 0.5) == ["201#E80310270000"]


def test_sample_has_counts_and_completion_time(can: Any) -> None:
    client = can.ready()
    forces, moments = encode_sample(1, (1, -2, 3, -4, 5, -6), 77)
    client.receive([forces, moments], T0 + 1)
    late = CanFrame(moments.identifier, bytes(6) + b"\x00\x01", received_at=T0 + 1.5)
    client.receive([CanFrame(forces.identifier, bytes(6) + b"\x00\x01"), late], T0 + 2)
    assert can.events(client) == [
        WrenchFrame((1, -2, 3, -4, 5, -6), 77, 77, T0 + 1),
        WrenchFrame((0, 0, 0, 0, 0, 0), 256, 256, T0 + 1.5),
    ]


def test_client_reports_saturated_axes_after_its_zero(can: Any) -> None:
    client = can.ready()
    client.receive(encode_sample(1, (0, 0, 20000, 0, 0, 0), 77), T0 + 1)
    client.zero()
    can.exchange(client, T0 + 1, "101#00", expect="301#")
    client.receive(encode_sample(1, (0, 0, 20000, 0, 0, 0), 155), T0 + 2)  # was sampled before the zero
    client.receive(encode_sample(1, (0, 32767, 32767 - 20000, 0, 0, 0), 233), T0 + 3)
    before, zeroed, *notices, after = can.events(client)
    assert (before.saturated, zeroed.crossing.counter) == (0, 155)
    assert after.saturated == 0b000110
    assert notices == [SensorNotice(f"{axis} is at 100% of the sensor's range") for axis in ("fy", "fz")]


def test_duplicates_and_stragglers_are_dropped(can: Any) -> None:
    client = can.ready()
    samples = can.feed(client, [65500, 65500, 65578, 65500, 65656, 65578, 65734])
    assert [event.sequence for event in samples] == [65500, 65578, 65656, 65734]
    assert client.statistics.repeated == 3
    assert client.statistics.lost == 0


def test_halves_count_only_together(can: Any) -> None:
    client = can.ready()
    (f1, m1), (f2, m2), (f3, m3) = can.sample(100), can.sample(178), can.sample(256)
    client.receive([f1, f2, m1, m2, m3, f3], T0 + 1)
    assert [event.counter for event in can.events(client)] == [178]
    assert client.statistics.unpaired == 3
    client.receive([m3], T0 + 1)
    assert [event.counter for event in can.events(client)] == [256]


def test_malformed_payloads_are_counted_and_session_continues(can: Any) -> None:
    client = can.begin()
    can.exchange(client, T0, "101#", expect="401#")
    client.receive(can.data("101#00"), T0)
    can.exchange(client, T0, "101#00", expect="201#E80310270000")
    can.exchange(client, T0, "101#00", expect="481#")
    client.receive(can.data(FORCE_SCALES), T0)
    can.exchange(client, T0, MOMENT_SCALES, expect="501#")
    client.handle_deadline(T0 + 0.1)
    client.receive(can.data("601#00 681#0102"), T0 + 1)
    assert client.statistics.malformed == 4
    assert [event.counter for event in can.feed(client, [5])] == [5]


@pytest.mark.parametrize(
    "wrong",
    [{"node": 0}, {"node": 128}],
)
def test_profile_refuses(can: Any, wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        can.profile(**wrong)


def test_interface_reports_are_passed_on_and_end_nothing(can: Any) -> None:
    client = can.begin()
    report = encode_error(CanErrorReport(ErrorClass.BUS_OFF))
    garbled = CanFrame(report.identifier, b"\0", error=True, extended=report.extended)
    client.receive([report, garbled], T0)
    notice = client.next_event()
    assert isinstance(notice, SensorNotice)
    assert notice.text == f"CAN bus: {CanErrorReport(ErrorClass.BUS_OFF)}"
    assert client.next_event() is None
    assert client.statistics.malformed == 1
    assert client.phase is Phase.ASKING
