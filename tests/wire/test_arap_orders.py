"""Definitions of orders: encoder, decoder and description from one table; known ones and those of a site."""

import struct
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.devices.s3.adlp import MESSAGE_LIMIT, LinkProfile, encode_block
from protocol.devices.s3.arap import (
    FIELD_TYPES,
    KNOWN,
    KNOWN_ORDERS,
    DefinitionError,
    Emulation,
    OrderBook,
    OrderDefinition,
    Payload,
    ProgramAnswer,
    Refusal,
    Rest,
    Spontaneous,
    Telegram,
    describe,
    join_blocks,
    read_status,
    refusal_remedy,
    split_telegram,
)
from protocol.devices.s3.arap.payload import limits
from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.fields import Field, Layout
from protocol.marks import Mark

PROFILE = LinkProfile()


def number(name, byte, kind="u16", scale=1.0, unit=""):
    return Field(name, byte - 8, FIELD_TYPES[kind], Mark.ASSUMED, "", scale, unit)


def payload(name, *fields, size=None, rest=None):
    end = max((f.offset + struct.calcsize(">" + f.format) for f in fields), default=0)
    return Payload(Layout(name, end if size is None else size, ">", fields), rest)


READ = OrderDefinition(
    "read_register",
    6,
    payload("read", number("number", 8)),
    payload("answer", number("number", 8), number("value", 10, "s16", 0.1, "V")),
    {0: "one register", 3: "many"},
)
SEND = OrderDefinition(
    "send_program",
    1,
    payload("send", number("program", 8), rest=Rest("content", Mark.ASSUMED)),
    blocks="several",
)
STATUS_MORE = OrderDefinition(
    "read_status_more", 19, answer=payload("more", number("override", 32, "u8")), extends=True
)
BOOK = OrderBook([READ, SEND, STATUS_MORE])


# --- values


def test_values_are_encoded_by_their_types():
    # Built by hand from two's complement and IEEE 754 single precision.
    every = payload("every", *(number(kind, 8 + 4 * n, kind) for n, kind in enumerate(FIELD_TYPES)))
    values = dict(zip(FIELD_TYPES, (200, -2, 60000, -3, 4_000_000_000, -4, -1.5), strict=True))
    data = bytes.fromhex("C8000000 FE000000 EA600000 FFFD0000 EE6B2800 FFFFFFFC BFC00000")
    assert every.encode(values) == data
    assert every.decode(data) == values


def test_values_are_scaled_to_field_unit():
    assert READ.answer.encode({"number": 3, "value": -1.26}) == bytes.fromhex("0003 FFF3")
    assert READ.answer.decode(bytes.fromhex("0003 FFF3")) == {"number": 3, "value": pytest.approx(-1.3)}
    assert isinstance(READ.answer.decode(bytes(4))["number"], int)


@given(st.data())
@settings(max_examples=100)
def test_every_value_returns_within_half_a_step(data):
    kind = data.draw(st.sampled_from(list(FIELD_TYPES)))
    scale = data.draw(st.sampled_from([1.0, 0.125, -0.5, 1e-3]))
    low, high = limits(FIELD_TYPES[kind])
    raw = data.draw(st.floats(low, high, width=32) if kind == "f32" else st.integers(int(low), int(high)))
    one = payload("one", number("value", 8, kind, scale))
    back = one.decode(one.encode({"value": raw * scale}))["value"]
    assert back == pytest.approx(raw * scale, rel=1e-6, abs=1e-45)


@given(st.binary(max_size=60))
@settings(max_examples=100)
def test_arbitrary_data_decode_or_raise_remote_errors(data):
    for definition in BOOK.site + KNOWN_ORDERS:
        for part in (definition.order, definition.answer):
            try:
                part.decode(data)
                part.describe(data)
            except RemoteProtocolError:
                assert len(data) < part.layout.size


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"value": 4000.0}, "answer: value = 4000 is outside -3276.8 … 3276.7 V"),
        ({"number": -1}, "answer: number = -1 is outside 0 … 65535"),
        ({"number": 1.5}, "answer: number must be a whole number, got 1.5"),
        ({"number": float("nan")}, "answer: number must be a number, got nan"),
        ({"number": True}, "answer: number must be a number, got True"),
        ({"number": b"1"}, "answer: number must be a number, got b'1'"),
        ({"volume": 1}, "answer has no field volume: it has number, value"),
    ],
)
def test_invalid_value_is_named(values, message):
    with pytest.raises(LocalProtocolError) as caught:
        READ.answer.encode(values)
    assert str(caught.value) == message


