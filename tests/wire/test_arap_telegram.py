"""Telegrams and payloads against the computer-link specification, sections 3 and 4."""

import math
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.devices.s3.arap import (
    KNOWN,
    POSITION_STEP,
    FunctionCode,
    Mode,
    Move,
    MoveKind,
    Refusal,
    RefusalCode,
    Spontaneous,
    SpontaneousKind,
    Status,
    Telegram,
    TelegramType,
    function_text,
    position_from_words,
    position_words,
    quaternion_from_words,
    quaternion_words,
    read_status,
    receive_program,
    refusal_text,
    response,
    start_program,
    stop_program,
    suffix_text,
    type_text,
    write_mode,
)
from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.marks import Mark

# Specification section 4, telegrams inside the golden blocks.
GOLDEN = [
    (read_status(), "00 08 01 00 13 01 00 00"),
    (stop_program(), "00 08 01 00 03 01 00 00"),
    (write_mode(Mode.OPERATION), "00 08 01 00 14 01 00 01"),
]
# Section 3, read from a real robot: words of position and quaternion.
REAL_WORDS = "0FE9 E5DC 1487 0817 D455 0997 2D13"

telegrams = st.builds(
    Telegram,
    st.integers(0, 255),
    st.integers(0, 255),
    st.integers(0, 65535),
    st.binary(max_size=120),
    st.booleans(),
)


@pytest.mark.parametrize(("telegram", "text"), GOLDEN, ids=["read status", "stop program", "write mode"])
def test_golden_telegram(telegram, text):
    raw = bytes.fromhex(text)
    assert telegram.encode() == raw
    assert Telegram.decode(raw, from_robot=False) == telegram


def test_other_orders_match_the_specification():
    assert start_program(7).encode().hex(" ").upper() == "00 0A 01 00 02 01 00 00 00 07"
    assert start_program(7, from_start=False).encode().hex(" ").upper() == "00 0A 01 00 02 01 00 01 00 07"
    assert receive_program(258).encode().hex(" ").upper() == "00 0C 01 00 1D 01 00 01 01 02 00 00"
    assert read_status().encode("data").hex(" ").upper() == "00 00 01 00 13 01 00 00"
    with pytest.raises(LocalProtocolError, match="start program"):
        start_program(70000)


@given(telegrams, st.sampled_from(["whole", "data"]))
@settings(max_examples=100)
def test_round_trip(telegram, style):
    if telegram.from_robot and style == "data":
        with pytest.raises(LocalProtocolError, match="entire length"):
            telegram.encode(style)
    else:
        raw = telegram.encode(style)
        assert Telegram.decode(raw, telegram.from_robot) == telegram
        with pytest.raises(RemoteProtocolError):
            Telegram.decode(raw, not telegram.from_robot)


@pytest.mark.parametrize(
    ("text", "from_robot", "message"),
    [
        ("00 08 01 00 13 01 00", False, "at least 8 bytes, got 7"),
        ("00 09 01 00 13 01 00 00", False, "bytes 0–1: length 9"),
        ("00 00 00 00 13 01 00 00", True, "bytes 0–1: length 0"),
        ("00 08 00 00 13 01 00 00", False, "byte 2: source 0 is not the PC"),
        ("00 08 01 00 13 01 00 00", True, "byte 2: source 1 is not the controller"),
        ("00 08 01 05 13 01 00 00", False, "byte 3: destination 5"),
    ],
)
def test_invalid_telegram_is_explained(text, from_robot, message):
    with pytest.raises(RemoteProtocolError, match=message):
        Telegram.decode(bytes.fromhex(text), from_robot)


def test_telegram_that_cannot_be_encoded_is_refused():
    with pytest.raises(LocalProtocolError):
        Telegram(256, 1).encode()


@given(st.binary(max_size=80), st.booleans())
@settings(max_examples=150)
def test_arbitrary_bytes_decode_or_raise_remote_errors(raw, from_robot):
    for data in (raw, (len(raw) + 8).to_bytes(2, "big") + bytes((not from_robot, 0, *raw[:4])) + raw[4:]):
        try:
            telegram = Telegram.decode(data, from_robot)
        except RemoteProtocolError:
            continue
        for read in (Status, Move, Refusal, Spontaneous):
            try:
                read.from_telegram(telegram)
            except RemoteProtocolError:
                continue


