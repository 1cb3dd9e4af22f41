"""The board's memory map, commands and slots. Golden words by hand from the manual's tables."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.devices.jr3.board import (
    COMMANDS,
    REGISTERS,
    UNIT_SCALES,
    CommandCode,
    Errors,
    Link,
    LinkType,
    LoadEnvelope,
    Threshold,
    Units,
    check_range,
    command_info,
    decode_envelope,
    decode_transform,
    describe,
    encode_envelope,
    encode_transform,
    from_signed,
    register_at,
    to_signed,
)
from protocol.endpoint import LocalProtocolError, RemoteProtocolError

WORDS = st.integers(0, 0xFFFF)
AMOUNTS = st.integers(-32768, 32767)
LINKS = st.lists(st.builds(Link, st.sampled_from(list(LinkType)[1:]), AMOUNTS), max_size=20)
THRESHOLDS = st.lists(st.builds(Threshold, WORDS, AMOUNTS, WORDS), max_size=6).map(tuple)
ENVELOPES = st.builds(LoadEnvelope, WORDS, THRESHOLDS, THRESHOLDS)


@pytest.mark.parametrize(
    ("address", "name"),
    [
        # Offsets of the public struct in Linux's jr3_pci.h and of the manual's memory map.
        (0x00, "raw0_time"),
        (0x05, "raw1_data"),
        (0x3D, "raw15_data"),
        (0x57, "copyright[23]"),
        (0x65, "shunts.mz"),
        (0x68, "default_fs.fx"),
        (0x6F, "load_envelope_num"),
        (0x75, "min_full_scale.mz"),
        (0x77, "transform_num"),
        (0x7F, "peak_address"),
        (0x87, "full_scale.v2"),
        (0x8F, "vect_axes"),
        (0x96, "filter0.v1"),
        (0xC0, "filter6.fx"),
        (0xC8, "rate.fx"),
        (0xD0, "minimum.fx"),
        (0xDF, "maximum.v2"),
        (0xE1, "sat_value"),
        (0xE7, "command_word0"),
        (0xED, "count6"),
        (0xF1, "errors"),
        (0xF9, "model_no"),
        (0xFF, "thickness"),
        (0x1FF, "load_envelope15[15]"),
        (0x200, "transform0[0]"),
    ],
)
def test_addresses_are_the_manuals(address: int, name: str) -> None:
    result = register_at(address)
    assert result is not None
    register, index = result
    assert register.element(index) == name
    assert REGISTERS[register.name] is register


def test_registers_lie_in_order_and_apart() -> None:
    end = 0
    for register in REGISTERS.values():
        assert register.address >= end, register.name
        end = register.address + register.count
    assert end == 0x300
    assert register_at(0x6E) is None
    assert register_at(0x300) is None


def test_burst_is_described_word_by_word() -> None:
    rows = describe(0xF5, [302, 20, 1994, 65535])
    assert [(row["name"], row["value"]) for row in rows] == [
        ("software_ver", pytest.approx(3.02)),
        ("software_day", 20),
        ("software_year", 1994),
        ("serial_no", 65535),
    ]
    assert {row["mark"] for row in rows} == {"observed"}
    unnamed = describe(0x8D, [0xFFFF, 0x8000, 3])
    assert [(row["name"], row["raw"]) for row in unnamed] == [
        ("offsets.mz", -1),
        ("offset_num", -32768),
        ("vect_axes", 3),
    ]
    assert [row["name"] for row in describe(0x76, [1, 2])] == ["transform_num"]


@given(AMOUNTS, WORDS)
def test_signs_round_trip(value: int, word: int) -> None:
    assert to_signed(from_signed(value)) == value
    assert from_signed(to_signed(word)) == word
    assert REGISTERS["offset_num"].values([word]) == (to_signed(word),)
    assert REGISTERS["errors"].values([word]) == (word,)


@pytest.mark.parametrize(("address", "count"), [(-1, 1), (0, 0), (0x3FFF, 2), (0x4000, 1), (0, -3)])
def test_burst_outside_the_memory_is_refused(address: int, count: int) -> None:
    with pytest.raises(RemoteProtocolError, match="not inside"):
        check_range(address, count)


def test_complete_memory_is_one_burst() -> None:
    check_range(0, 0x4000)


@pytest.mark.parametrize(
    ("word", "code", "argument"),
    [
        (0x0100, CommandCode.MEMORY_READ, 0),
        (0x050F, CommandCode.USE_TRANSFORM, 15),
        (0x0603, CommandCode.USE_OFFSET, 3),
        (0x093F, CommandCode.VECTOR_AXES, 0x3F),
        (0x09FF, CommandCode.VECTOR_AXES, 0xFF),
        (0x0A00, CommandCode.SET_FULL_SCALES, 0),
    ],
)
def test_commands_are_decoded_from_their_word(word: int, code: CommandCode, argument: int) -> None:
    assert command_info(word) == (COMMANDS[code], argument)


@pytest.mark.parametrize("word", [0, 1, 0x0101, 0x0510, 0x0D00, 0x8000, 0xFFFF])
def test_other_words_are_not_commands(word: int) -> None:
    assert command_info(word) is None


def test_command_times_are_the_manuals() -> None:
    times = {code.name: (info.typical, info.maximum, info.per_link) for code, info in COMMANDS.items()}
    assert times["MEMORY_READ"] == times["READ_PEAKS"] == (40e-6, 125e-6, 0.0)
    assert times["USE_OFFSET"] == times["RESET_OFFSETS"] == (150e-6, 225e-6, 0.0)
    assert times["USE_TRANSFORM"] == (2.25e-3, 2.25e-3, 0.75e-3)
    assert times["SET_FULL_SCALES"] == (3.4e-3, 3.4e-3, 0.75e-3)
    assert [code for code, info in COMMANDS.items() if info.busy] == [
        CommandCode.USE_TRANSFORM,
        CommandCode.SET_FULL_SCALES,
    ]


def test_units_are_si() -> None:
    pound = UNIT_SCALES[Units.POUND]
    assert (pound.force, pound.moment, pound.length) == pytest.approx((4.4482216, 0.11298483, 25.4e-6))
    assert UNIT_SCALES[Units.NEWTON].moment == 0.1
    assert UNIT_SCALES[Units.KILOGRAM_FORCE].force == pytest.approx(0.980665)
    assert UNIT_SCALES[Units.KILOGRAM_FORCE].moment == pytest.approx(0.0980665)
    assert UNIT_SCALES[Units.KILOPOUND].moment == pytest.approx(112.98483)
    assert Errors(0x8800) == Errors.WATCH_DOG | Errors.SENSOR_CHANGE


GOLDEN_TRANSFORM = (3, 0x07D0, 4, 0xC000, 7, 1, 0)
"""200.0 mm along z in units of 0.1 mm, −90° about x, all negated: types and amounts of the manual's table."""
GOLDEN_ENVELOPE = (0x0003, 1, 1, 0x00A2, 0x2000, 0x0001, 0x0092, 0xE000, 0x0006)
"""filter2.fz ≥ 8192 sets bit 0, filter0.fz ≤ −8192 sets bits 1 and 2, bits 0 and 1 latch: order of le_struct."""