def test_single_precision_and_tiny_scales_have_limits():
    floating = payload("floating", number("value", 8, "f32"))
    with pytest.raises(LocalProtocolError, match="outside"):
        floating.encode({"value": 1e39})
    with pytest.raises(LocalProtocolError, match="outside"):
        payload("tiny", number("value", 8, "u16", 1e-300)).encode({"value": 1e300})


def test_rest_is_bytes():
    with pytest.raises(LocalProtocolError, match="send: content must be bytes, got 3"):
        SEND.order.encode({"content": 3})
    with pytest.raises(LocalProtocolError, match="has no field x: it has none"):
        OrderDefinition("no_fields", 5).order.encode({"x": 1})
    assert SEND.order.decode(b"\0\7ab") == {"program": 7, "content": b"ab"}


# --- orders


def test_order_by_name_and_values():
    assert READ.telegrams({"number": 3}, None, PROFILE) == (Telegram(6, 1, 0, b"\0\3"),)
    assert READ.telegrams({}, 3, PROFILE) == (Telegram(6, 1, 3, b"\0\0"),)
    with pytest.raises(LocalProtocolError, match="read_register has no suffix 1, only 0, 3"):
        READ.telegrams({}, 1, PROFILE)
    # Section 4 of the specification: the golden blocks.
    assert encode_block(KNOWN.named("write_mode").telegrams({}, 1, PROFILE)[0].encode()) == bytes.fromhex(
        "10 02 00 08 01 00 14 01 00 01 10 03 1E"
    )
    (move,) = KNOWN.named("move").telegrams({"x": 0.5}, 2, PROFILE)
    assert (len(move.encode()), move.data[10:12].hex()) == (52, "0fa0")


def test_names_are_looked_up():
    assert KNOWN.names == (
        "start_program",
        "stop_program",
        "read_status",
        "write_mode",
        "move",
        "receive_program",
    )
    with pytest.raises(
        LocalProtocolError, match=r"unknown order 'read_registre'; did you mean read_register\?"
    ):
        BOOK.named("read_registre")
    with pytest.raises(LocalProtocolError, match="there are start_program, stop_program"):
        KNOWN.named("?")


def test_long_order_is_refused_or_travels_in_several_blocks():
    content = bytes(range(250))
    with pytest.raises(LocalProtocolError, match="a telegram of 260 bytes is too long for a block of 128"):
        replace(SEND, blocks="one").telegrams({"content": content}, None, PROFILE)
    blocks = SEND.telegrams({"program": 7, "content": content}, None, PROFILE)
    assert [(block.type, len(block.data)) for block in blocks] == [(9, 120), (9, 120), (1, 12)]
    joined = join_blocks(blocks)
    assert SEND.order.decode(joined.data) == {"program": 7, "content": content}
    assert joined == Telegram(1, 1, 0, b"\0\7" + content)
    with pytest.raises(LocalProtocolError, match="at most 4096 blocks of 120"):
        SEND.telegrams({"content": bytes(MESSAGE_LIMIT * 120 - 1)}, None, PROFILE)


@given(st.binary(max_size=900), st.booleans(), st.integers(60, 200))
@settings(max_examples=60)
def test_split_blocks_join_again(data, from_robot, longest):
    telegram = Telegram(29, 2 if from_robot else 1, 5, data, from_robot)
    blocks = split_telegram(telegram, longest)
    assert all(len(block.encode()) <= longest for block in blocks)
    assert join_blocks(blocks) == telegram


@pytest.mark.parametrize(
    ("blocks", "message"),
    [
        ([(1, 9), (2, 1)], "block 1 of 2 is not part of a long telegram"),
        ([(1, 1), (1, 1)], "block 1 of 2 is not part of a long telegram"),
        ([(1, 0x0A), (1, 1)], "block 1 of 2 is not part of a long telegram"),
        ([(1, 9), (1, 9)], "a further block was announced but not received"),
    ],
)
def test_unrelated_blocks_are_refused(blocks, message):
    with pytest.raises(RemoteProtocolError, match=message):
        join_blocks([Telegram(function, kind) for function, kind in blocks])


