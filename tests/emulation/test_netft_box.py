"""Tests of the emulated Net F/T: its stream, its refusals, its faults, its pages."""

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from emulators.devices.netft import NETFT_FAULTS, NetBox, NetFtProfile, PageEndpoint, answer
from emulators.faults import Ledger
from emulators.seams import Floats
from emulators.sensing import KnownWrench
from protocol.datagram import Datagram, side_of
from protocol.devices.netft import Command, Record, decode_record, encode_request, parse_page
from protocol.devices.netft.http import encode_get, read_answer
from protocol.devices.netft.records import SATURATED
from tests.emulation.quiet_sensor import QUIET

T0 = 100.0
READY = {**QUIET, "boot_s": 0.0}
LOAD = (1.0, -2.0, 3.0, 0.1, -0.2, 0.3)


def steady(load: tuple[float, ...] = LOAD) -> Callable[[Floats], Floats]:
    return lambda times: np.tile(np.array(load), (len(times), 1))


def box(wrench: Callable[[Floats], Floats] | None = None, **settings: Any) -> NetBox:
    return NetBox(NetFtProfile(**{**READY, **settings}), KnownWrench(wrench or steady()), T0, 7)


def ledger(device: NetBox) -> Ledger:
    result = Ledger(NETFT_FAULTS)
    for target, handlers in device.handlers.items():
        result.attach(target, handlers)
    return result


def ask(device: NetBox, command: Command, now: float, count: int = 0) -> None:
    device.endpoint.receive([encode_request(command, count)], now)


def records_until(device: NetBox, until: float) -> list[Record]:
    """Return the records up to a time, each sent when it is due."""
    result = []
    while (due := device.endpoint.next_deadline()) is not None and due <= until:
        device.endpoint.handle_deadline(due)
        for datagram in device.endpoint.data_to_send(due):
            result += [decode_record(datagram[at : at + 36]) for at in range(0, len(datagram), 36)]
    return result


def streamed(device: NetBox, seconds: float = 0.02, begin: float = T0) -> list[Record]:
    ask(device, Command.START, begin)
    return records_until(device, begin + seconds)


def test_stream_counts_records_and_samples() -> None:
    records = streamed(box())
    assert len(records) == 20
    assert [record.rdt_sequence for record in records] == list(range(1, 21))
    assert {b.ft_sequence - a.ft_sequence for a, b in itertools.pairwise(records)} == {7}
    assert records[0].counts == (1000000, -2000000, 3000000, 100000, -200000, 300000)
    assert {record.status for record in records} == {0}


@pytest.mark.parametrize(("rate", "step"), [(7000, 1), (3000, 2), (2000, 3), (1000, 7)])
def test_sample_is_never_sent_twice(rate: int, step: int) -> None:
    records = streamed(box(rate_hz=rate), 0.1)
    assert {b.ft_sequence - a.ft_sequence for a, b in itertools.pairwise(records)} == {step}
    assert len(records) == pytest.approx(700 / step, abs=3)


def test_sampled_at_is_time_of_measurement() -> None:
    device = box(lambda times: np.outer(times - T0, np.ones(6)))
    record = streamed(device)[-1]
    at = device.sampled_at(record.ft_sequence)
    assert at is not None
    assert record.counts[0] == pytest.approx((at - T0) * 1e6, abs=1)
    assert device.sampled_at(record.ft_sequence + 100) is None


def test_finite_request_ends_by_itself() -> None:
    device = box()
    ask(device, Command.START, T0, count=3)
    assert len(records_until(device, T0 + 1.0)) == 3
    assert device.endpoint.next_deadline() is None
    ask(device, Command.START, T0 + 1.0, count=1)
    (record,) = records_until(device, T0 + 2.0)
    assert (record.rdt_sequence, record.ft_sequence) == (1, 7000)


def test_second_start_resets_counter() -> None:
    device = box()
    streamed(device)
    records = streamed(device, begin=T0 + 0.02)
    assert records[0].rdt_sequence == 1
    ask(device, Command.STOP, T0 + 0.05)
    assert records_until(device, T0 + 1.0) == []


