"""Telegrams of RSI: golden bytes of the specification in both directions, angles, and arbitrary bytes."""

import math
import zlib
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.devices.rsi import (
    ROBOT,
    SENSOR,
    Telegram,
    decode,
    describe,
    encode,
    fixed,
    number,
    numbers,
    pose_tags,
)
from protocol.devices.rsi.angles import nearest, pose_of, values_of
from protocol.devices.rsi.telegram import LARGEST_BYTES, _parse
from protocol.endpoint import RemoteProtocolError
from protocol.geometry import Pose, angles_of, from_angles, inverse, product, rotate

# The telegrams K1 … K7 of the specification, with their lengths and check sums.
GOLDEN = {
    "K1": (
        382,
        0x3306C314,
        '<Rob Type="KUKA"><RIst X="600.0000" Y="0.0000" Z="500.0000" A="0.0000" B="0.0000" C="180.0000"/>'
        '<RSol X="600.0000" Y="0.0000" Z="500.0000" A="0.0000" B="0.0000" C="180.0000"/>'
        '<AIPos A1="0.0000" A2="-90.0000" A3="90.0000" A4="0.0000" A5="90.0000" A6="0.0000"/>'
        '<ASPos A1="0.0000" A2="-90.0000" A3="90.0000" A4="0.0000" A5="90.0000" A6="0.0000"/>'
        '<Delay D="0"/><IPOC>123456</IPOC></Rob>',
    ),
    "K2": (
        131,
        0x2F94D94E,
        '<Sen Type="ImFree"><RKorr X="0.000000" Y="0.000000" Z="-0.020000" A="0.000000" B="0.000000" '
        'C="0.000000"/><IPOC>123456</IPOC></Sen>',
    ),
    "K3": (
        382,
        0x659293E3,
        '<Rob Type="KUKA"><RIst X="600.0000" Y="0.0000" Z="499.9800" A="0.0000" B="0.0000" C="180.0000"/>'
        '<RSol X="600.0000" Y="0.0000" Z="500.0000" A="0.0000" B="0.0000" C="180.0000"/>'
        '<AIPos A1="0.0000" A2="-89.9981" A3="89.9972" A4="0.0000" A5="90.0009" A6="0.0000"/>'
        '<ASPos A1="0.0000" A2="-90.0000" A3="90.0000" A4="0.0000" A5="90.0000" A6="0.0000"/>'
        '<Delay D="0"/><IPOC>123460</IPOC></Rob>',
    ),
    "K4": (
        130,
        0x6CFA82B9,
        '<Sen Type="ImFree"><RKorr X="0.000000" Y="0.000000" Z="0.000000" A="0.000000" B="0.000000" '
        'C="0.000000"/><IPOC>123460</IPOC></Sen>',
    ),
    "K5": (
        138,
        0x8E50E7DD,
        '<Sen Type="ImFree"><AK A1="0.000000" A2="0.001000" A3="-0.001500" A4="0.000000" A5="0.000000" '
        'A6="0.250000"/><IPOC>4294967300</IPOC></Sen>',
    ),
    "K6": (
        157,
        0xBB00A0AF,
        '<Sen Type="ImFree"><RKorr X="0.000000" Y="0.000000" Z="-0.020000" A="0.000000" B="0.000000" '
        'C="0.000000"/><DiO>1</DiO><Stop>0</Stop><IPOC>123464</IPOC></Sen>',
    ),
    "K7": (
        299,
        0x5CC094BE,
        '<Rob Type="KUKA"><RIst X="600.0000" Y="0.0000" Z="500.0000" A="0.0000" B="0.0000" C="180.0000"/>'
        '<AIPos A1="0.0000" A2="-90.0000" A3="90.0000" A4="0.0000" A5="90.0000" A6="0.0000"/>'
        '<EIPos E1="0.0000" E2="0.0000" E3="0.0000" E4="0.0000" E5="0.0000" E6="0.0000"/>'
        '<Delay D="3"/><IPOC>123468</IPOC></Rob>',
    ),
}
AXES = [f"A{axis}" for axis in range(1, 7)]


def group(element: str, names: list[str], values: tuple[float, ...], decimals: int) -> dict[str, str]:
    return {f"{element}.{name}": fixed(value, decimals) for name, value in zip(names, values, strict=True)}