def test_golden_transform() -> None:
    links = (Link(LinkType.TRANSLATE_Z, 2000), Link(LinkType.ROTATE_X, -16384), Link(LinkType.NEGATE, 1))
    assert encode_transform(links) == GOLDEN_TRANSFORM
    assert decode_transform(GOLDEN_TRANSFORM) == links


def test_golden_envelope() -> None:
    envelope = LoadEnvelope(3, (Threshold(0xA2, 8192, 1),), (Threshold(0x92, -8192, 6),))
    assert encode_envelope(envelope) == GOLDEN_ENVELOPE
    assert decode_envelope(GOLDEN_ENVELOPE) == envelope


@settings(max_examples=100)
@given(LINKS, ENVELOPES, st.lists(WORDS, max_size=5))
def test_slots_round_trip_with_any_trailing_words(
    links: list[Link], envelope: LoadEnvelope, rest: list[int]
) -> None:
    assert decode_transform([*encode_transform(links), *rest]) == tuple(links)
    assert decode_envelope([*encode_envelope(envelope), *rest]) == envelope


@settings(max_examples=200)
@given(st.lists(WORDS, max_size=20))
def test_arbitrary_words_are_decoded_or_refused(words: list[int]) -> None:
    for decode in (decode_transform, decode_envelope):
        try:
            decode(words)
        except RemoteProtocolError:
            continue


@pytest.mark.parametrize("words", [(), (1, 5), (1, 5, 2), (8, 0, 0), (0x8000, 1, 0)])
def test_invalid_transform_is_refused(words: tuple[int, ...]) -> None:
    with pytest.raises(RemoteProtocolError, match="transform"):
        decode_transform(words)


@pytest.mark.parametrize("words", [(0, 0), (0, 1, 0), (0, 0xFFFF, 0xFFFF, *[0] * 12)])
def test_envelope_longer_than_its_memory_is_refused(words: tuple[int, ...]) -> None:
    with pytest.raises(RemoteProtocolError, match="envelope"):
        decode_envelope(words)


def test_values_beyond_a_slot_are_refused() -> None:
    with pytest.raises(LocalProtocolError, match="TRANSLATE_X 32768"):
        encode_transform([Link(LinkType.TRANSLATE_X, 32768)])
    with pytest.raises(LocalProtocolError, match="END"):
        encode_transform([Link(LinkType.END, 0)])
    with pytest.raises(LocalProtocolError, match="-32769"):
        encode_envelope(LoadEnvelope(0, (Threshold(0, -32769, 1),)))
