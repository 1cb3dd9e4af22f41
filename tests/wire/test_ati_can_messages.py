"""Frames of a NETCANOEM board: golden bytes, both directions, and arbitrary bytes."""

from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.can.frame import CanFrame
from protocol.devices.ati_can import describe, heard
from protocol.devices.ati_can.messages import (
    BASE,
    CRITICAL,
    Op,
    decode_counts,
    decode_firmware,
    decode_pair,
    decode_sample,
    decode_sample_rest,
    decode_units,
    describe_status_bits,
    encode_counts,
    encode_row,
    encode_sample,
    question,
)
from protocol.endpoint import LocalProtocolError, RemoteProtocolError

GAGES = (1000, -2000, 3000, -4000, 5000, -6000)
FX = (
    -11.6928025731666,
    -3.34657738404844,
    32.7764709067651,
    -926.64603423617,
    38.5192497186425,
    918.091940090325,
)
TX = (
    0.37477300521384,
    6.04214878084067,
    -22.5165000555478,
    -2.45353141451211,
    22.5514352819426,
    -3.19660800051747,
)


def text(*frames: CanFrame) -> list[str]:
    return [str(frame) for frame in frames]


def test_questions_are_the_golden_frames() -> None:
    assert text(
        question(BASE, Op.SAMPLE),
        question(BASE, Op.SLOT, 0),
        question(BASE, Op.ROW, 3),
        question(BASE, Op.RESET),
        question(BASE, Op.SET_RATE, 3),
    ) == ["200#", "206#00", "202#03", "20C#", "20E#03"]
    with pytest.raises(LocalProtocolError):
        question(BASE, Op.SLOT, 256)


@pytest.mark.parametrize(("status", "first"), [(0, "200#000003E80BB81388"), (0x8040, "200#804003E80BB81388")])
def test_sample_is_the_golden_frames_both_ways(status: int, first: str) -> None:
    one, two = encode_sample(BASE, status, GAGES)
    assert text(one, two) == [first, "201#F830F060E890"]
    assert decode_sample(one.data) == (status, GAGES[0::2])
    assert decode_sample_rest(two.data) == GAGES[1::2]
    with pytest.raises(LocalProtocolError):
        encode_sample(BASE, 0, (40000,) * 6)


def test_matrix_is_the_golden_frames_both_ways() -> None:
    fx = encode_row(BASE, FX)
    assert text(*fx) == ["202#C13B15B8C0562E53", "203#42031B1BC467A959", "204#421A13B6446585E2"]
    assert text(*encode_row(BASE, TX)) == [
        "202#3EBFE23F40C15948",
        "203#C1B421CBC01D06A9",
        "204#41B46957C04C953A",
    ]
    result = [value for frame in fx for value in decode_pair(frame.data)]
    assert result == pytest.approx(FX, rel=1e-7)


def test_other_responses_of_a_board_are_decoded() -> None:
    assert text(encode_counts(BASE, 1_000_000, 1_000_000)) == ["207#000F4240000F4240"]
    assert decode_counts(bytes.fromhex("000F4240000F4240")) == (1_000_000, 1_000_000)
    assert decode_units(b"\x02\x03") == (1.0, 1.0)
    assert decode_units(b"\x01\x04") == (pytest.approx(4.4482216), 1e-3)
    assert decode_firmware(bytes.fromhex("03080002")) == (3, 8, 2)


@pytest.mark.parametrize(
    ("decode", "data"),
    [
        (decode_sample, "0000"),
        (decode_sample_rest, "00"),
        (decode_pair, "7FC000003F800000"),
        (decode_pair, "7F8000003F800000"),
        (decode_counts, "0000000000000001"),
        (decode_units, "0009"),
        (decode_units, "02"),
        (decode_firmware, "0308"),
    ],
)
def test_invalid_values_are_refused(decode: object, data: str) -> None:
    assert callable(decode)
    with pytest.raises(RemoteProtocolError):
        decode(bytes.fromhex(data))


def test_status_is_described() -> None:
    assert describe_status_bits(0x8040) == "bad calibration"
    assert describe_status_bits(0x8000) == "unnamed error"
    assert describe_status_bits(0) == ""
    assert [bit for bit in range(16) if CRITICAL >> bit & 1] == [1, 2, 3, 4, 5, 6, 7, 11, 12]


def test_client_filters_for_one_board() -> None:
    (only,) = heard(BASE)
    assert [only.accepts(CanFrame(number)) for number in (0x1FF, 0x200, 0x20F, 0x210)] == [
        False,
        True,
        True,
        False,
    ]


@pytest.mark.parametrize(
    ("raw", "op", "name", "value"),
    [
        ("0200000003E80BB81388", "sample", "sg0", 1000),
        ("0201F830F060E890", "sample rest", "sg1", -2000),
        ("0202C13B15B8C0562E53", "row", "sg0", pytest.approx(-11.6928, rel=1e-5)),
        ("0204421A13B6446585E2", "row end", "sg4", pytest.approx(38.5192, rel=1e-5)),
        ("0207000F4240000F4240", "counts", "per force", 1_000_000),
        ("02080203", "units", "force", 1.0),
        ("020F03080002", "firmware", "minor", 8),
        ("020600", "slot", "slot", 0),
    ],
)
def test_frame_is_described(raw: str, op: str, name: str, value: object) -> None:
    (item,) = describe(bytes.fromhex(raw))
    assert (item["op"], item["problems"]) == (op, [])
    fields = item["fields"]
    assert isinstance(fields, list)
    assert value in [field["value"] for field in fields if field["name"] == name]


def test_frame_in_candump_format_is_described() -> None:
    assert describe(b"200#000003E80BB81388")[0]["op"] == "sample"
    assert describe(b"20A#")[0]["problems"] == ["A is not an operation"]
    assert describe(b"200#0000")[0]["problems"] == ["the first half of a sample has 8 bytes, got 2"]
    assert describe(b"xyz#zz")[0]["problems"]


@given(st.binary(max_size=14))
def test_arbitrary_bytes_raise_only_remote_errors(data: bytes) -> None:
    assert describe(data)
    assert describe(b"200#" + data)
    for decode in (
        decode_sample,
        decode_sample_rest,
        decode_pair,
        decode_counts,
        decode_units,
        decode_firmware,
    ):
        with suppress(RemoteProtocolError):
            decode(data)