def test_answer_with_a_program():
    answer = ProgramAnswer(258, b"abc")
    assert answer.to_telegram().encode() == bytes.fromhex("000F 00 00 1D 02 0000 0000 0102 616263")
    assert ProgramAnswer.from_telegram(answer.to_telegram()) == answer
    with pytest.raises(RemoteProtocolError, match="expected function 29"):
        ProgramAnswer.from_telegram(read_status())
    with pytest.raises(RemoteProtocolError, match="needs 4 bytes"):
        ProgramAnswer.from_telegram(Telegram(29, 2, 0, b"\0", True))


# --- descriptions


def fields(items):
    return {field["name"]: field["value"] for field in items[0]["fields"]}


def test_sites_orders_are_described_by_their_definition():
    (item,) = describe(encode_block(Telegram(6, 1, 3, b"\0\7").encode()), orders=BOOK)
    assert (item["header"]["order"], item["header"]["suffix_text"]) == ("read_register", "many")
    assert fields([item]) == {"number": 7}
    answer = encode_block(Telegram(6, 2, 0, b"\0\7\0\x0c", True).encode())
    assert fields(describe(answer, orders=BOOK)) == {"number": 7, "value": pytest.approx(1.2)}
    assert fields(describe(answer)) == {}
    (short,) = describe(encode_block(Telegram(6, 2, 0, b"\0", True).encode()), orders=BOOK)
    assert (short["problem"], short["problem_offset"]) == ("answer needs 4 bytes of data, got 1", 10)
    assert fields(describe(encode_block(Telegram(6, 7, 0, b"\0", True).encode()), orders=BOOK)) == {}


def test_extended_answer_is_described_with_the_site_fields():
    status = bytes(24)
    long, short = (
        encode_block(Telegram(19, 2, 0, data, True).encode()) for data in (status + b"\x50", status)
    )
    assert fields(describe(long, orders=BOOK))["override"] == 80
    assert "override" not in fields(describe(short, orders=BOOK))
    assert "problem" not in describe(short, orders=BOOK)[0]
    assert BOOK.named("read_status_more").answer.decode(status + b"\x50")["override"] == 80
    assert BOOK.extension_of(19) is STATUS_MORE
    assert BOOK.extension_of(6) is None


def test_further_blocks_of_a_long_telegram_are_its_contents():
    answer = split_telegram(ProgramAnswer(7, bytes(200)).to_telegram(), 128)
    first, second = describe(b"".join(encode_block(block.encode()) for block in answer))
    assert [field["name"] for field in first["fields"]] == ["error", "program", "content"]
    assert [(field["name"], len(field["raw"])) for field in second["fields"]] == [("content", 84 * 3 - 1)]
    twice = describe(encode_block(answer[1].encode()) * 2)
    assert [len(item["fields"]) for item in twice] == [3, 3]
    mixed = describe(encode_block(Telegram(2, 9, 0, b"\0\1").encode()) * 2)
    assert [len(item["fields"]) for item in mixed] == [1, 0]


def test_controller_answers_are_described_for_every_payload():
    refused = describe(encode_block(Refusal(7).to_telegram(read_status()).encode()))
    assert (fields(refused), refused[0]["meaning"].rpartition(": ")[2]) == ({"code": 7}, "no such program")
    items = describe(encode_block(Spontaneous(17, 13, 2).to_telegram().encode()))
    assert fields(items) == {"x": 13, "y": 2}
    for definition in KNOWN_ORDERS:
        for suffix in definition.suffixes:
            (order,) = definition.telegrams({}, suffix, PROFILE)
            (item,) = describe(encode_block(order.encode()))
            assert item["header"]["order"] == definition.name
            assert [field["name"] for field in item["fields"]] == list(definition.order.names)
            assert "problem" not in item


def test_known_remedies_are_reported():
    assert "TO SC" in refusal_remedy(5)
    assert refusal_remedy(0) == refusal_remedy(77) == ""


# --- definitions that cannot be

