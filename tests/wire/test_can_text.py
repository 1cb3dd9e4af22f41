"""A CAN frame as text and back."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.can.frame import CanFrame
from protocol.can.text import parse_frame


@given(
    st.booleans(), st.integers(0, 0x1FFFFFFF), st.binary(max_size=8), st.sampled_from(["", "remote", "error"])
)
def test_a_frame_comes_back_whole(extended: bool, number: int, data: bytes, mark: str) -> None:
    identifier = number if extended else number & 0x7FF
    content = bytes(len(data)) if mark == "remote" else data
    frame = CanFrame(identifier, content, extended, remote=mark == "remote", error=mark == "error")
    assert parse_frame(str(frame)) == frame


@given(st.text(max_size=30))
def test_any_text_is_a_frame_or_a_value_error(text: str) -> None:
    try:
        frame = parse_frame(text)
    except ValueError:
        return
    assert frame.checked() == parse_frame(str(frame))


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("601", "column 4: a #"),
        ("6G1#", "column 2: 'G'"),
        ("60#", "column 1: an identifier has 3 or 8 digits"),
        ("801#", "column 1: identifier 801 is too large"),
        ("601#0", "column 6: half a byte"),
        ("601#R9", "column 6: a remote frame asks for 0 … 8 bytes"),
        ("601#R٣", "column 6: a remote frame asks for 0 … 8 bytes"),
        ("601#" + 18 * "0", "column 21: a frame holds at most 8 bytes"),
    ],
)
def test_what_is_no_frame_is_told_by_its_column(text: str, fault: str) -> None:
    with pytest.raises(ValueError, match=fault):
        parse_frame(text)