def test_check_value_of_a_real_robot():
    data = bytes.fromhex("0001 0002 0003 0004 08 0A" + REAL_WORDS)
    status = Status.from_telegram(Telegram(19, 2, 0, data, from_robot=True))
    assert status.position == (0.509125, -0.8365, 0.656875)
    assert status.quaternion_words == (2071, -11179, 2455, 11539)
    assert round(math.hypot(*status.quaternion), 6) == 0.999998
    assert (status.program, status.instruction, status.tcp, status.frame) == (1, 2, 3, 4)
    flags = {name for name in Status._fields if getattr(status, name) is True}
    assert flags == {"key_auto", "operation", "emergency_stop"}
    telegram = status.to_telegram()
    assert telegram.data == data
    assert len(telegram.encode()) == 32


@pytest.mark.parametrize(
    ("flag", "byte", "bit"),
    [
        ("local", 16, 0),
        ("interrupt_permitted", 16, 1),
        ("programming_unit", 16, 2),
        ("key_auto", 16, 3),
        ("standby", 17, 0),
        ("operation", 17, 1),
        ("execution", 17, 2),
        ("emergency_stop", 17, 3),
    ],
)
def test_status_flag_has_its_place(flag, byte, bit):
    raw = Status((0, 0, 0), (16384, 0, 0, 0), **{flag: True}).to_telegram().encode()
    assert (raw[16], raw[17]) == ((1 << bit, 0) if byte == 16 else (0, 1 << bit))


words = st.integers(-32768, 32767)


@given(st.tuples(words, words, words), st.tuples(words, words, words, words), st.booleans())
@settings(max_examples=100)
def test_status_round_trip(position, quaternion, flag):
    status = Status(position, quaternion, 9, 8, 7, 6, local=flag, execution=flag)
    assert Status.from_telegram(status.to_telegram()) == status


def test_move_matches_the_specification():
    move = Move(MoveKind.END, (0.509125, -0.8365, 0.656875), (1.0, 0.0, -1.0, 0.5), 0.1, 1.0, True)
    raw = move.to_telegram().encode()
    assert len(raw) == 52
    assert raw[:8].hex() == "0034010018010003"
    assert raw[8:18].hex() == "00000000" + "00" + "06" + "0320" + "2000"
    assert raw[18:32].hex() == "0fe9e5dc1487" + "40000000c0002000"
    assert raw[32:] == bytes(20)
    assert (
        Move(MoveKind.START).to_telegram().encode()[6:18].hex() == "0002" + "00000000" + "0002" + "00002000"
    )
    assert Move(MoveKind.POINT).to_telegram().encode()[13] == 0


moves = st.builds(
    Move,
    st.sampled_from(MoveKind),
    st.tuples(*[st.integers(-32767, 32767).map(lambda n: n / 8000)] * 3),
    st.tuples(*[st.integers(-16384, 16384).map(lambda n: n / 16384)] * 4),
    st.integers(0, 65535).map(lambda n: n / 8000),
    st.integers(0, 65535).map(lambda n: n / 8192),
    st.booleans(),
)


@given(moves, st.sampled_from([52, 60]))
@settings(max_examples=100)
def test_move_round_trip(move, length):
    telegram = move.to_telegram(length)
    assert len(telegram.encode()) == length
    assert Move.from_telegram(telegram) == move


@pytest.mark.parametrize(
    "move",
    [
        Move(MoveKind.POINT, (4.1, 0.0, 0.0)),
        Move(MoveKind.POINT, (0.0, math.nan, 0.0)),
        Move(MoveKind.POINT, (0.0, 0.0, -math.inf)),
        Move(MoveKind.POINT, quaternion=(1.001, 0.0, 0.0, 0.0)),
        Move(MoveKind.POINT, velocity=-0.1),
        Move(MoveKind.POINT, velocity=8.2),
        Move(MoveKind.POINT, run_speed=8.0),
    ],
)
def test_move_out_of_range_is_refused_before_the_wire(move):
    with pytest.raises(LocalProtocolError, match="is outside"):
        move.to_telegram()


