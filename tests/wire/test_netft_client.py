"""Client of a Net F/T: its session, both sequences, the status, and silence."""

from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.devices.netft import NetFtClient, NetFtClientProfile, Record, encode_record
from protocol.devices.netft.http import Page
from protocol.devices.netft.records import AXIA
from protocol.endpoint import LocalProtocolError
from protocol.marks import SettingError
from protocol.wrench import (
    SensorFailed,
    SensorNotice,
    SensorReady,
    SensorRestarted,
    SensorStopped,
    WrenchFrame,
    Zeroed,
)

T0 = 1000.25
START, STOP = bytes.fromhex("1234000200000000"), bytes.fromhex("1234000000000000")
PAGE = Page(
    b"<netft><prodname>box</prodname><scfgfu>N</scfgfu><scfgtu>N-m</scfgtu><cfgcpf>1000000</cfgcpf>"
    b"<cfgcpt>1000000</cfgcpt><comrdtrate>1000</comrdtrate></netft>"
)
COUNTS = (1, -2, 3, -4, 5, -6)


def record(rdt: int, ft: int, status: int = 0, counts: Sequence[int] = COUNTS) -> bytes:
    a, b, c, d, e, f = counts
    return encode_record(Record(rdt, ft, status, (a, b, c, d, e, f)))


def events(client: NetFtClient) -> list[Any]:
    items = []
    while (event := client.next_event()) is not None:
        items.append(event)
    return items


def streaming(**settings: Any) -> NetFtClient:
    """Return a client whose stream has started with sample 700."""
    client = NetFtClient(NetFtClientProfile(**settings), T0)
    client.receive([PAGE], T0)
    assert client.data_to_send(T0) == [START]
    client.receive([record(1, 700)], T0)
    ready, frame = events(client)
    assert isinstance(ready, SensorReady)
    assert frame == WrenchFrame(COUNTS, 700, 700, T0)
    return client


def frames(client: NetFtClient) -> list[int]:
    return [event.sequence for event in events(client) if isinstance(event, WrenchFrame)]


def test_no_request_is_sent_before_the_page_gives_the_units() -> None:
    client = NetFtClient(NetFtClientProfile(), T0)
    assert client.data_to_send(T0) == []
    client.receive([record(1, 1)], T0)
    assert events(client) == []
    client.receive([Page(failure="nothing there")], T0 + 1.0)
    client.receive([PAGE], T0 + 2.0)
    assert client.data_to_send(T0 + 2.0) == [START]
    assert client.data_to_send(T0 + 2.0) == []


@pytest.mark.parametrize(
    ("page", "message"),
    [
        (Page(PAGE.replace(b"<scfgfu>N<", b"<scfgfu>pond<")), "the unknown unit 'pond'"),
        (Page(PAGE.replace(b"</netft>", b"<comrdte>Disabled</comrdte></netft>")), "switched off"),
        (Page(b"<html></html>"), "not from a Net F/T"),
        (Page(PAGE.replace(b"<scfgfu>N</scfgfu>", b"<cfgfu>7</cfgfu>")), "the unknown unit 'of code 7'"),
        (Page(PAGE.replace(b"<scfgtu>N-m</scfgtu>", b"")), "does not contain scfgtu"),
        (Page(PAGE.replace(b"</netft>", b"<runrate>7812</runrate></netft>")), "7812 internal samples"),
    ],
)
def test_invalid_page_ends_the_session(page: Page, message: str) -> None:
    client = NetFtClient(NetFtClientProfile(), T0)
    client.receive([page], T0)
    (failed,) = events(client)
    assert isinstance(failed, SensorFailed)
    assert message in failed.text
    assert "\n" not in failed.text
    assert client.next_deadline() is None
    with pytest.raises(LocalProtocolError):
        client.zero()


@pytest.mark.parametrize(
    ("tags", "force_n", "moment_nm"),
    [
        (b"<cfgfu>2</cfgfu><cfgtu>3</cfgtu>", 1e-6, 1e-6),
        (b"<cfgfu>5</cfgfu><cfgtu>4</cfgtu>", 9.80665e-6, 1e-9),
    ],
)
def test_units_are_read_from_codes_if_a_page_has_no_names(
    tags: bytes, force_n: float, moment_nm: float
) -> None:
    page = PAGE.replace(b"<scfgfu>N</scfgfu><scfgtu>N-m</scfgtu>", tags)
    client = NetFtClient(NetFtClientProfile(), T0)
    client.receive([Page(page)], T0)
    client.receive([record(1, 700)], T0)
    ready = events(client)[0]
    assert isinstance(ready, SensorReady)
    assert ready.facts.scales == pytest.approx((*(force_n,) * 3, *(moment_nm,) * 3))


