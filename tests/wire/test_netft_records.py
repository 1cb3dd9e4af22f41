"""Datagrams and page of a Net F/T: golden bytes, both directions, and arbitrary bytes."""

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.devices.netft import (
    Command,
    Record,
    decode_record,
    describe,
    encode_record,
    encode_request,
    parse_page,
)
from protocol.devices.netft.http import encode_answer, encode_get, read_answer, read_get
from protocol.devices.netft.page import filter_delay
from protocol.devices.netft.records import AXIA, NETBOX, decode_request, output_step
from protocol.endpoint import LocalProtocolError, RemoteProtocolError

RECORD = bytes.fromhex(
    "00000001 000004cb 00000000 00bc614e ffd9da60 fa271ce0 0016e360 fffc2f70 00000007".replace(" ", "")
)
PAGE = (
    b'<?xml version="1.0"?>\n<netft><prodname>Net F/T emulator</prodname><setuserfilter>0</setuserfilter>'
    b"<cfgnam>default</cfgnam><scfgfu>N</scfgfu><scfgtu>Nm</scfgtu><cfgcpf>1000000</cfgcpf>"
    b"<cfgcpt>1000000</cfgcpt><cfgmr>20;20;60;1;1;1</cfgmr><comrdte>Enabled</comrdte>"
    b"<comrdtrate>1000</comrdtrate></netft>"
)


@pytest.mark.parametrize(
    ("command", "count", "datagram"),
    [
        (Command.START, 0, "1234000200000000"),
        (Command.START, 1, "1234000200000001"),
        (Command.STOP, 0, "1234000000000000"),
        (Command.BIAS, 0, "1234004200000000"),
        (Command.RESET_LATCH, 0, "1234004100000000"),
    ],
)
def test_request_is_the_manuals_bytes_both_ways(command: Command, count: int, datagram: str) -> None:
    assert encode_request(command, count).hex() == datagram
    decoded = decode_request(bytes.fromhex(datagram))
    assert (decoded.command, decoded.records, decoded.extended) == (command, count, False)


def test_extended_request_is_distinguished() -> None:
    decoded = decode_request(bytes.fromhex("1234800200000000e0000580 6e5a".replace(" ", "")))
    assert (decoded.command, decoded.records, decoded.extended) == (2, 0, True)


@pytest.mark.parametrize(
    "datagram",
    [
        "",
        "12340002000000",
        "123400020000000000",
        "4321000200000000",
        "1234800200000000",
        "1234000200000000e00005806e5a",
    ],
)
def test_invalid_request_is_refused(datagram: str) -> None:
    with pytest.raises(RemoteProtocolError):
        decode_request(bytes.fromhex(datagram))


def test_oversized_count_is_refused() -> None:
    with pytest.raises(LocalProtocolError):
        encode_request(Command.START, 1 << 32)
    with pytest.raises(LocalProtocolError):
        encode_record(Record(1, 1, 0, (1 << 31, 0, 0, 0, 0, 0)))


def test_record_is_the_golden_bytes_both_ways() -> None:
    record = Record(1, 1227, 0, (12345678, -2500000, -98100000, 1500000, -250000, 7))
    assert encode_record(record) == RECORD
    assert decode_record(RECORD) == record


@given(st.binary(max_size=80))
def test_arbitrary_datagrams_raise_only_remote_errors(data: bytes) -> None:
    for decode in (decode_record, decode_request):
        with contextlib.suppress(RemoteProtocolError):
            decode(data)
    assert describe(data)


def test_datagrams_are_described() -> None:
    (first, second) = describe(RECORD + RECORD)
    assert (first["kind"], second["offset"], first["problems"]) == ("record", 36, [])
    (request,) = describe(bytes.fromhex("1234004200000000"))
    assert request["op"] == "bias"
    (unknown,) = describe(bytes.fromhex("1234009900000000"))
    assert unknown["problems"] == ["0099 is not a command"]
    assert describe(b"x")[0]["problems"]
    (page,) = describe(PAGE)
    assert (page["kind"], page["problems"]) == ("page", [])
    assert describe(PAGE.replace(b"<scfgfu>N<", b"<scfgfu>pond<"))[0]["fields"] == []


