"""Conversion of CAN frames to text and back."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.can.frame import CanFrame
from protocol.can.text import parse_candump, parse_frame


@given(
    st.booleans(), st.integers(0, 0x1FFFFFFF), st.binary(max_size=8), st.sampled_from(["", "remote", "error"])
)
def test_frame_text_round_trips(extended: bool, number: int, data: bytes, mark: str) -> None:
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
        ("601#R9", "column 6: a remote frame requests 0 … 8 bytes"),
        ("601#R٣", "column 6: a remote frame requests 0 … 8 bytes"),
        ("601#" + 18 * "0", "column 21: a frame holds at most 8 bytes"),
    ],
)
def test_invalid_frame_is_reported_by_its_column(text: str, fault: str) -> None:
    with pytest.raises(ValueError, match=fault):
        parse_frame(text)


@pytest.mark.parametrize(
    ("line", "at", "channel", "frame"),
    [
        ("  can0  123   [8]  11 22 33 44 55 66 77 88", None, "can0", "123#1122334455667788"),
        (" (000.001000)  vcan0  00000123   [0] ", 0.001, "vcan0", "00000123#"),
        ("  can0  RX - -  123   [2]  AB CD   '..'", None, "can0", "123#ABCD"),
        ("  can0  123   [2]  remote request", None, "can0", "123#R2"),
        (
            " (2009-02-13 23:31:30.500000)  can0  20000004   [2]  00 01   ERRORFRAME",
            1234567890.5,
            "can0",
            "004!0001",
        ),
        ("(1436509052.249713) can0 123#1122", 1436509052.249713, "can0", "123#1122"),
        ("(1436509052.249713) can0 123#R", 1436509052.249713, "can0", "123#R"),
        ("(1436509052.249713) can0 1FFFFFFF#00 T\r", 1436509052.249713, "can0", "1FFFFFFF#00"),
    ],
)
def test_line_of_candump_is_read(line: str, at: float | None, channel: str, frame: str) -> None:
    read = parse_candump(line)
    assert read.at == at
    assert (read.channel, str(read.frame)) == (channel, frame)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("can0  123   [3]  11 22", r"\[3\] bytes are announced, but 2 are present"),
        ("can0  123   [1]  11 22", r"\[1\] bytes are announced, but 2 are present"),
        ("can0  123  [12]  11 22", "CAN FD"),
        ("(1.0) can0 123##1112233", "CAN FD"),
        ("(nan) can0 123#11", "invalid time 'nan'"),
        ("(noon) can0 123#11", "noon"),
        ("(1.0) can0 123#1", "half a byte"),
        ("can0  123   [2]  11`22", "not a line of candump"),
        ("can0  1234   [0]", "3 or 8 digits"),
        ("can0  123   [0] " + " 'a'" * 100 + "x", "not a line of candump"),
        ("", "not a line of candump"),
        ("0.1 S3 06", "not a line of candump"),
    ],
)
def test_other_line_than_of_candump_is_refused(line: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        parse_candump(line)