POSE = [*"XYZABC"]
HERE = (600.0, 0.0, 500.0, 0.0, 0.0, 180.0)
JOINTS = (0.0, -90.0, 90.0, 0.0, 90.0, 0.0)
SET = {**group("RSol", POSE, HERE, 4)}
EXPECTED_VALUES = {
    "K1": Telegram(
        ROBOT,
        "KUKA",
        {
            **group("RIst", POSE, HERE, 4),
            **SET,
            **group("AIPos", AXES, JOINTS, 4),
            **group("ASPos", AXES, JOINTS, 4),
            "Delay.D": "0",
        },
        123456,
    ),
    "K2": Telegram(SENSOR, "ImFree", group("RKorr", POSE, (0, 0, -0.02, 0, 0, -0.0), 6), 123456),
    "K3": Telegram(
        ROBOT,
        "KUKA",
        {
            **group("RIst", POSE, (600.0, 0.0, 499.98, 0.0, 0.0, 180.0), 4),
            **SET,
            **group("AIPos", AXES, (0.0, -89.9981, 89.9972, 0.0, 90.0009, 0.0), 4),
            **group("ASPos", AXES, JOINTS, 4),
            "Delay.D": "0",
        },
        123460,
    ),
    "K4": Telegram(SENSOR, "ImFree", group("RKorr", POSE, (0.0, -1e-9, 0.0, 0.0, 0.0, 0.0), 6), 123460),
    "K5": Telegram(SENSOR, "ImFree", group("AK", AXES, (0, 0.001, -0.0015, 0, 0, 0.25), 6), 4294967300),
    "K6": Telegram(
        SENSOR,
        "ImFree",
        {**group("RKorr", POSE, (0, 0, -0.02, 0, 0, 0), 6), "DiO": "1", "Stop": "0"},
        123464,
    ),
    "K7": Telegram(
        ROBOT,
        "KUKA",
        {
            **group("RIst", POSE, HERE, 4),
            **group("AIPos", AXES, JOINTS, 4),
            **group("EIPos", [f"E{axis}" for axis in range(1, 7)], (0.0,) * 6, 4),
            "Delay.D": "3",
        },
        123468,
    ),
}


@pytest.mark.parametrize("name", GOLDEN)
def test_golden_telegrams_are_written_and_read_to_the_byte(name: str) -> None:
    size, check, text = GOLDEN[name]
    raw = text.encode()
    assert (len(raw), zlib.crc32(raw)) == (size, check)
    assert encode(EXPECTED_VALUES[name]) == raw
    assert decode(raw) == EXPECTED_VALUES[name]
    assert [*decode(raw).values] == [*EXPECTED_VALUES[name].values]


def test_root_may_spell_its_attribute_in_capitals() -> None:
    raw = encode(EXPECTED_VALUES["K1"], "TYPE")
    assert raw.startswith(b'<Rob TYPE="KUKA"><RIst')
    assert decode(raw) == EXPECTED_VALUES["K1"]


def test_element_order_white_space_and_extra_text_are_ignored() -> None:
    raw = b'<Sen Type="ImFree">\n <IPOC> 123456 </IPOC><RKorr Z="-0.02"  X="1" /> <Stop> 1\n</Stop><EStr /></Sen> '
    assert decode(raw) == Telegram(
        SENSOR, "ImFree", {"RKorr.Z": "-0.02", "RKorr.X": "1", "Stop": "1"}, 123456
    )


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        (b"", "not a telegram"),
        (b"<Sen Type='a'><IPOC>1</IPOC>", "not a telegram"),
        (b"<Sen Type='a'><IPOC>1</IPOC></Sen><Sen/>", "not a telegram"),
        (b'<Rob Type="KUKA"><GPIO 01="1"/><IPOC>1</IPOC></Rob>', "not a telegram"),
        (b"\xff\xfe<Sen/>", "not a telegram"),
        (b"<Sen Type='a'/>", "IPOC is ''"),
        (b"<Sen Type='a'><IPOC>-1</IPOC></Sen>", "IPOC is '-1'"),
        (b"<Sen Type='a'><IPOC>1.5</IPOC></Sen>", "IPOC is '1.5'"),
        (b"<Sen Type='a'><IPOC>9223372036854775808</IPOC></Sen>", "IPOC is '9223372036854775808'"),
        (b"<Robot><IPOC>1</IPOC></Robot>", "the root is 'Robot'"),
        (
            b"<?xml version='1.0'?><Sen Type='a'><IPOC>1</IPOC></Sen>",
            "must not have a prolog or a document type",
        ),
        (b"<!DOCTYPE a [<!ENTITY b 'c'>]><Sen Type='&b;'><IPOC>1</IPOC></Sen>", "or a document type"),
        (b"<Sen Type='&b;'><IPOC>1</IPOC></Sen>", "not a telegram"),
        (b"<Sen>" + b" " * LARGEST_BYTES + b"</Sen>", "is longer than 8192"),
        (b"<a>" * 2000, "not a telegram"),
    ],
)
def test_invalid_telegram_is_refused_with_a_reason(raw: bytes, message: str) -> None:
    with pytest.raises(RemoteProtocolError, match=message):
        decode(raw)


