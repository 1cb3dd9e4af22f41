"""Blocks and the scanner against the golden blocks of the computer-link specification, section 4."""

from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.devices.s3.adlp import (
    BLOCK_OVERHEAD,
    Block,
    BlockFormat,
    BlockScanner,
    Control,
    Flaw,
    Noise,
    encode_block,
)

# Specification section 4, whole-length style.
GOLDEN = {
    "read status": "10 02 00 08 01 00 13 01 00 00 10 03 18",
    "stop program": "10 02 00 08 01 00 03 01 00 00 10 03 08",
    "write mode, operation": "10 02 00 08 01 00 14 01 00 01 10 03 1E",
}
HOST = BlockFormat("off", ("whole",), 128)
ROBOT = BlockFormat("off", ("whole", "data"), 128)
DOUBLED = BlockFormat("double", ("whole", "data"), 128)


def telegram(data: bytes, style: str = "whole") -> bytes:
    length = len(data) + (8 if style == "whole" else 0)
    return length.to_bytes(2, "big") + bytes.fromhex("01 00 18 01 00 00") + data


telegrams = st.builds(
    telegram,
    st.one_of(
        st.binary(max_size=120),
        st.lists(st.sampled_from(b"\x10\x03\x02\x05"), max_size=120).map(bytes),
    ),
)


@pytest.mark.parametrize("name", GOLDEN)
def test_golden_block_is_written_and_read(name):
    block = bytes.fromhex(GOLDEN[name])
    raw = block[2:-3]
    assert encode_block(raw) == block
    assert HOST.decode(block) == Block(raw, 0x02, 13)
    assert ROBOT.decode(block) == Block(raw, 0x02, 13)


@given(telegrams, st.sampled_from((0x02, 0x82)), st.sampled_from((HOST, ROBOT, DOUBLED)))
@settings(max_examples=150)
def test_round_trip(raw, stx, form):
    block = encode_block(raw, form.stuffing, stx)
    if form is ROBOT and (raw.count(b"\x10\x03") > 1):
        return  # two length styles may meet two trailers; the next test has the rule
    assert form.decode(block) == Block(raw, stx, len(block))


@pytest.mark.parametrize("style", ["whole", "data"])
def test_robot_accepts_both_length_styles_and_host_only_whole(style):
    raw = telegram(bytes(range(0x20, 0x4C)), style)
    block = encode_block(raw)
    assert ROBOT.decode(block) == Block(raw, 2, 57)
    assert isinstance(HOST.decode(block), Block if style == "whole" else Flaw)


def test_robot_waits_if_the_shorter_block_has_a_wrong_checksum():
    # Data length 12: at byte 12 of the telegram stands a DLE ETX that is data.
    raw = telegram(bytes.fromhex("41 42 43 44 10 03 45 46 47 48 49 4A"), "data")
    block = encode_block(raw)
    for cut in range(len(block)):
        assert ROBOT.decode(block[:cut]) is None
    assert ROBOT.decode(block) == Block(raw, 2, 25)


def test_robot_reports_a_wrong_check_once_no_reading_is_left():
    block = bytearray(encode_block(telegram(b"1234")))
    block[-1] ^= 1
    assert ROBOT.decode(bytes(block)) is None
    result = ROBOT.decode(bytes(block) + bytes(8))
    assert isinstance(result, Flaw)
    assert (result.whole, result.size) == (True, 17)


def test_block_with_dle_etx_is_framed_by_its_length():
    raw = telegram(bytes.fromhex("10 03 99 10 03"))
    assert HOST.decode(encode_block(raw)) == Block(raw, 2, 18)


def test_check_character_of_10_is_not_doubled():
    for last in range(256):
        raw = telegram(bytes([last]))
        block = encode_block(raw, "double")
        if block[-1] == 0x10:
            assert block[-3:] == b"\x10\x03\x10"
            assert DOUBLED.decode(block) == Block(raw, 2, len(block))
            return
    pytest.fail("no telegram with this check character")