def test_buffered_records_arrive_together() -> None:
    device = box(buffered_records=5)
    ask(device, Command.START_BUFFERED, T0, count=12)
    sizes = []
    while (due := device.endpoint.next_deadline()) is not None:
        device.endpoint.handle_deadline(due)
        sizes += [len(datagram) // 36 for datagram in device.endpoint.data_to_send(due)]
    assert sizes == [5, 5, 2]


def test_bias_zeroes_load_and_keeps_stream() -> None:
    device = box()
    before = streamed(device)[-1]
    ask(device, Command.BIAS, T0 + 0.02)
    after = records_until(device, T0 + 0.03)
    assert {record.counts for record in after} == {(0,) * 6}
    assert after[0].rdt_sequence == before.rdt_sequence + 1
    assert device.bias.tolist() == pytest.approx(np.array(LOAD) * 1e6)


def test_bias_between_late_records_affects_neither() -> None:
    device = box(lambda times: np.outer(times - T0, np.ones(6)))
    ask(device, Command.START, T0)
    device.endpoint.receive([encode_request(Command.BIAS)], T0 + 0.0105)  # nothing was sent for ten periods
    records = [decode_record(datagram) for datagram in device.endpoint.data_to_send(T0 + 0.0105)]
    assert [record.rdt_sequence for record in records] == list(range(1, 12))
    assert records[-1].counts[0] > 0
    assert records_until(device, T0 + 0.0115)[0].counts[0] == pytest.approx(1000, abs=500)


def test_bias_may_end_stream() -> None:
    device = box(bias_stops_stream=True)
    streamed(device)
    ask(device, Command.BIAS, T0 + 0.02)
    assert records_until(device, T0 + 1.0) == []


@given(st.lists(st.binary(max_size=20), max_size=10))
def test_invalid_request_gets_no_answer(data: list[bytes]) -> None:
    device = box()
    device.endpoint.receive(
        [one for one in data if one[:4] not in (b"\x12\x34\x00\x02", b"\x12\x34\x00\x03")], T0
    )
    assert records_until(device, T0 + 0.1) == []


@pytest.mark.parametrize("datagram", ["1234000200000000ff", "123480020000000000000000", "1234000400000000"])
def test_refused_requests_get_no_answer(datagram: str) -> None:
    device = box()
    device.endpoint.receive([bytes.fromhex(datagram)], T0)
    assert records_until(device, T0 + 0.1) == []


def test_box_ignores_requests_while_booting_or_off() -> None:
    device = box(boot_s=1.0)
    assert streamed(device) == []
    assert streamed(device, begin=T0 + 1.0)
    assert streamed(box(rdt_enabled=False)) == []


def test_filter_smooths_step_with_its_delay() -> None:
    def step(times: Floats) -> Floats:
        return np.outer(np.where(times >= T0 + 0.1, 10.0, 0.0), np.ones(6))

    device = box(step, filter=4, rate_hz=7000)
    ask(device, Command.START, T0)
    forces = {record.ft_sequence: record.counts[0] * 1e-6 for record in records_until(device, T0 + 0.2)}
    assert forces[690] == 0.0
    assert forces[699 + 14] == pytest.approx(10.0 * (1.0 - np.exp(-1.0)), rel=0.06)  # 2.18 ms
    assert forces[1300] == pytest.approx(10.0, rel=1e-3)


def test_noise_depends_on_sample_number() -> None:
    one, other = (box(noise_n=0.1) for _ in range(2))
    first, second = streamed(one), streamed(other, begin=T0 + 0.007)
    by_number = {record.ft_sequence: record.counts for record in first}
    common = [record for record in second if record.ft_sequence in by_number]
    assert len(common) > 5
    assert all(by_number[record.ft_sequence] == record.counts for record in common)
    assert np.std([record.counts[0] for record in first]) == pytest.approx(1e5, rel=0.5)


# --- strangers

MINE, OTHER = ("10.0.0.1", 5000), ("10.0.0.2", 5000)


def ask_from(side: tuple[str, int], device: NetBox, command: Command, now: float) -> None:
    device.endpoint.receive([Datagram(encode_request(command), side=side)], now)


def sides(device: NetBox, until: float) -> list[object]:
    result: list[object] = []
    while (due := device.endpoint.next_deadline()) is not None and due <= until:
        device.endpoint.handle_deadline(due)
        result += [side_of(datagram) for datagram in device.endpoint.data_to_send(due)]
    return result


def test_start_of_other_client_takes_stream() -> None:
    device = box()
    ask_from(MINE, device, Command.START, T0)
    assert set(sides(device, T0 + 0.02)) == {MINE}
    ask_from(OTHER, device, Command.START, T0 + 0.02)
    device.endpoint.data_to_send(T0 + 0.02)
    assert set(sides(device, T0 + 0.04)) == {OTHER}


def test_bias_of_other_client_keeps_stream() -> None:
    device = box()
    ask_from(MINE, device, Command.START, T0)
    sides(device, T0 + 0.02)
    ask_from(OTHER, device, Command.BIAS, T0 + 0.02)
    device.endpoint.receive([Datagram(b"nonsense", side=OTHER)], T0 + 0.02)
    assert set(sides(device, T0 + 0.04)) == {MINE}
    assert device.bias.tolist() == pytest.approx(np.array(LOAD) * 1e6)


@pytest.mark.parametrize("may_stop", [True, False])
def test_stop_of_other_client_may_end_stream(may_stop: bool) -> None:
    device = box(stranger_may_stop=may_stop)
    ask_from(MINE, device, Command.START, T0)
    sides(device, T0 + 0.02)
    ask_from(OTHER, device, Command.STOP, T0 + 0.02)
    device.endpoint.data_to_send(T0 + 0.02)
    assert bool(sides(device, T0 + 0.04)) is not may_stop
    ask_from(MINE, device, Command.STOP, T0 + 0.05)
    device.endpoint.data_to_send(T0 + 0.05)
    assert sides(device, T0 + 0.1) == []


# --- saturation and faults


def test_saturation_is_reported_for_some_more_samples() -> None:
    def blow(times: Floats) -> Floats:
        hit = (times >= T0 + 0.010) & (times < T0 + 0.012)
        return np.outer(np.where(hit, 2000.0, 1.0), np.ones(6))

    records = streamed(box(blow), 0.03)
    bits = [bool(record.status & SATURATED) for record in records]
    assert records[11].counts[2] == round(400e6 * 2.6)
    assert bits.index(True) in (9, 10)
    assert sum(bits) in range(5, 9)  # 2 ms, and 32 samples
    assert not bits[-1]


def test_unplugged_transducer_freezes_counts_with_status() -> None:
    device = box(lambda times: np.outer(times - T0, np.ones(6)))
    streamed(device)
    injection = ledger(device).inject("sensor", "unplugged", T0 + 0.02, {})
    records = records_until(device, T0 + 0.03)
    assert {record.status for record in records} == {0x88000010}
    assert len({record.counts for record in records}) == 1
    assert injection.struck >= len(records)


def test_each_fault_has_effect() -> None:
    def with_fault(target: str, fault: str, **parameters: object) -> list[Record]:
        device = box()
        streamed(device)
        injection = ledger(device).inject(target, fault, T0 + 0.02, parameters)
        records = records_until(device, T0 + 0.2)
        device.endpoint.data_to_send(T0 + 0.2)
        assert injection.struck or fault in ("wrong", "noise"), fault
        return records

    assert {record.counts[2] for record in with_fault("signal", "scale", axis="fz", factor=0.5)[1:]} == {
        1500000
    }
    assert {record.counts[2] for record in with_fault("signal", "dead", axis="fz")[1:]} == {0}
    assert len(with_fault("sensor", "slow", factor=10.0)) == 18
    assert len({record.ft_sequence for record in with_fault("sensor", "frozen-counter")}) == 1
    assert {record.status for record in with_fault("sensor", "status", bit=8)[1:]} == {0x80000100}
    assert {record.status for record in with_fault("sensor", "threshold")[1:]} == {0x80010000}
    assert with_fault("sensor", "taken") == []
    assert with_fault("sensor", "power-cycle") == []
    assert with_fault("sensor-wire", "off") == []
    assert {record.counts for record in with_fault("sensor", "biased")[1:]} == {(0,) * 6}
    assert len([record for record in with_fault("sensor", "saturated") if record.status]) in range(48, 53)
    assert len(with_fault("sensor-wire", "twice", probability=1.0)) == 360
    with pytest.raises(ValueError, match=r"no noise; set cell\.netft\.noise_n"):
        with_fault("signal", "noise")


def test_latch_can_be_reset() -> None:
    device = box(family="axia")
    streamed(device)
    ledger(device).inject("sensor", "threshold", T0 + 0.02, {})
    assert records_until(device, T0 + 0.03)[-1].status == 0x00010000
    ask(device, Command.RESET_LATCH, T0 + 0.03)
    assert records_until(device, T0 + 0.04)[-1].status == 0


@pytest.mark.parametrize(
    ("fault", "parameters", "status"),
    [
        ("saturated", {}, 0x88000000),
        ("unplugged", {}, 0x80000004),
        ("status", {"bit": 3}, 0x80000008),
        ("status", {"bit": 28}, 0x10000000),
        ("status", {"bit": 0}, 0x80000001),
        ("status", {"bit": 29}, 0xA0000000),
    ],
)
def test_axia_faults_set_bits_of_manual(fault: str, parameters: dict[str, object], status: int) -> None:
    device = box(family="axia")
    streamed(device)
    ledger(device).inject("sensor", fault, T0 + 0.02, parameters)
    assert records_until(device, T0 + 0.03)[-1].status == status


@pytest.mark.parametrize(
    ("load", "status"),
    [
        ((130.0, 0.0, 0.0, 0.0, 0.0, 0.4), 0),
        ((130.0, 0.0, 0.0, 0.0, 0.0, 0.6), 0xC0000000),
        ((0.0, 0.0, 430.0, 0.0, 0.0, 0.0), 0xC0000000),
    ],
)
def test_axia_load_beyond_ratings_is_out_of_range(load: tuple[float, ...], status: int) -> None:
    assert streamed(box(steady(load), family="axia"))[-1].status == status
    assert streamed(box(steady(load)))[-1].status == 0


def test_axia_samples_at_set_rate() -> None:
    device = box(family="axia", rate_hz=976)
    page = read_answer(get(device, "/netftapi2.xml")) or b""
    assert b"<runrate>7812</runrate><setrate>7812</setrate>" in page
    before = streamed(device, 0.1)
    assert {b.ft_sequence - a.ft_sequence for a, b in itertools.pairwise(before)} == {8}
    for refused in (1000, 7000, 0):
        get(device, f"/setting.cgi?setadcrate={refused}", T0 + 0.1)
    assert device.adc_rate_hz == 7812
    get(device, "/setting.cgi?setadcrate=976", T0 + 0.1)
    assert parse_page(read_answer(get(device, "/netftapi2.xml", T0 + 0.1)) or b"").internal_rate_hz == 976
    after = records_until(device, T0 + 0.2)
    assert {b.ft_sequence - a.ft_sequence for a, b in itertools.pairwise(after)} == {1}
    assert len(after) == pytest.approx(97, abs=1)
    at = device.sampled_at(after[-1].ft_sequence)
    assert at == pytest.approx(T0 + 0.2, abs=0.0015)
    assert after[0].ft_sequence > before[-1].ft_sequence
    netbox = box()
    get(netbox, "/setting.cgi?setadcrate=976")
    assert netbox.adc_rate_hz == 7000


@pytest.mark.parametrize(("persistent", "bias"), [(True, 1e6), (False, 0.0)])
def test_power_cycle_resets_counter(persistent: bool, bias: float) -> None:
    device = box(boot_s=1.0, bias_persistent=persistent)
    assert streamed(device, begin=T0 + 1.0)
    ask(device, Command.BIAS, T0 + 2.0)
    ledger(device).inject("sensor", "power-cycle", T0 + 3.0, {})
    assert streamed(device, begin=T0 + 3.5) == []
    records = streamed(device, begin=T0 + 4.0)
    assert records[0].ft_sequence == pytest.approx(7000, abs=7)
    assert records[0].counts[0] == pytest.approx(1e6 - bias)


# --- pages


def get(device: NetBox, path: str, now: float = T0) -> bytes:
    result = answer(encode_get("box", path), device, now)
    assert result is not None
    return result


def test_page_describes_counts() -> None:
    result = parse_page(read_answer(get(box(rate_hz=2000), "/netftapi2.xml")) or b"")
    assert result.scales == pytest.approx((1e-6,) * 6)
    assert result.ratings == pytest.approx((130.0, 130.0, 400.0, 10.0, 10.0, 10.0))
    assert result.period == pytest.approx(3 / 7000)
    assert b"<calsn>" in get(box(), "/netftcalapi.xml?index=0")
    assert get(box(), "/nothing").startswith(b"HTTP/1.1 404")


def test_wrong_scale_changes_page_only() -> None:
    device = box()
    ledger(device).inject("sensor", "wrong-scales", T0, {"factor": 0.5, "of": "forces"})
    result = parse_page(read_answer(get(device, "/netftapi2.xml")) or b"")
    assert result.scales == pytest.approx((0.5e-6,) * 3 + (1e-6,) * 3)


def test_forms_change_settings_and_ignore_unknown_fields() -> None:
    device = box()
    get(device, "/comm.cgi?comrdtrate=7000&comrdtbsiz=8")
    get(device, "/setting.cgi?setuserfilter=3&setbias2=1000000")
    assert (device.rate_hz, device.buffered_records, device.filter.number) == (7000.0, 8, 3)
    assert streamed(device)[-1].counts[2] == 2000000
    for query in (
        "comm.cgi?commrdtrate&1000",
        "comm.cgi?comrdtrate=0&comrdtbsiz=99&comrdte=7",
        "comm.cgi?setuserfilter=5",
        "setting.cgi?setuserfilter=99&setbias9=1&setbias0=inf&setbias1=1e400",
        "setting.cgi?setbias0=111111111111111111111111",
        "config.cgi?cfgid=0&cfgfu=9",
    ):
        assert get(device, f"/{query}").startswith(b"HTTP/1.1 200")
    assert (device.rate_hz, device.buffered_records, device.filter.number) == (7000.0, 8, 3)
    assert device.bias.tolist() == [0.0, 0.0, 1e6, 0.0, 0.0, 0.0]
    get(device, "/comm.cgi?comrdte=0")
    assert b"Disabled" in get(device, "/netftapi2.xml")
    ask(device, Command.STOP, T0 + 1.0)
    assert streamed(device, begin=T0 + 1.0)[:1] != []  # the stream under way continues


@given(st.binary(max_size=60))
def test_arbitrary_http_requests_raise_nothing(data: bytes) -> None:
    device = box()
    for request in (data, data + b"\r\n\r\n", b"GET " + data + b" HTTP/1.1\r\n\r\n"):
        answer(request, device, T0)


def test_booting_box_answers_no_http_request() -> None:
    device = box(boot_s=1.0)
    page = PageEndpoint(device)
    page.receive(encode_get("box"), T0 + 0.5)
    assert page.data_to_send(T0 + 0.5) == b""
    page.receive(encode_get("box"), T0 + 1.5)
    assert read_answer(page.data_to_send(T0 + 1.5)) is not None


@pytest.mark.parametrize(
    "settings",
    [
        {"rate_hz": 0},
        {"filter": 13},
        {"ratings_n": (1.0, 2.0)},
        {"family": "other"},
        {"noise_n": -1.0},
        {"adc_rate_hz": 976},
        {"family": "axia", "adc_rate_hz": 7000},
        {"rate_hz": 7812},
    ],
)
def test_invalid_settings_are_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="must be"):
        NetFtProfile(**settings)