@pytest.mark.parametrize(
    "text", ["", "NaN", "inf", "-", "1,5", "1_0", "0x1", "1e", "1e10", "1e400", "١", "1" * 65]
)
def test_invalid_number_is_refused(text: str) -> None:
    with pytest.raises(RemoteProtocolError):
        number(text)


def test_numbers_are_read_as_clients_write_them() -> None:
    assert [number(text) for text in ("1", "-0.020000", "+.5", "3.", "1e-05", "-1E2")] == [
        1.0, -0.02, 0.5, 3.0, 1e-5, -100.0,
    ]  # fmt: skip
    assert numbers({"a.X": "1"}, ["a.X"]) == [1.0]
    assert numbers({"a.X": "1"}, ["a.X", "a.Y"]) is None
    for value in (math.nan, math.inf):
        with pytest.raises(ValueError, match="cannot be sent"):
            fixed(value, 4)


@given(st.binary(max_size=300))
def test_arbitrary_bytes_raise_only_remote_errors(raw: bytes) -> None:
    for data in (raw, b'<Sen Type="ImFree">' + raw + b"</Sen>"):
        try:
            telegram = decode(data)
        except RemoteProtocolError:
            pass
        else:
            assert 0 <= telegram.ipoc < 2**63
        describe(data)


@given(st.sampled_from(sorted(GOLDEN)), st.integers(0, 400), st.integers(0, 255))
def test_corrupted_byte_raises_only_remote_errors(name: str, at: int, byte: int) -> None:
    raw = bytearray(GOLDEN[name][2].encode())
    raw[at % len(raw)] = byte
    for item in describe(bytes(raw)):
        assert item["kind"] in ("telegram", "noise")


NAMES = st.from_regex(r"[A-Za-z][A-Za-z0-9]{0,8}", fullmatch=True).filter(lambda name: name != "IPOC")
TEXTS = st.text(st.characters(codec="ascii", exclude_categories=["C"]), max_size=20).map(str.strip)


@pytest.mark.full
@given(
    st.sampled_from([ROBOT, SENSOR]),
    TEXTS,
    st.dictionaries(
        NAMES, st.dictionaries(NAMES, TEXTS, min_size=1, max_size=3) | TEXTS.filter(bool), max_size=5
    ),
    st.integers(0, 2**63 - 1),
)
def test_decode_inverts_encode(
    root: str, kind: str, elements: dict[str, dict[str, str] | str], ipoc: int
) -> None:
    values: dict[str, str] = {}
    for name, content in elements.items():
        if isinstance(content, str):
            values[name] = content
        else:
            values |= {f"{name}.{attribute}": text for attribute, text in content.items()}
    telegram = Telegram(root, kind, values, ipoc)
    assert decode(encode(telegram)) == telegram


@given(st.floats(-1e6, 1e6), st.integers(1, 9))
def test_number_keeps_its_value_and_has_no_minus_before_zero(value: float, decimals: int) -> None:
    text = fixed(value, decimals)
    assert number(text) == pytest.approx(value, abs=0.51 * 10.0**-decimals)
    assert not (text.startswith("-") and number(text) == 0.0)


# --- angles


def test_worked_example_of_the_angles() -> None:
    q = from_angles(30.0, -20.0, 10.0)
    assert q == pytest.approx((0.943714, 0.127679, -0.144878, 0.268536), abs=1e-6)
    assert angles_of(q) == pytest.approx((30.0, -20.0, 10.0))
    assert rotate(q, (0.0, 0.0, 10.0)) == pytest.approx((-2.048741, -3.187958, 9.254166), abs=1e-6)
    columns = [rotate(q, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))]
    assert columns[0] == pytest.approx((0.813798, 0.469846, 0.342020), abs=1e-6)
    assert columns[1] == pytest.approx((-0.543838, 0.823173, 0.163176), abs=1e-6)


def test_downward_tool_and_its_corrections() -> None:
    down = from_angles(0.0, 0.0, 180.0)
    assert down == pytest.approx((0.0, 1.0, 0.0, 0.0), abs=1e-12)
    tilt, roll = from_angles(0.0, 5.0, 0.0), from_angles(0.0, 0.0, 5.0)
    # the same turns as (0, 5, 180), (0, -5, 180) and (0, 0, -175)
    for result, same in [
        (product(tilt, down), (0.0, 5.0, 180.0)),
        (product(down, tilt), (0.0, -5.0, 180.0)),
        (product(roll, down), (0.0, 0.0, -175.0)),
        (product(down, roll), (0.0, 0.0, -175.0)),
    ]:
        assert abs(sum(a * b for a, b in zip(result, from_angles(*same), strict=True))) == pytest.approx(1.0)
    assert nearest(-175.0, 180.0) == pytest.approx(185.0)
    assert nearest(179.0, -540.0) == pytest.approx(-541.0)


ANGLES = st.floats(-180.0, 180.0)