@pytest.mark.parametrize(
    ("form", "block", "where"),
    [
        (HOST, "10 03", 1),
        (HOST, "10 02 00 07", 2),
        (HOST, "10 02 00 81", 2),
        (ROBOT, "10 02 FF FF", 2),
        (HOST, "10 02 00 08 01 00 13 01 00 00 11 03 18", 10),
        (HOST, "10 02 00 08 01 00 13 01 00 00 10 03 19", 12),
        (DOUBLED, "10 02 00 08 10 00", 4),
        (DOUBLED, "10 02" + "00" * 129, 2),
        (DOUBLED, "10 02" + "10 10" * 129, 2),
        (DOUBLED, "10 02 00 08 01 00 13 01 00 00 10 03 19", 12),
        (DOUBLED, "10 02 00 08 10 03 0B", 2),
    ],
)
def test_flaw_has_its_offset(form, block, where):
    result = form.decode(bytes.fromhex(block))
    assert isinstance(result, Flaw)
    assert result.at == where
    assert result.text


def tokens(form, pieces):
    scanner = BlockScanner(form)
    out = []
    for piece in pieces:
        for token in scanner.feed(piece):
            if isinstance(token, Noise) and out and isinstance(out[-1], Noise):
                out[-1] = Noise(out[-1].data + token.data)
            else:
                out.append(token)
        assert scanner.pending <= 2 * 128 + BLOCK_OVERHEAD
    return out, scanner.pending


def cuts(data, places):
    edges = sorted({0, len(data), *(p % (len(data) + 1) for p in places)})
    return [data[a:b] for a, b in pairwise(edges)]


stream = st.lists(
    st.one_of(
        telegrams.map(encode_block),
        telegrams.map(lambda raw: encode_block(raw, "double", 0x82)),
        st.binary(max_size=20),
        st.sampled_from([b"\x05", b"\x06", b"\x04", b"\x10", b"\x10\x02", b"\x10\x02\x00\x20"]),
    ),
    max_size=5,
).map(b"".join)


@given(stream, st.lists(st.integers(0, 500), max_size=8), st.sampled_from((HOST, ROBOT, DOUBLED)))
@settings(max_examples=150)
def test_any_split_gives_the_same_tokens(data, places, form):
    complete = tokens(form, [data])
    assert tokens(form, cuts(data, places)) == complete
    assert tokens(form, [data[i : i + 1] for i in range(len(data))]) == complete


@given(st.binary(max_size=40).filter(lambda b: 0x10 not in b), telegrams)
@settings(max_examples=100)
def test_garbage_then_valid_recovers(garbage, raw):
    out, pending = tokens(HOST, [garbage + encode_block(raw)])
    assert out[-1] == Block(raw, 2, len(raw) + BLOCK_OVERHEAD)
    assert pending == 0


@given(st.binary(max_size=300), st.sampled_from((HOST, ROBOT, DOUBLED)))
@settings(max_examples=150)
def test_arbitrary_bytes_are_all_accounted_for(data, form):
    out, pending = tokens(form, [data])
    sizes = sum(1 if isinstance(t, Control) else len(t.data) if isinstance(t, Noise) else t.size for t in out)
    assert sizes + pending == len(data)


def test_unfinished_block_can_be_dropped():
    scanner = BlockScanner(HOST)
    assert scanner.feed(bytes.fromhex("10 02 00 08 01")) == []
    assert scanner.drop() == 5
    assert scanner.feed(b"\x05") == [Control.ENQ]


def test_receiver_may_end_a_block_at_the_first_trailer():
    """The length is then ignored, and 10 03 inside the data ends the block early."""
    cut = BlockFormat("off", ("whole", "data"), 128, "trailer")
    plain = telegram(bytes.fromhex("41 42 43 44"))
    assert cut.decode(encode_block(plain)) == Block(plain, 2, len(plain) + 5)
    assert cut.decode(encode_block(plain)[:-1]) is None
    holding = encode_block(telegram(bytes.fromhex("41 10 03 44")))
    result = cut.decode(holding)
    assert isinstance(result, Flaw)
    assert result.whole
    assert result.size < len(holding)
    assert isinstance(cut.decode(b"\x10\x02" + bytes(130)), Flaw)
    assert cut.decode(b"\x10\x02" + bytes(129)) is None
