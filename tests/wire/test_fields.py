"""Field tables, settings with marks, and CAN frames: the foundations of every codec."""

import struct
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.can.frame import CanFrame
from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.fields import Field, Layout
from protocol.marks import Mark, above, at_least, check_settings, setting, settings

LAYOUT = Layout(
    "sample",
    8,
    ">",
    (
        Field("height", 4, "h", Mark.OBSERVED, "above the table", scale=0.125, unit="mm"),
        Field("kind", 1, "B", Mark.ASSUMED),
    ),
)


def test_bytes_match_the_table_and_gaps_are_zero() -> None:
    assert LAYOUT.pack({"kind": 7, "height": -2}) == bytes.fromhex("00 07 00 00 FF FE 00 00")
    assert LAYOUT.unpack(bytes.fromhex("AA 07 AA AA FF FE AA AA AA")) == {"kind": 7, "height": -2}


@given(st.integers(0, 255), st.integers(-32768, 32767))
def test_unpack_inverts_pack(kind: int, height: int) -> None:
    values = {"kind": kind, "height": height}
    assert LAYOUT.unpack(LAYOUT.pack(values)) == values


@pytest.mark.parametrize("values", [{"kind": 256}, {"kind": -1}, {"kind": 1.5}, {"width": 1}])
def test_value_beyond_a_field_is_a_local_error(values: dict[str, float]) -> None:
    with pytest.raises(LocalProtocolError, match="sample"):
        LAYOUT.pack(values)


@given(st.integers(0, 255), st.integers(-32768, 32767))
def test_row_has_the_fields_by_offset(kind: int, height: int) -> None:
    data = LAYOUT.pack_row(kind, height)
    assert data == LAYOUT.pack({"kind": kind, "height": height})
    assert LAYOUT.unpack_row(data + b"more") == (kind, height)


@pytest.mark.parametrize("row", [(), (1,), (1, 2, 3), (256, 1), ("a", 1)])
def test_invalid_row_is_a_local_error(row: tuple[int, ...]) -> None:
    with pytest.raises(LocalProtocolError, match="sample"):
        LAYOUT.pack_row(*row)


@given(st.binary(max_size=7))
def test_short_payload_is_the_other_sides_fault(data: bytes) -> None:
    for read in (LAYOUT.unpack, LAYOUT.unpack_row):
        with pytest.raises(RemoteProtocolError, match="sample needs 8 bytes"):
            read(data)


def test_description_has_units_and_marks() -> None:
    height, kind = LAYOUT.describe(LAYOUT.pack({"kind": 7, "height": -2}))
    assert (height["raw"], height["value"], height["unit"], height["mark"]) == (-2, -0.25, "mm", "observed")
    assert (kind["value"], kind["unit"], kind["mark"]) == (7, "", "assumed")


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ((Field("a", 0, "H", Mark.ASSUMED), Field("b", 1, "B", Mark.ASSUMED)), "field b overlaps"),
        ((Field("a", 3, "H", Mark.ASSUMED),), "fields end at 5, beyond the size 4"),
    ],
)
def test_contradictory_table_is_refused(fields: tuple[Field, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Layout("broken", 4, "<", fields).pack({})


@dataclass(frozen=True)
class Profile:
    delay_ms: float = setting(2.0, Mark.ASSUMED, "how late", above(0.0, 10.0), unit="ms")
    scales: tuple[float, ...] = setting((1.0, 2.0), Mark.OBSERVED, "full scales", at_least(1.0))
    name: str = setting("x", Mark.CHOSEN, "a word")
    plain: int = 3

    def __post_init__(self) -> None:
        check_settings(self)


def test_settings_have_value_default_and_mark() -> None:
    delay, scales, name = settings(Profile(delay_ms=3.0))
    assert (delay.name, delay.value, delay.default, delay.info.mark) == ("delay_ms", 3.0, 2.0, Mark.ASSUMED)
    assert (scales.value, name.info.meaning) == ((1.0, 2.0), "a word")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"delay_ms": 0.0}, "delay_ms must be more than 0, got 0"),
        ({"delay_ms": 11}, "delay_ms must be at most 10, got 11"),
        ({"delay_ms": float("nan")}, "delay_ms must be a number, got nan"),
        ({"scales": (2.0, 0.5)}, "scales must be at least 1, got 0.5"),
    ],
)
def test_setting_out_of_bounds_is_named(values: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Profile(**values)  # type: ignore[arg-type]


def test_frame_reads_as_candump_writes_it() -> None:
    assert str(CanFrame(0x201, struct.pack("<HI", 200, 10000))) == "201#C80010270000"
    assert str(CanFrame(0x80)) == "080#"
    assert str(CanFrame(0x12345, extended=True)) == "00012345#"
    assert str(CanFrame(0x7FF, remote=True)) == "7FF#R"
    assert CanFrame(1, b"", received_at=1.0) == CanFrame(1, b"", received_at=2.0)


@pytest.mark.parametrize(
    ("identifier", "data", "message"),
    [(0x800, b"", "outside 0 … 0x7ff"), (-1, b"", "outside"), (1, bytes(9), "at most 8 bytes, got 9")],
)
def test_impossible_frame_is_refused(identifier: int, data: bytes, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        CanFrame(identifier, data).checked()


def test_frame_with_its_time_is_the_same_frame() -> None:
    for frame in (CanFrame(0x7FF, b"abc", remote=True), CanFrame(0x800, b"", extended=True, error=True)):
        stamped = frame.stamped(7919.5)
        assert (stamped, stamped.received_at, frame.received_at) == (frame, 7919.5, None)


@pytest.mark.parametrize(
    ("scale", "raw", "value"),
    [
        (1.0, 12, 12),
        (0.1, 12, 1.2),
        (-0.1, 3, -0.3),
        (0.001, -32768, -32.768),
        (0.3, 3, 3 * 0.3),
        (2.5, 3, 7.5),
        (1e-320, 1, 1e-320),
    ],
)
def test_raw_value_has_its_decimal_form(scale, raw, value):
    assert Field("v", 0, "h", Mark.ASSUMED, scale=scale).value(raw) == value