def test_wrong_move_telegrams_are_refused():
    telegram = Move(MoveKind.POINT).to_telegram()
    with pytest.raises(RemoteProtocolError, match="56 bytes, expected 52 or 60"):
        Move.from_telegram(Telegram(24, 1, 0, bytes(48)))
    assert Move.from_telegram(Telegram(24, 1, 0, bytes(48)), lengths=(56,)).kind is MoveKind.POINT
    with pytest.raises(RemoteProtocolError, match="suffix 9"):
        Move.from_telegram(Telegram(24, 1, 9, telegram.data))
    with pytest.raises(RemoteProtocolError, match="expected function 19"):
        Status.from_telegram(telegram)
    with pytest.raises(RemoteProtocolError, match="needs 24 bytes"):
        Status.from_telegram(Telegram(19, 2, 0, bytes(23), True))


@given(st.tuples(*[st.floats(-4.0958, 4.0958)] * 3))
@settings(max_examples=100)
def test_rounding_to_device_words_is_to_nearest_and_stable(position):
    rounded = position_from_words(position_words(position))
    assert all(abs(a - b) <= POSITION_STEP / 2 + 1e-12 for a, b in zip(rounded, position, strict=True))
    assert position_words(rounded) == position_words(position)


def test_words_and_values_convert_both_ways():
    assert position_words((4.095875, -4.095875, 0.0)) == (32767, -32767, 0)
    assert position_from_words((32767, -32768, 1)) == (4.095875, -4.096, 0.000125)
    assert quaternion_words((1.0, -1.0, 0.5, 0.0)) == (16384, -16384, 8192, 0)
    assert quaternion_from_words((16384, -16384, 8192, 0)) == (1.0, -1.0, 0.5, 0.0)


def test_refusal_and_spontaneous():
    refusal = Refusal(RefusalCode.OUTSIDE_WORK_AREA)
    telegram = refusal.to_telegram(read_status())
    assert telegram.encode().hex(" ").upper() == "00 0A 00 00 13 06 00 00 00 0F"
    assert Refusal.from_telegram(telegram) == refusal
    assert refusal.text == "outside the work area, or no start point"
    assert Refusal(77).text == "unknown refusal code 77"
    assert Refusal(8).text == "unspecified"
    message = Spontaneous(SpontaneousKind.SYSTEM_ERROR, 508, 3)
    assert message.to_telegram().encode().hex(" ").upper() == "00 0C 00 00 7F 03 00 07 01 FC 00 03"
    assert Spontaneous.from_telegram(message.to_telegram()) == message
    assert message.text == "system error 508.3"
    assert Spontaneous(4, 1, 2).text == "unknown kind 4 1.2"
    assert response(read_status(), b"ab") == Telegram(19, 2, 0, b"ab", True)


def test_texts_of_codes():
    assert function_text(4) == "read TCP"
    assert function_text(45) == "ARAP version"
    assert function_text(200) == "unknown function 200"
    assert type_text(0x0A) == "further block follows, from S3"
    assert type_text(7) == "unknown type 07"
    assert suffix_text(20, 3) == "operation synchronise"
    assert suffix_text(2, 1) == "continue"
    assert suffix_text(99, 1) == ""
    assert str(write_mode(Mode.STANDBY)) == "write mode 0 (standby), order, 0 bytes of data"
    for code in FunctionCode:
        assert function_text(code)
    for kind in TelegramType:
        assert type_text(kind)
    for reason in RefusalCode:
        assert refusal_text(reason)


def test_every_known_payload_has_a_layout_with_marks():
    (status,) = KNOWN.payloads_of(19, 2)
    assert status.layout.fields[0].mark is Mark.ASSUMED
    (move,) = KNOWN.payloads_of(24, 1)
    x = next(field for field in move.layout.fields if field.name == "x")
    assert (x.offset + 8, x.mark, x.unit, x.scale) == (18, Mark.OBSERVED, "m", POSITION_STEP)
    (refusal,) = KNOWN.payloads_of(4, 6)
    assert refusal.names == ("code",)
    assert KNOWN.payloads_of(4, 1) == ()


