"""slcan text: golden lines, round trips, splits, garbage."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.can.frame import CanFrame
from protocol.can.slcan import LONGEST_LINE, LineDecoder, decode_frame, encode_frame
from protocol.endpoint import LocalProtocolError, RemoteProtocolError

GOLDEN = {
    # Examples of the LAWICEL CAN232 manual.
    b"t10021133": CanFrame(0x100, b"\x11\x33"),
    b"t0200": CanFrame(0x020),
    b"T0000010021133": CanFrame(0x100, b"\x11\x33", extended=True),
    b"r1002": CanFrame(0x100, bytes(2), remote=True),
    b"R000001002": CanFrame(0x100, bytes(2), extended=True, remote=True),
    # The gateway's example 201#C80010270000.
    b"t2016C80010270000": CanFrame(0x201, bytes.fromhex("C80010270000")),
}


@pytest.mark.parametrize("line", GOLDEN)
def test_golden_lines_feed_encoder_and_decoder(line: bytes) -> None:
    assert encode_frame(GOLDEN[line]) == line + b"\r"
    assert decode_frame(line) == GOLDEN[line]


def test_time_stamps_are_four_digits_modulo_a_minute() -> None:
    frame = CanFrame(0x100, b"\x11")
    assert encode_frame(frame, 59_999) == b"t100111EA5F\r"
    assert encode_frame(frame, 60_001) == b"t1001110001\r"
    assert decode_frame(b"t100111EA5F", timestamp=True) == frame


def frames() -> st.SearchStrategy[CanFrame]:
    def build(extended: bool, remote: bool, number: int, data: bytes) -> CanFrame:
        limit = 0x1FFFFFFF if extended else 0x7FF
        return CanFrame(
            number & limit, bytes(len(data)) if remote else data, extended=extended, remote=remote
        )

    return st.builds(build, st.booleans(), st.booleans(), st.integers(0, 2**29 - 1), st.binary(max_size=8))


@given(frames(), st.none() | st.integers(0, 10**9))
def test_frames_survive_the_wire(frame: CanFrame, stamp: int | None) -> None:
    line = encode_frame(frame, stamp)
    assert len(line) <= LONGEST_LINE + 1
    assert decode_frame(line[:-1], timestamp=stamp is not None) == frame
    assert decode_frame(line[:-1].swapcase().swapcase(), timestamp=stamp is not None) == frame


@given(st.lists(frames(), max_size=8), st.data())
@settings(max_examples=100)
def test_any_split_gives_the_same_lines(sent: list[CanFrame], data: st.DataObject) -> None:
    text = b"".join(encode_frame(frame) for frame in sent) + b"t10"
    decoder, lines = LineDecoder(), []
    while text:
        size = data.draw(st.integers(1, len(text)))
        lines += decoder.feed(text[:size])
        text = text[size:]
    assert [decode_frame(line) for line in lines] == sent


@given(st.binary(max_size=200))
def test_garbage_then_valid_recovers(garbage: bytes) -> None:
    decoder = LineDecoder()
    lines = decoder.feed(garbage) + decoder.feed(b"\rt10021133\r")
    assert decode_frame(lines[-1]) == CanFrame(0x100, b"\x11\x33")


@given(st.binary(max_size=40) | st.from_regex(rb"[tTrR][0-9A-Fa-f]{0,36}", fullmatch=True), st.booleans())
def test_arbitrary_lines_raise_remote_errors_or_nothing(line: bytes, timestamp: bool) -> None:
    try:
        decode_frame(line, timestamp=timestamp)
    except RemoteProtocolError:
        return
    assert line[:1] in (b"t", b"T", b"r", b"R")


@pytest.mark.parametrize(
    "line",
    (b" t t100 t1009000000000000000000 t10021 t1002112233 t80000 t8000 T200000000 x1000 t100A t1-00 r10021133"
     b" t100\xb20").split(b" "),
)  # fmt: skip
def test_lines_that_are_no_frame(line: bytes) -> None:
    with pytest.raises(RemoteProtocolError):
        decode_frame(line)


def test_a_bus_error_has_no_line() -> None:
    with pytest.raises(LocalProtocolError):
        encode_frame(CanFrame(0, error=True))


def test_a_line_without_end_is_cut_and_no_frame() -> None:
    decoder = LineDecoder()
    for _ in range(1000):
        assert decoder.feed(b"t" * 50) == []
    long, short = decoder.feed(b"0\rt0200\r")
    assert len(long) == LONGEST_LINE + 1
    with pytest.raises(RemoteProtocolError):
        decode_frame(long)
    assert decode_frame(short) == CanFrame(0x20)