def test_record_status_is_described_for_both_families() -> None:
    (item,) = describe(encode_record(Record(1, 7, 0xC0000000, (0,) * 6)))
    meanings = {field["name"]: field["meaning"] for field in item["fields"]}  # type: ignore[attr-defined]
    assert meanings["status"] == "CPU or memory fault"
    assert meanings["status of an Axia"] == "force or torque out of range"
    (quiet,) = describe(encode_record(Record(1, 7, 0, (0,) * 6)))
    assert len(quiet["fields"]) == len(item["fields"]) - 1  # type: ignore[arg-type]


def test_status_is_described() -> None:
    assert NETBOX.words(0x88000010) == "serial link to the transducer, no data from the transducer"
    assert NETBOX.words(0x80000000) == "unnamed error"
    assert NETBOX.words(0) == ""
    assert [NETBOX.is_warning(status) for status in (0x80010000, 0x00010000, 0x80020000, 0x80030000)] == [
        True,
        True,
        False,
        False,
    ]


@pytest.mark.parametrize(
    ("status", "message", "harmless"),
    [
        (0x80000001, "temperature out of range", False),
        (0x80000002, "supply voltage out of range", False),
        (0x80000004, "broken gage", False),
        (0x80000008, "busy", True),
        (0x80000020, "other error", False),
        (0x80000080, "calibration not accessible", False),
        (0x00010000, "threshold passed", True),
        (0x88000000, "gage out of range", False),
        (0x10000000, "simulated error", True),
        (0xA0000000, "calibration checksum", False),
        (0xC0000000, "force or torque out of range", False),
        (0x80000000, "unnamed error", False),
        (0x90000000, "simulated error", False),
        (0x8000000A, "busy, supply voltage out of range", False),
    ],
)
def test_axia_status_has_the_manuals_meaning(status: int, message: str, harmless: bool) -> None:
    """Bit patterns: manual 9610-05-Ethernet Axia-09, table 4.9."""
    assert AXIA.words(status) == message
    assert AXIA.is_warning(status) is harmless


@pytest.mark.parametrize(("rate", "step"), [(1, 7000), (1000, 7), (2000, 3), (3000, 2), (6000, 1), (7000, 1)])
def test_rate_is_rounded_up(rate: int, step: int) -> None:
    assert output_step(rate) == step
    assert output_step(7000 // step) == step


# --- page


def test_page_gives_scales_and_rate() -> None:
    decoded = parse_page(PAGE)
    assert decoded.scales == pytest.approx((1e-6,) * 6)
    assert decoded.ratings == pytest.approx((20.0, 20.0, 60.0, 1.0, 1.0, 1.0))
    assert decoded.period == pytest.approx(0.001)
    assert (decoded.product, decoded.streams, decoded.delay) == ("Net F/T emulator default", True, 0.0)


@pytest.mark.parametrize(
    ("before", "after", "field", "value"),
    [
        (b"<scfgfu>N", b"<scfgfu>lbf", "scales", (4.4482216e-6,) * 3 + (1e-6,) * 3),
        (b"<scfgtu>Nm", b"<scfgtu>N-mm", "scales", (1e-6,) * 3 + (1e-9,) * 3),
        (b"<setuserfilter>0", b"<setuserfilter>4", "delay", 0.0021),
    ],
)
def test_other_units_and_filters(before: bytes, after: bytes, field: str, value: object) -> None:
    assert getattr(parse_page(PAGE.replace(before, after)), field) == pytest.approx(value, rel=0.02)


def test_optional_tags_of_a_page_may_be_missing() -> None:
    decoded = parse_page(PAGE.replace(b"cfgmr", b"other").replace(b"comrdtrate", b"another"))
    assert (decoded.ratings, decoded.period) == (None, None)
    assert not parse_page(PAGE.replace(b"Enabled", b"Disabled")).streams
    assert filter_delay(99) == 0.0


@pytest.mark.parametrize(
    "row", [b"20,20,60,1,1,1", b"20, 20, 60, 1, 1, 1", b"20 20 60 1 1 1", b"20;20;60;1;1;1;"]
)
def test_full_scales_are_read_with_any_separator(row: bytes) -> None:
    decoded = parse_page(PAGE.replace(b"20;20;60;1;1;1", row))
    assert decoded.ratings == pytest.approx((20.0, 20.0, 60.0, 1.0, 1.0, 1.0))


@pytest.mark.parametrize("row", [b"20;20;60", b"20;20;60;1;1;much", b"20;20;60;1;1;0", b"", b"2" * 200])
def test_unreadable_full_scales_are_unknown(row: bytes) -> None:
    assert parse_page(PAGE.replace(b"20;20;60;1;1;1", row)).ratings is None


def test_period_follows_the_internal_rate_of_the_page() -> None:
    axia = PAGE.replace(b"</netft>", b"<setrate>976</setrate></netft>")
    decoded = parse_page(axia)
    assert (decoded.internal_rate_hz, decoded.period) == (976.0, pytest.approx(1 / 976))


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        (b"<netft>", b"<html>", "not from a Net F/T"),
        (b'<?xml version="1.0"?>', b"<!DOCTYPE netft>", "not from a Net F/T"),
        (b"<scfgfu>N<", b"<scfgfu>pond<", "unit 'pond'"),
        (b"<cfgcpf>1000000", b"<cfgcpf>0", "not a number above 0"),
        (b"<cfgcpf>1000000", b"<cfgcpf>inf", "not a number above 0"),
        (b"<cfgcpf>1000000", b"<cfgcpf>nan", "not a number above 0"),
        (b"<cfgcpf>1000000", b"<cfgcpf>much", "not a number above 0"),
        (b"<prodname>Net F/T emulator", b"<prodname>", "does not contain prodname"),
        (b"</prodname>", b"</prodname><cfgcpf>2</cfgcpf>", "contains cfgcpf 2 times"),
        (b"Net F/T emulator", b"x" * 200, "invalid value"),
        (b"</netft>", b" " * 66000, "more than 65536"),
    ],
)
def test_invalid_page_is_refused(before: bytes, after: bytes, message: str) -> None:
    with pytest.raises(RemoteProtocolError, match=message):
        parse_page(PAGE.replace(before, after))