DOWN = (0.0, 1.0, 0.0, 0.0)
HIT = 0x1003 * POSITION_STEP
"""512.375 mm: a coordinate whose word is DLE ETX."""


def registers_of(move):
    data = move.to_telegram(avoid_trailer=True).data
    assert b"\x10\x03" not in data
    return list(struct.unpack(">3h4h", data[10:24]))


@pytest.mark.parametrize(
    ("position", "words"),
    [
        ((HIT, 0.0, 0.0), [0x1004, 0, 0]),  # both neighbours are equally near: up
        ((0.0, 0.0, HIT - 0.1 * POSITION_STEP), [0, 0, 0x1002]),
        ((0.0, 0.0, HIT + 0.1 * POSITION_STEP), [0, 0, 0x1004]),
        (
            (0x1C10 / 8000, 0x0310 / 8000, 0x0320 / 8000),
            [0x1C11, 0x0311, 0x0320],
        ),  # 10 of one, 03 of the next
        ((-1008 / 8000, 0x03FF / 8000, 0.0), [-1007, 0x03FF, 0]),  # FC10 03FF
        ((0x1C10 / 8000, 0x0410 / 8000, 0x0110 / 8000), [0x1C10, 0x0410, 0x0110]),
    ],
)
def test_coordinate_with_trailer_moves_to_the_nearer_neighbour(position, words):
    move = Move(MoveKind.POINT, position, DOWN, 0.1)
    assert registers_of(move)[:3] == words
    assert (move.to_telegram() == move.to_telegram(avoid_trailer=True)) is (
        list(position_words(position)) == words
    )


def test_orientation_and_end_of_position_avoid_the_trailer():
    one = 16384
    move = Move(MoveKind.END, (0.0, 0.0, 0x2010 / 8000), (0x0310 / one, 0x0303 / one, 0x1003 / one, 0.9), 0.1)
    assert registers_of(move)[2:6] == [0x2011, 0x0311, 0x0303, 0x1004]


def test_invalid_position_and_orientation_are_unchanged():
    """512.375 mm/s is DLE ETX as well."""
    move = Move(MoveKind.POINT, (0.5, 0.0, 0.6), DOWN, HIT)
    assert b"\x10\x03" in move.to_telegram(avoid_trailer=True).data
    assert move.to_telegram(avoid_trailer=True) == move.to_telegram()


TRICKY = st.one_of(
    st.sampled_from((0x1003, 0x0310, 0x0410, -1008, 0x0300, 0x03FF, 0x1010)),
    st.integers(-16000, 16000),
)


@pytest.mark.full
@settings(max_examples=400)
@given(st.lists(st.tuples(TRICKY, st.floats(-0.499, 0.499)), min_size=7, max_size=7))
def test_no_coordinate_is_further_than_one_step_from_the_ordered(words):
    exact = [word + part for word, part in words]
    position = tuple(value / 8000 for value in exact[:3])
    quaternion = tuple(value / 16384 for value in exact[3:])
    move = Move(MoveKind.POINT, position, quaternion, 0.1)
    for sent, ordered, (nearest, _) in zip(registers_of(move), exact, words, strict=True):
        assert abs(sent - ordered) <= 1.0 + 1e-9
        assert abs(sent - nearest) <= 1
    assert len(move.to_telegram(60, avoid_trailer=True).data) == 52
    if b"\x10\x03" not in move.to_telegram().data:
        assert move.to_telegram(avoid_trailer=True) == move.to_telegram()


def test_type_with_the_flag_of_the_observed_client_has_a_name():
    assert type_text(0x11) == "order with a flag of the observed client, effect unknown"
    assert type_text(0x19).startswith("further block follows, from PC with a flag")
    assert type_text(0x12) == "unknown type 12", "a controller's telegram never had it"
