"""slcan text: golden lines, round trips, splits, garbage."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.can.frame import CanFrame
from protocol.can.slcan import LONGEST_LINE, LineDecoder, SlcanClient, decode_frame, encode_frame
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
def test_arbitrary_lines_decode_or_raise_remote_errors(line: bytes, timestamp: bool) -> None:
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
def test_invalid_lines_are_refused(line: bytes) -> None:
    with pytest.raises(RemoteProtocolError):
        decode_frame(line)


def test_bus_error_has_no_line() -> None:
    with pytest.raises(LocalProtocolError):
        encode_frame(CanFrame(0, error=True))


def test_endless_line_is_truncated_and_refused() -> None:
    decoder = LineDecoder()
    for _ in range(1000):
        assert decoder.feed(b"t" * 50) == []
    long, short = decoder.feed(b"0\rt0200\r")
    assert len(long) == LONGEST_LINE + 1
    with pytest.raises(RemoteProtocolError):
        decode_frame(long)
    assert decode_frame(short) == CanFrame(0x20)


def received_frames(client: SlcanClient, text: bytes, now: float = 7.0) -> list[CanFrame]:
    """Return the frames that the client decodes from a text."""
    client.receive(text, now)
    result = []
    while (frame := client.next_event()) is not None:
        result.append(frame)
    return result


def test_client_opens_its_channel_sends_and_closes() -> None:
    client = SlcanClient(1_000_000)
    assert client.data_to_send(7.0) == b"\r\r\rC\rS8\rO\r"
    assert SlcanClient().data_to_send(7.0) == b"\r\r\rC\rO\r"
    client.send([CanFrame(0x100, b"\x11\x33"), CanFrame(0x7FF, remote=True)])
    client.close()
    assert client.data_to_send(7.0) == b"t10021133\rr7FF0\rC\r"
    assert client.data_to_send(7.0) == b""
    assert client.next_deadline() is None
    client.handle_deadline(8.0)
    with pytest.raises(LocalProtocolError, match="cannot be sent over slcan"):
        client.send([CanFrame(0, error=True)])


def test_client_accepts_frames_with_and_without_time_stamp() -> None:
    client = SlcanClient()
    assert received_frames(client, b"\r\rz\rZ\r\aV1013\rv1013\rNA123\rF80\r\at10021133\rt1002113300FF\r") == [
        CanFrame(0x100, b"\x11\x33"),
        CanFrame(0x100, b"\x11\x33"),
    ]
    assert client.malformed == 0
    (frame,) = received_frames(client, b"t0200\r", 9.5)
    assert frame.received_at == 9.5


@pytest.mark.parametrize(
    "garbage",
    [
        b"t12",
        b"txyz0",
        b"t1008AABB",
        b"t1009000102030405060708",
        b"t-110",
        b"\xff\xfe\x80t1000",
        b"hello",
        b"x" * 5000,
    ],
)
def test_client_counts_garbage_and_accepts_the_next_frame(garbage: bytes) -> None:
    client = SlcanClient()
    assert received_frames(client, garbage) == []
    assert received_frames(client, b"\rt0200\r") == [CanFrame(0x020)]
    assert client.malformed == 1