@given(st.binary(max_size=300), st.integers(0, len(PAGE)))
def test_arbitrary_pages_raise_only_remote_errors(data: bytes, at: int) -> None:
    for page in (data, PAGE[:at] + data + PAGE[at:], PAGE[:at]):
        assert describe(page) or not page
        with contextlib.suppress(RemoteProtocolError):
            parse_page(page)


# --- HTTP


def test_get_and_its_answer() -> None:
    get = encode_get("127.0.0.1:80")
    assert read_get(get[:-1]) is None
    assert read_get(get) == "/netftapi2.xml"
    answer = encode_answer(PAGE)
    assert [read_answer(answer[:cut]) for cut in (5, 60, len(answer) - 1)] == [None] * 3
    assert read_answer(answer) == read_answer(answer + b"more") == PAGE
    assert read_answer(b"HTTP/1.0 200 OK\r\n\r\nbody") is None
    assert read_answer(b"HTTP/1.0 200 OK\r\n\r\nbody", ended=True) == b"body"


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (b"HTTP/1.1 302 Found\r\nLocation: /\r\n\r\n", "'302' instead of 200"),
        (b"SSH-2.0-box\r\n\r\n", "does not use HTTP"),
        (b"HTTP/1.1 200 OK\r\n", "truncated"),
        (b"HTTP/1.1 200 OK\r\nContent-Length: 5\r\n\r\nabc", "truncated"),
        (b"x" * 9000, "too long"),
        (b"HTTP/1.1 200 OK\r\n\r\n" + b"x" * 70000, "too long"),
    ],
)
def test_invalid_response_is_refused(answer: bytes, message: str) -> None:
    with pytest.raises(RemoteProtocolError, match=message):
        read_answer(answer, ended=True)


@pytest.mark.parametrize("request_", [b"POST / HTTP/1.1\r\n\r\n", b"GET /\r\n\r\n", b"x" * 9000])
def test_invalid_get_is_refused(request_: bytes) -> None:
    with pytest.raises(RemoteProtocolError):
        read_get(request_)


@given(st.binary(max_size=200), st.booleans())
def test_arbitrary_http_raises_only_remote_errors(data: bytes, ended: bool) -> None:
    for read in (lambda: read_answer(data, ended), lambda: read_get(data + b"\r\n\r\n")):
        with contextlib.suppress(RemoteProtocolError):
            read()


def test_reason_for_a_missing_page_is_no_request() -> None:
    (item,) = describe(b"no answer from 192.168.1.1 port 80")
    assert (item["kind"], item["problems"]) == ("page", ["no answer from 192.168.1.1 port 80"])