@given(st.tuples(ANGLES, st.floats(-90.0, 90.0), ANGLES))
def test_angles_and_quaternion_mean_the_same_turn(angles: tuple[float, float, float]) -> None:
    q = from_angles(*angles)
    assert math.hypot(*q) == pytest.approx(1.0)
    back = angles_of(q)
    assert abs(back[1]) <= 90.0 + 1e-9
    assert abs(sum(a * b for a, b in zip(q, from_angles(*back), strict=True))) == pytest.approx(1.0, abs=1e-9)
    assert product(q, inverse(q)) == pytest.approx((1.0, 0.0, 0.0, 0.0), abs=1e-9)


def test_upright_angles_have_no_turn_about_the_base_axis() -> None:
    a, b, c = angles_of(from_angles(40.0, 90.0, 10.0))
    assert (a, b, c) == pytest.approx((0.0, 90.0, -30.0), abs=1e-5)


def test_pose_is_sent_in_millimetres_and_degrees() -> None:
    pose = pose_of([600.0, -1.5, 500.0, 30.0, -20.0, 10.0])
    assert pose.position == (0.6, -0.0015, 0.5)
    assert values_of(pose) == pytest.approx((600.0, -1.5, 500.0, 30.0, -20.0, 10.0))
    assert isinstance(pose, Pose)


# --- words


def test_capture_of_both_directions_is_described() -> None:
    raw = (GOLDEN["K1"][2] + "\r\n" + GOLDEN["K2"][2]).encode() + b"<Sen Type="
    robot, sensor, rest = describe(raw)
    assert (robot["offset"], robot["size"], robot["direction"], robot["type"]) == (
        0,
        382,
        "from robot",
        "KUKA",
    )
    assert (sensor["offset"], sensor["ipoc"], sensor["problems"]) == (384, 123456, [])
    assert (rest["kind"], rest["offset"], rest["size"]) == ("noise", 515, 10)
    fields = {field["name"]: field for field in sensor["fields"]}  # type: ignore[attr-defined]
    assert fields["RKorr.Z"]["value"] == -0.02
    assert fields["RKorr.Z"]["unit"] == "mm"
    assert fields["RKorr.A"]["unit"] == "°"
    joints = {field["name"]: field for field in robot["fields"]}  # type: ignore[attr-defined]
    assert joints["AIPos.A2"]["unit"] == "°"
    assert joints["Delay.D"]["unit"] == ""


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ('<Rob Type="KUKA"><IPOC>4</IPOC></Rob>', "RIst is missing"),
        ("<Sen Type='ImFree'><IPOC>4</IPOC></Sen>", "it contains only IPOC"),
        ('<Sen><RKorr X="1"/><IPOC>4</IPOC></Sen>', "the root has no Type"),
        ('<Sen Type="a"><RKorr X="NaN"/><IPOC>4</IPOC></Sen>', "RKorr.X is not a number"),
    ],
)
def test_problems_are_named(text: str, problem: str) -> None:
    (item,) = describe(text.encode())
    assert any(str(each).startswith(problem) for each in item["problems"])  # type: ignore[attr-defined]


def test_text_for_the_panel_is_no_wrong_number() -> None:
    (item,) = describe(b'<Sen Type="a"><EStr>hello</EStr><IPOC>4</IPOC></Sen>')
    assert item["problems"] == []


def test_pose_tags_are_in_the_vendors_order() -> None:
    assert pose_tags("RKorr") == ("RKorr.X", "RKorr.Y", "RKorr.Z", "RKorr.A", "RKorr.B", "RKorr.C")


PARTS = """
<Rob Type="KUKA">|</Rob>|<RIst X="1" Y="-2.5"/>|<RIst X="|"|5|tail
<DiO>5</DiO>|<DiO> 7 </DiO>|<DiO></DiO>|<A B='="1"'/>|<RKorr X='1'/>|<Delay D=""/>
<S T="a b" U="&amp;"/>|<E>é</E>|<IPOC>12</IPOC>|<IPOC>13</IPOC>|<IPOC>x</IPOC>
"""
"""Parts of telegrams, well-formed and not."""


@given(st.lists(st.sampled_from(PARTS.strip().replace("\n", "|").split("|")), max_size=7))
def test_cached_form_decodes_like_a_new_one(parts: list[str]) -> None:
    """Also with other texts, and with malformed bytes."""
    text = "".join(['<Rob Type="KUKA">', *parts, "<IPOC>12</IPOC></Rob>"])
    for variant in (text, text.replace("5", "66"), text.replace("12", "9"), text.replace('"1"', '""')):
        for _ in range(2):
            assert _read(decode, variant) == _read(lambda raw: _parse(raw.decode()), variant)


def _read(read: Callable[[bytes], Telegram], text: str) -> Telegram | str:
    try:
        return read(text.encode())
    except RemoteProtocolError as error:
        return str(error)
