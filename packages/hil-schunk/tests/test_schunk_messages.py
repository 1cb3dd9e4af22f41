"""Messages and packets. Source of the bytes: the maker's tests and stand-in, unless noted otherwise."""

import struct
from contextlib import suppress

import pytest
from hil_schunk.describe import describe
from hil_schunk.messages import (
    FIRMWARE,
    PRODUCT_NAME,
    Answer,
    Command,
    Message,
    MessageReader,
    Packet,
    Parameter,
    decode_answer,
    decode_packet,
    encode_answer,
    encode_command,
    encode_message,
    encode_packet,
    encode_read,
    status_words,
)
from hypothesis import given
from hypothesis import strategies as st

from protocol.endpoint import LocalProtocolError, RemoteProtocolError

PACKET_BYTES = bytes.fromhex(
    "ffff 2a00 1d00 01 00000000 0000803f 66660640 33335340 0ad7233d 2fdd8ac1 0c02b841"
)
"""Counter 42, second counter 1, status 0 and the values 1.0, 2.1, 3.3, 0.04, −17.358, 23.001 of the maker's tests."""


def test_packet_in_golden_bytes() -> None:
    packet = decode_packet(PACKET_BYTES)
    assert packet[:3] == (42, 1, 0)
    assert packet.wrench == pytest.approx((1.0, 2.1, 3.3, 0.04, -17.358, 23.001), rel=1e-7)
    assert encode_packet(packet) == PACKET_BYTES
    assert len(PACKET_BYTES) == 35


@pytest.mark.parametrize(
    ("payload", "data"),
    [
        (encode_command(Command.TARE), "ffff 0000 0100 12"),
        (encode_command(Command.SELECT_FILTER, 2), "ffff 0000 0200 31 02"),
        (encode_read(PRODUCT_NAME), "ffff 0000 0400 f0 0100 00"),
        (encode_read(FIRMWARE), "ffff 0000 0400 f0 0210 01"),
    ],
)
def test_requests_in_golden_bytes(payload: bytes, data: str) -> None:
    assert encode_message(0, payload) == bytes.fromhex(data)
    assert MessageReader().feed(bytes.fromhex(data)) == [Message(0, payload)]


def test_answers_in_golden_bytes() -> None:
    read, command = bytes.fromhex("f0 00 0100 00 1234"), bytes.fromhex("12 00")
    assert decode_answer(read) == Answer(0xF0, 0, b"\x12\x34")
    assert encode_answer(Answer(0xF0, 0, b"\x12\x34"), Parameter(1, 0)) == read
    assert encode_message(5, command) == bytes.fromhex("ffff 0500 0200 1200")
    assert decode_answer(bytes.fromhex("f0 03 0100 00")) == Answer(0xF0, 3)


@given(
    st.integers(0, 65535),
    st.integers(0, 255),
    st.integers(0, 2**32 - 1),
    st.tuples(*[st.floats(-1e6, 1e6, width=32)] * 6),
)
def test_packet_round_trip(
    counter: int, packet_id: int, status: int, wrench: tuple[float, float, float, float, float, float]
) -> None:
    packet = Packet(counter, packet_id, status, wrench)
    assert decode_packet(encode_packet(packet)) == packet


@given(st.lists(st.binary(max_size=40), max_size=5), st.data())
def test_split_messages_are_reassembled(payloads: list[bytes], data: st.DataObject) -> None:
    stream = b"".join(encode_message(number, payload) for number, payload in enumerate(payloads))
    reader, received, rest = MessageReader(), [], stream
    while rest:
        size = data.draw(st.integers(1, len(rest)))
        received += reader.feed(rest[:size])
        rest = rest[size:]
    assert received == [Message(number, payload) for number, payload in enumerate(payloads)]
    assert reader.noises == 0


def test_reader_recovers_after_garbage() -> None:
    reader, message = MessageReader(), encode_message(7, b"\x40\x00")
    assert reader.feed(b"garbage\xff, " + message[:3]) == []
    assert reader.feed(message[3:]) == [Message(7, b"\x40\x00")]
    assert reader.noises == 1
    too_long = struct.pack("<2sHH", b"\xff\xff", 0, 1019)
    assert reader.feed(too_long + message) == [Message(7, b"\x40\x00")]
    assert reader.noises == 2


def test_message_that_is_too_long_is_refused() -> None:
    assert len(encode_message(0, bytes(1018))) == 1024
    with pytest.raises(LocalProtocolError, match="at most 1018 bytes, got 1019"):
        encode_message(0, bytes(1019))


@given(st.binary(max_size=60))
def test_arbitrary_bytes_raise_remote_protocol_error_only(data: bytes) -> None:
    for decode in (decode_packet, decode_answer):
        with suppress(RemoteProtocolError):
            decode(data)
    MessageReader().feed(data)
    for item in describe(data):
        assert item["fields"] or item["problems"]


@pytest.mark.parametrize(("place", "value"), [(0, "00"), (4, "1e"), (11, "0000c07f"), (11, "0000807f")])
def test_invalid_packet_is_refused(place: int, value: str) -> None:
    data, new = bytearray(PACKET_BYTES), bytes.fromhex(value)
    data[place : place + len(new)] = new
    with pytest.raises(RemoteProtocolError):
        decode_packet(bytes(data))


@pytest.mark.parametrize(
    ("status", "words"),
    [
        (0b000001, ""),
        (0b000000, "not ready"),
        (0b000010, "not ready, process data invalid"),
        (
            0b111101,
            "temperature out of range, hardware fault, mechanical overload, beyond the limits of the tool setting",
        ),
        (0b1000001, "unnamed error"),
    ],
)
def test_status_is_described(status: int, words: str) -> None:
    assert status_words(status) == words


def test_descriptions_name_command_parameter_and_value() -> None:
    request, answer = describe(bytes.fromhex("ffff00000400f0021001ffff01000800f000010000465453"))
    assert [request["op"], answer["op"]] == ["read", "read"]
    values = [{field["name"]: field["value"] for field in item["fields"]} for item in (request, answer)]
    assert values[0] == {"counter": 0, "index": 0x1002, "subindex": 1}
    assert values[1] == {"counter": 1, "error": 0, "index": 1, "subindex": 0, "value": "465453"}
    (packet,) = describe(PACKET_BYTES)
    assert [field["meaning"] for field in packet["fields"] if field["name"] == "status"] == ["not ready"]