def test_late_computer_causes_no_other_rate() -> None:
    """Each record of the first second is 5 to 12 ms per 0.1 s later than the previous one; then it catches up."""
    client, at = streaming(), T0
    for k in range(1, 1500):
        at = max(at, T0 + k * 1e-3) if k > 1000 else T0 + k * (1.06 + 0.00007 * k) * 1e-3
        client.receive([record(1 + k, 700 + 7 * k)], at)
    assert not [event for event in events(client) if isinstance(event, SensorFailed)]


@pytest.mark.parametrize(("rate", "jitter_s"), [(7812, 0.0), (3906, 0.003), (7000, 0.008)])
def test_another_internal_rate_is_reported_with_its_setting(rate: int, jitter_s: float) -> None:
    """One record per millisecond; every twentieth one is late."""
    client = streaming()
    for k in range(1, 1000):
        at = T0 + k * 1e-3 + (jitter_s if k % 20 == 0 else 0.0)
        client.receive([record(1 + k, 700 + round(k * rate * 1e-3))], at)
    failures = [event for event in events(client) if isinstance(event, SensorFailed)]
    if rate == 7000:
        assert not failures
        return
    (failed,) = failures
    assert f"it takes about {rate} internal samples a second, and internal_rate_hz is 7000" in failed.text
    assert failed.remedy == f'set family to "axia" and internal_rate_hz in [sensor.netft] to {rate}'


def test_missing_page_ends_the_session_with_the_reason() -> None:
    client = NetFtClient(NetFtClientProfile(page_patience_s=2.0), T0)
    client.receive([Page(failure="tcp://10.0.0.1:80: refused")], T0)
    client.handle_deadline(T0 + 1.0)
    assert events(client) == []
    client.handle_deadline(T0 + 2.0)
    (failed,) = events(client)
    assert "tcp://10.0.0.1:80: refused" in failed.text


def test_start_is_repeated_ten_times() -> None:
    client = NetFtClient(NetFtClientProfile(), T0)
    client.receive([PAGE], T0)
    sent: list[bytes] = []
    for k in range(12):
        sent += client.data_to_send(T0 + 0.11 * k)
        client.handle_deadline(T0 + 0.11 * (k + 1))
    assert sent == [START] * 10 + [STOP]
    (failed,) = events(client)
    assert "no record received after 10 requests" in failed.text


def test_silence_in_the_stream_repeats_the_request() -> None:
    client = streaming()
    client.receive([record(2, 707)], T0 + 0.001)
    client.handle_deadline(T0 + 0.1)
    assert client.data_to_send(T0 + 0.1) == []
    client.handle_deadline(T0 + 0.101)
    assert client.data_to_send(T0 + 0.101) == [START]
    assert [type(event) for event in events(client)] == [WrenchFrame, SensorNotice]
    client.receive([record(1, 1500)], T0 + 0.11)
    assert frames(client) == [1500]
    assert client.statistics.lost == 112


def test_gaps_duplicates_and_stragglers_are_counted() -> None:
    client = streaming()
    client.receive([record(2, 707), record(5, 728), record(5, 728), record(3, 714), record(6, 735)], T0)
    assert frames(client) == [707, 728, 735]
    assert client.statistics.lost == 2
    assert client.statistics.repeated == 2
    assert client.statistics.standing == 0


def test_stuck_sample_number_is_reported() -> None:
    client = streaming()
    client.receive([record(rdt, 700) for rdt in range(2, 6)], T0)
    assert frames(client) == []
    assert client.statistics.stands


def test_numbers_continue_over_their_wrap() -> None:
    client = NetFtClient(NetFtClientProfile(), T0)
    client.receive([PAGE, record(2**32 - 1, 2**32 - 7), record(0, 0), record(1, 7)], T0)
    assert frames(client) == [2**32 - 7, 2**32, 2**32 + 7]
    assert client.statistics.lost == 0


def test_restarted_box_is_reported() -> None:
    client = streaming()
    client.handle_deadline(T0 + 0.1)
    client.receive([record(1, 20)], T0 + 0.2)
    assert [type(event) for event in events(client)] == [SensorNotice, SensorRestarted, WrenchFrame]
    client = streaming()
    client.receive([record(k, 7 * k) for k in range(1, 20)], T0 + 0.001)
    assert SensorRestarted() in events(client)


def test_threshold_is_a_warning_once() -> None:
    client = streaming()
    client.receive([record(2, 707, 0x80010000), record(3, 714, 0x80010000)], T0)
    client.receive([record(4, 721, 0x00010000)], T0)
    assert [getattr(event, "saturated", "notice") for event in events(client)] == [
        "notice",
        0,
        0,
        "notice",
        0,
    ]


