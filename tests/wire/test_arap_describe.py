"""Textual description of a capture; the blocks are those of the computer-link specification, sections 3 and 4."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.devices.s3.adlp import encode_block
from protocol.devices.s3.arap import Refusal, Telegram, describe, read_status, start_program

ASK = bytes.fromhex("10 02 00 08 01 00 13 01 00 00 10 03 18")
STATUS = encode_block(
    bytes.fromhex("0020 00 00 13 02 0000 0001 0002 0003 0004 08 0A 0FE9 E5DC 1487 0817 D455 0997 2D13")
)


def test_capture_of_a_status_transaction():
    items = describe(b"\x05\x06" + ASK + b"\x06\x04\x05\x06" + STATUS + b"\x06\x04")
    assert [item["kind"] for item in items] == ["control"] * 2 + ["block"] + ["control"] * 4 + ["block"] + [
        "control"
    ] * 2
    assert [item["offset"] for item in items] == [0, 1, 2, 15, 16, 17, 18, 19, 56, 57]
    assert (items[0]["name"], items[0]["meaning"]) == ("ENQ", "bid for the line")
    ask, answer = items[2], items[7]
    assert ask["direction"] == "PC → S3"
    assert ask["checksum"] == {"expected": "18", "got": "18", "right": True}
    assert ask["header"]["function_text"] == "read status"
    assert answer["direction"] == "S3 → PC"
    assert answer["meaning"] == "read status 0, response, 24 bytes of data"
    x = next(item for item in answer["fields"] if item["name"] == "x")
    assert (x["raw"], x["value"], x["unit"], x["mark"]) == (4073, 0.509125, "m", "observed")
    assert "problem" not in answer


def test_wrong_check_character_still_shows_the_telegram():
    (item,) = describe(ASK[:-1] + b"\x19")
    assert item["kind"] == "block"
    assert item["checksum"] == {"expected": "18", "got": "19", "right": False}
    assert item["problem_offset"] == 12
    assert item["header"]["function"] == 19


def test_both_length_styles_of_the_pc():
    raw = start_program(7).encode("data")
    (item,) = describe(encode_block(raw))
    assert item["fields"][0]["raw"] == 7


def test_doubled_dle():
    raw = Telegram(3, 1, 0, b"\x10\x03\x10").encode()
    (item,) = describe(encode_block(raw, "double"), "double")
    assert item["bytes"] == raw.hex(" ").upper()
    (item,) = describe(encode_block(raw, "double")[:-1] + b"\0", "double")
    assert item["bytes"] == raw.hex(" ").upper()
    assert not item["checksum"]["right"]
    # The length itself is 10h: the doubled byte must not be taken for the source.
    raw = Telegram(3, 1, 0, bytes(8)).encode()
    assert raw[1] == 0x10
    (item,) = describe(encode_block(raw, "double"), "double")
    assert item["direction"] == "PC → S3"


def test_refusal_is_described():
    (item,) = describe(encode_block(Refusal(13).to_telegram(read_status()).encode()))
    assert item["meaning"].endswith(": stop or emergency stop")


@pytest.mark.parametrize(
    ("text", "kind", "problem", "offset", "size"),
    [
        ("10 02 00 07 01 10 03 00 05", "error", "impossible length 7", 2, 8),
        ("10 02 00 07 01", "error", "impossible length 7", 2, 2),
        ("10 02 00 08 01 00 13", "error", "ends before", 7, 7),
        ("10 02 00 40 01 00 13 01 00 00 10 03 18 06", "error", "ends before", 14, 13),
        ("10 02 00 08 01 00 13 01 00 00 00 10 03 18", "error", "no DLE ETX", 10, 14),
    ],
)
def test_problem_is_described_with_its_offset(text, kind, problem, offset, size):
    item = describe(bytes.fromhex(text))[0]
    assert (item["kind"], item["problem_offset"], item["size"]) == (kind, offset, size)
    assert problem in item["problem"]


def test_unreadable_and_short_telegrams():
    (item,) = describe(encode_block(bytes.fromhex("00 08 00 07 13 02 00 00")))
    assert "byte 3" in item["problem"]
    (item,) = describe(encode_block(bytes.fromhex("00 08 00 00 13 02 00 00")))
    assert "status needs 24 bytes" in item["problem"]
    (item,) = describe(encode_block(bytes.fromhex("00 08 00 00 04 02 00 00")))
    assert (item["fields"], "problem" in item) == ([], False)


def test_noise_is_gathered():
    items = describe(b"\xff\x00\x10\x41\x05")
    assert [(item["kind"], item["offset"], item["size"]) for item in items] == [
        ("noise", 0, 4),
        ("control", 4, 1),
    ]
    assert items[0]["bytes"] == "FF 00 10 41"


pieces = st.one_of(st.binary(max_size=30), st.sampled_from([ASK, STATUS, b"\x05", b"\x10\x02", ASK[:-2]]))


@given(st.lists(pieces, max_size=6).map(b"".join), st.sampled_from(["off", "double"]))
@settings(max_examples=200)
def test_arbitrary_bytes_never_raise_and_are_all_described(raw, stuffing):
    at = 0
    for item in describe(raw, stuffing):
        assert item["offset"] == at
        assert item["meaning"]
        at += item["size"]
    assert at == len(raw)


def test_type_with_the_observed_flag_is_named_and_decoded():
    (item,) = describe(encode_block(Telegram(2, 0x11, 0, b"\x00\x07").encode()))
    assert item["header"]["type_text"] == "order with a flag of the observed client, effect unknown"
    assert item["fields"][0]["raw"] == 7