RIGHT = replace(READ, emulation=Emulation("register", ("number",), {"value": 1.5}))


def fields_of(*fields, **more):
    return replace(RIGHT, answer=payload("answer", *fields, **more), emulation=Emulation())


@pytest.mark.parametrize(
    ("wrong", "path", "message"),
    [
        (replace(RIGHT, name="Read"), (), "lower-case letters"),
        (replace(RIGHT, name="move"), (), "choose another"),
        (replace(RIGHT, function=0), ("function",), "0 is outside 1 … 255"),
        (replace(RIGHT, function=256), ("function",), "256 is outside"),
        (replace(RIGHT, function=19), ("function",), "19 \\(read status\\) is known; .* extends = true"),
        (replace(RIGHT, function=127), ("function",), "127 \\(spontaneous\\) is known; use another code$"),
        (replace(RIGHT, function=29), ("function",), "use another code$"),
        (replace(RIGHT, function=29, extends=True), ("extends",), "2, 3, 19, 20, 24 can be extended"),
        (replace(RIGHT, extends=True), ("extends",), "can be extended"),
        (replace(RIGHT, suffixes={}), ("suffixes",), "at least one"),
        (replace(RIGHT, suffixes={65536: ""}), ("suffixes", "65536"), "outside 0 … 65535"),
        (replace(RIGHT, blocks="several"), ("blocks",), "type bytes"),
        (fields_of(number("a b", 8)), ("answer", 0, "name"), "cannot be the name"),
        (fields_of(number("suffix", 8)), ("answer", 0, "name"), "cannot be the name"),
        (fields_of(number("a", 8), number("a", 10)), ("answer", 1, "name"), "used twice"),
        (fields_of(number("a", 8), rest=Rest("a", Mark.ASSUMED)), ("answer", 1, "name"), "used twice"),
        (fields_of(number("a", 8, scale=0.0)), ("answer", 0, "scale"), "other than 0"),
        (fields_of(number("a", 8, scale=float("inf"))), ("answer", 0, "scale"), "other than 0"),
        (fields_of(number("a", 7)), ("answer", 0, "byte"), "7 is inside the header"),
        (fields_of(number("a", 127)), ("answer", 0, "byte"), "ends with byte 128, past a block of 128"),
        (
            fields_of(number("a", 10), number("b", 9)),
            ("answer", 1, "byte"),
            "9 to 10 overlap the field a at 10 to 11",
        ),
        (fields_of(number("a", 8), size=1), ("answer_length",), "9 must be between 10"),
        (fields_of(number("a", 8), size=121), ("answer_length",), "129 must be between 10"),
        (fields_of(size=-1), ("answer_length",), "7 must be between 8"),
        (
            fields_of(number("a", 8), size=1, rest=Rest("b", Mark.ASSUMED)),
            ("answer", 1, "byte"),
            "9 must be between 10",
        ),
        (
            replace(STATUS_MORE, answer=payload("a", number("x", 40))),
            ("answer", 0, "name"),
            "x is used twice",
        ),
        (
            replace(STATUS_MORE, answer=payload("a", number("a", 31))),
            ("answer", 0, "byte"),
            "the field q4 at 30 to 31",
        ),
        (
            replace(STATUS_MORE, answer=payload("a", size=4, rest=Rest("b", Mark.ASSUMED))),
            ("answer", 0, "byte"),
            "12 must be between 32",
        ),
        (replace(RIGHT, emulation=Emulation("m", ("value",))), ("emulator", "key"), "no numeric field value"),
        (replace(RIGHT, emulation=Emulation("", ("number",))), ("emulator", "key"), "name of a memory"),
        (replace(RIGHT, emulation=Emulation("", (), {"a": 1})), ("emulator", "initial", "a"), "no field a"),
    ],
)
def test_invalid_definition_is_refused_with_its_path(wrong, path, message):
    OrderBook([RIGHT], 128)
    with pytest.raises(DefinitionError, match=message) as caught:
        OrderBook([wrong], 128)
    assert caught.value.path == (wrong.name, *path)


def test_function_is_defined_once():
    with pytest.raises(DefinitionError, match="6 is already the function of read_register") as caught:
        OrderBook([READ, replace(READ, name="other")])
    assert caught.value.path == ("other", "function")
