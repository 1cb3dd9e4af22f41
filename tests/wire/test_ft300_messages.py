"""Bytes of an FT 300: golden bytes, both directions, and arbitrary bytes."""

from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.devices.ft300 import decode_message, describe, encode_message
from protocol.devices.ft300.messages import (
    READ,
    WRITE,
    StreamReader,
    crc16,
    decode_request,
    encode_exception,
    encode_read,
    encode_words,
    encode_write,
    encode_written,
    find_answer,
    request_size,
    signed,
    with_crc,
    words_of,
)
from protocol.endpoint import LocalProtocolError, RemoteProtocolError

COUNTS = (1234, -250, -9810, 150, -25, 7)
MESSAGE = bytes.fromhex("204ED20406FFAED99600E7FF070033B6")
NESTED = with_crc(bytes.fromhex("204E204E204E") + bytes(8))
"""A message whose forces look like headers."""


def test_crc_matches_modbus() -> None:
    assert crc16(b"123456789") == 0x4B37


def test_message_is_the_golden_bytes_both_ways() -> None:
    assert encode_message(COUNTS) == MESSAGE
    assert decode_message(MESSAGE) == COUNTS
    assert encode_message((0,) * 6) == bytes.fromhex("204E00000000000000000000000062AF")
    assert NESTED[-2:] == bytes.fromhex("FEF0")


@pytest.mark.parametrize(
    ("made", "golden"),
    [
        (encode_read(180, 1), "090300B40001C564"),
        (encode_read(180, 6), "090300B4000684A6"),
        (encode_read(190, 3), "090300BE000364A7"),
        (encode_read(500, 3), "090301F40003448D"),
        (encode_read(510, 4), "090301FE0004254D"),
        (encode_read(514, 1), "090302020001253A"),
        (encode_write(410, 0x0200), "0910019A0001020200CDCA"),
        (encode_words(READ, [1234, 0xFF06, 0xD9AE, 150, 0xFFE7, 7]), "09030C04D2FF06D9AE0096FFE70007DC91"),
        (encode_words(READ, [12, 0xFFDE, 0xFC1A]), "090306000CFFDEFC1AC651"),
        (encode_words(READ, [0x4654, 0x5300, 0, 0x04D2]), "09030846545300000004D2A096"),
        (encode_words(READ, [2021]), "09030207E59A3E"),
        (encode_exception(READ, 2), "0983024133"),
        (encode_exception(WRITE, 2), "0990024C03"),
    ],
)
def test_frames_are_the_golden_bytes(made: bytes, golden: str) -> None:
    assert made == bytes.fromhex(golden)


def test_question_is_read_back_and_answered() -> None:
    start = encode_write(410, 0x0200)
    assert [request_size(start[:n]) for n in (1, 6, 7)] == [None, None, 11]
    request = decode_request(start)
    assert (request.function, request.register, request.values) == (WRITE, 410, (0x0200,))
    assert encode_written(request) == bytes.fromhex("0910019A00012152")
    one = with_crc(bytes.fromhex("0906019A0200"))
    assert encode_written(decode_request(one)) == one
    assert decode_request(encode_read(180, 6))[:4] == (READ, 180, (), 6)


def test_response_is_extracted_after_other_bytes() -> None:
    answer = encode_words(READ, [7])
    result = find_answer(b"\x09\x03\x20" + answer + b"more", READ, 7)
    assert result is not None
    payload, end = result
    assert (words_of(bytes(payload) if isinstance(payload, bytes) else b""), end) == ((7,), 10)
    assert find_answer(b"\x20" + encode_exception(READ, 2), READ, 7) == (2, 6)
    assert find_answer(answer[:-1], READ, 7) is None
    assert [signed(word) for word in (0xFF06, 5)] == [-250, 5]


@pytest.mark.parametrize("payload", [b"", b"\x02\x01", b"\x03\x01\x02\x03"])
def test_answer_whose_count_is_wrong_is_refused(payload: bytes) -> None:
    with pytest.raises(RemoteProtocolError):
        words_of(payload)


def test_write_whose_count_is_wrong_is_refused() -> None:
    with pytest.raises(RemoteProtocolError):
        decode_request(with_crc(bytes.fromhex("0910019A0002020200")))


def test_oversized_values_are_refused() -> None:
    with pytest.raises(LocalProtocolError):
        encode_message((40000, 0, 0, 0, 0, 0))
    with pytest.raises(LocalProtocolError):
        encode_read(70000, 1)


@pytest.mark.parametrize("data", [MESSAGE[:-1], MESSAGE[:-1] + b"\0", b"x" * 16])
def test_invalid_message_is_refused(data: bytes) -> None:
    with pytest.raises(RemoteProtocolError):
        decode_message(data)


def test_header_inside_the_data_is_harmless() -> None:
    reader = StreamReader()
    assert reader.feed(NESTED * 3) == [(20000, 20000, 0, 0, 0, 0)] * 3
    # It may begin inside of a message whose forces look like headers.
    assert StreamReader().feed(NESTED[2:] + NESTED + MESSAGE) == [(20000, 20000, 0, 0, 0, 0), COUNTS]
    assert reader.noises == 0


@given(st.lists(st.one_of(st.just(MESSAGE), st.just(NESTED), st.binary(max_size=20)), max_size=12), st.data())
def test_any_split_of_the_bytes_gives_the_same_messages(parts: list[bytes], data: st.DataObject) -> None:
    raw = b"".join(parts)
    complete, pieces, at = StreamReader(), StreamReader(), 0
    result: list[tuple[int, ...]] = []
    while at < len(raw):
        size = data.draw(st.integers(1, 30))
        result += pieces.feed(raw[at : at + size])
        at += size
    assert result == complete.feed(raw)
    assert pieces.noises == complete.noises


@given(st.integers(0, 15), st.binary(max_size=40))
def test_reader_resynchronises_after_noise(cut: int, noise: bytes) -> None:
    result = StreamReader().feed(MESSAGE[cut:] + noise + MESSAGE * 4)
    assert result[-2:] == [COUNTS] * 2


@given(st.binary(max_size=60))
def test_arbitrary_bytes_raise_only_remote_errors(data: bytes) -> None:
    with suppress(RemoteProtocolError):
        decode_message(data)
    find_answer(data, READ, 17)
    items = describe(data)
    assert sum(int(str(item["size"])) for item in items) == len(data)
    describe(with_crc(b"\x09\x10" + data))


def test_line_is_described() -> None:
    raw = (
        b"\x01"
        + MESSAGE
        + encode_write(410, 0x0200)
        + bytes.fromhex("0910019A00012152")
        + encode_read(180, 6)
        + encode_words(READ, [1, 2])
        + encode_exception(READ, 2)
        + b"\xff" * 5
    )
    assert [item["kind"] for item in describe(raw)] == [
        "noise",
        "message",
        "write",
        "written",
        "read",
        "words",
        "exception: unknown register",
        "stop",
    ]
    fields = describe(MESSAGE)[0]["fields"]
    assert isinstance(fields, list)
    assert [(field["value"], field["unit"]) for field in fields][:2] == [
        (pytest.approx(12.34), "N"),
        (pytest.approx(-2.5), "N"),
    ]