@pytest.mark.parametrize("status", [0x80020000, 0x88000010, 0x80000100, 0x80000000, 0x40000000, 0x80030000])
def test_any_other_status_marks_all_axes_and_is_reported(status: int) -> None:
    client = streaming()
    client.receive([record(2, 707, status), record(3, 714, status), record(4, 721)], T0)
    notice, *reports = events(client)
    assert f"{status:08X}" in notice.text
    assert [event.saturated for event in reports] == [0b111111, 0b111111, 0]


@pytest.mark.parametrize(
    ("status", "saturated"),
    [
        (0x80000008, 0),
        (0x10000000, 0),
        (0x00010000, 0),
        (0x88000000, 0b111111),
        (0xC0000000, 0b111111),
        (0x80000002, 0b111111),
    ],
)
def test_axia_busy_and_simulated_are_no_faults(status: int, saturated: int) -> None:
    client = streaming(family="axia")
    client.receive([record(2, 707, status)], T0)
    notice, frame = events(client)
    assert notice.text == f"status {status:08X}: {AXIA.words(status)}"
    assert frame.saturated == saturated


@pytest.mark.parametrize(("status", "begins"), [(0x80000008, True), (0x88000000, True), (0x80000001, False)])
def test_axia_session_starts_unless_it_is_faulty(status: int, begins: bool) -> None:
    client = NetFtClient(NetFtClientProfile(family="axia"), T0)
    client.receive([PAGE, record(1, 700, status)], T0)
    reports = events(client)
    assert any(isinstance(event, SensorReady) for event in reports) is begins
    assert begins or "temperature out of range" in reports[0].text


def test_rate_of_an_axia_needs_its_family() -> None:
    assert NetFtClientProfile().internal_rate_hz == 7000
    assert NetFtClientProfile(family="axia").internal_rate_hz == 7812
    with pytest.raises(SettingError, match='976 Hz is a rate of an Axia; set family = "axia"'):
        NetFtClientProfile(internal_rate_hz=976)
    with pytest.raises(SettingError, match="netbox or axia"):
        NetFtClientProfile(family="other")  # type: ignore[arg-type]


def test_constantly_changing_status_is_limited_in_the_recording() -> None:
    client = streaming()
    client.receive([record(2 + k, 707 + 7 * k, 0x80000000 | k % 90) for k in range(1000)], T0)
    reports = events(client)
    assert len([event for event in reports if isinstance(event, SensorNotice)]) == 16
    assert len(reports) == 1016


def test_session_does_not_start_with_an_error() -> None:
    client = NetFtClient(NetFtClientProfile(), T0)
    client.receive([PAGE, record(1, 700, 0x88000010), record(2, 707)], T0)
    (failed,) = events(client)
    assert isinstance(failed, SensorFailed)
    assert "88000010: serial link to the transducer" in failed.text
    assert client.data_to_send(T0) == [START, STOP]


def test_zero_is_the_hosts_and_the_sensor_is_not_biased() -> None:
    client = streaming(zero_s=0.003)
    client.zero()
    client.receive([record(2 + k, 707 + 7 * k, counts=(10 + k, 0, 0, 0, 0, 0)) for k in range(4)], T0)
    reports = events(client)
    assert [type(event) for event in reports] == [WrenchFrame, WrenchFrame, WrenchFrame, Zeroed, WrenchFrame]
    assert reports[-1].values == (2.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert client.data_to_send(T0) == []


def test_stop_is_repeated_while_records_arrive() -> None:
    client = streaming()
    client.stop()
    client.stop()
    sent = [*client.data_to_send(T0)]
    client.handle_deadline(T0)
    client.receive([record(2, 707)], T0 + 0.001)
    client.handle_deadline(T0 + 0.02)
    sent += client.data_to_send(T0 + 0.02)
    client.handle_deadline(T0 + 0.04)
    assert sent == [STOP, STOP]
    assert events(client) == [SensorStopped()]


def test_client_that_never_started_stops_at_once() -> None:
    client = NetFtClient(NetFtClientProfile(), T0)
    client.stop()
    assert events(client) == [SensorStopped()]
    assert client.data_to_send(T0) == []


@given(st.lists(st.one_of(st.binary(max_size=80), st.binary(min_size=36, max_size=36)), max_size=20))
def test_no_datagram_raises(data: list[bytes]) -> None:
    client = streaming()
    client.receive(data, T0)
    client.handle_deadline(T0 + 1.0)
    events(client)
    assert client.statistics.malformed == sum(len(one) != 36 for one in data)
