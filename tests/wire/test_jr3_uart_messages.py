"""Frames of the JR3 UART gateway: golden bytes, round trips, splits, noise, and delimiters inside payloads."""

import contextlib
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.devices.jr3.uart_gateway import (
    COMMANDS,
    DATA_FRAME_S,
    FROM_GATEWAY,
    Acknowledge,
    Command,
    Data,
    Frame,
    Op,
    Reader,
    decode_acknowledge,
    decode_command,
    decode_data,
    describe,
    encode_acknowledge,
    encode_command,
    encode_data,
)
from protocol.devices.jr3.uart_gateway.messages import sendable_near
from protocol.endpoint import LocalProtocolError, RemoteProtocolError

# Worked out by hand from the firmware's table: `<`, two digits, payload, `>`.
GOLDEN_COMMANDS = {
    "3C 30 32 C8 00 10 27 00 00 3E": Command(Op.START, cutoff_centihertz=200, period_us=10_000),
    "3C 30 33 3E": Command(Op.STOP),
    "3C 30 34 3E": Command(Op.ZERO),
    "3C 30 35 E8 03 3E": Command(Op.SET_FILTER, cutoff_centihertz=1000),
    "3C 30 36 3E": Command(Op.GET_STATE),
    "3C 30 37 3E": Command(Op.GET_FULL_SCALES),
    "3C 30 38 3E": Command(Op.RESET),
}
GOLDEN_ANSWERS = {
    "3C 30 31 00 3E": Acknowledge(0),
    "3C 30 31 01 3E": Acknowledge(1),
    # 115 108 185 N, 56 52 61 in N·m×10: the ratings of a sensor that was on such a gateway.
    "3C 30 31 00 73 00 6C 00 B9 00 38 00 34 00 3D 00 3E": Acknowledge(0, (115, 108, 185, 56, 52, 61)),
    "3C 30 39 01 00 FF FF 00 40 00 C0 00 00 00 01 34 12 3E": Data((1, -1, 16384, -16384, 0, 256), 0x1234),
}


@pytest.mark.parametrize("text", GOLDEN_COMMANDS)
def test_golden_commands_feed_encoder_and_decoder(text: str) -> None:
    command, raw = GOLDEN_COMMANDS[text], bytes.fromhex(text)
    assert encode_command(command) == raw
    assert decode_command(int(raw[1:3]), raw[3:-1]) == command


@pytest.mark.parametrize("text", GOLDEN_ANSWERS)
def test_golden_answers_feed_encoders_and_decoders(text: str) -> None:
    answer, raw = GOLDEN_ANSWERS[text], bytes.fromhex(text)
    match answer:
        case Acknowledge():
            assert encode_acknowledge(answer) == raw
            assert decode_acknowledge(raw[3:-1]) == answer
        case Data():
            assert encode_data(answer.counts, answer.counter) == raw
            assert decode_data(raw[3:-1]) == answer


def test_boot_up_and_the_time_of_a_frame() -> None:
    assert bytes(Frame(Op.BOOT_UP)).hex(" ").upper() == "3C 31 30 3E"
    # 18 bytes of 10 bits at 115200 baud: 640 frames a second.
    assert DATA_FRAME_S == 1 / 640


def read(
    data: bytes, split: Callable[[bytes], list[bytes]] = lambda data: [data], *, scales_expected: bool = True
) -> tuple[list[Frame], Reader]:
    reader, frames = Reader(FROM_GATEWAY), []
    for part in split(data):
        reader.feed(part)
        while (frame := reader.next_frame(scales_expected=scales_expected)) is not None:
            frames.append(frame)
    return frames, reader


words = st.integers(0, 65535)
counts = st.integers(-32768, 32767)
samples = st.builds(lambda six, counter: encode_data(six, counter), st.tuples(*[counts] * 6), words)
states = st.builds(lambda state: encode_acknowledge(Acknowledge(state)), st.integers(0, 255))
# fx below 15422 N, as for every sensor there is: what a reader without context relies on.
scales = st.builds(
    lambda fx, rest: encode_acknowledge(Acknowledge(0, (fx, *rest))),
    st.integers(0, 0x3BFF),
    st.tuples(*[words] * 5),
)
answers = samples | states | scales | st.just(bytes(Frame(Op.BOOT_UP)))


@given(st.sampled_from(sorted(COMMANDS)), words, st.integers(0, 2**32 - 1))
def test_commands_survive_the_wire_or_are_refused(op: Op, cutoff: int, period: int) -> None:
    carries = op in (Op.START, Op.SET_FILTER)
    command = Command(op, cutoff if carries else 0, period if op is Op.START else 0)
    payload = (cutoff.to_bytes(2, "little") if carries else b"") + (
        period.to_bytes(4, "little") if op is Op.START else b""
    )
    if set(payload) & set(b"<>"):
        with pytest.raises(LocalProtocolError, match="contains 3C or 3E"):
            encode_command(command)
        return
    raw = encode_command(command)
    assert raw.count(b"<") == raw.count(b">") == 1
    assert decode_command(int(raw[1:3]), raw[3:-1]) == command


@given(st.integers(0, 255), st.none() | st.tuples(*[words] * 6))
def test_acknowledges_survive_the_wire(state: int, full_scales: tuple[int, ...] | None) -> None:
    acknowledge = Acknowledge(state, full_scales)
    assert decode_acknowledge(encode_acknowledge(acknowledge)[3:-1]) == acknowledge


@given(st.tuples(*[counts] * 6), words)
def test_samples_survive_the_wire(six: tuple[int, int, int, int, int, int], counter: int) -> None:
    (frame,), reader = read(encode_data(six, counter))
    assert decode_data(frame.payload) == Data(six, counter)
    assert reader.skipped == 0


@settings(max_examples=150)
@given(st.lists(answers, max_size=8), st.data())
def test_any_split_of_the_bytes_gives_the_same_frames(parts: list[bytes], data: st.DataObject) -> None:
    raw = b"".join(parts) + bytes(Frame(Op.BOOT_UP))

    def split(stream: bytes) -> list[bytes]:
        pieces = []
        while stream:
            size = data.draw(st.integers(1, len(stream)))
            pieces.append(stream[:size])
            stream = stream[size:]
        return pieces

    frames, reader = read(raw, split)
    assert [bytes(frame) for frame in frames] == [*parts, bytes(Frame(Op.BOOT_UP))]
    assert reader.skipped == 0


@settings(max_examples=150)
@given(st.binary(max_size=40).map(lambda noise: noise.replace(b"<", b"")), st.lists(answers, max_size=3))
def test_garbage_then_frames_recovers(noise: bytes, parts: list[bytes]) -> None:
    frames, reader = read(noise + b"".join(parts) + bytes(Frame(Op.BOOT_UP)))
    assert [bytes(frame) for frame in frames] == [*parts, bytes(Frame(Op.BOOT_UP))]
    assert (reader.skipped, reader.noises) == (len(noise), int(bool(noise)))


def test_endless_frame_is_searched_for_the_next_one() -> None:
    sample = encode_data((1, 2, 3, 4, 5, 6), 7)
    frames, reader = read(b"<09<01" + sample[:9] + sample + b"<\x00>" + sample)
    assert [bytes(frame) for frame in frames] == [sample, sample]
    assert (reader.skipped, reader.noises) == (15 + 3, 2)


def test_firmware_s_own_text_on_the_same_line_is_skipped() -> None:
    """Its console uses the same UART: lines of text are between the frames."""
    acknowledge = encode_acknowledge(Acknowledge(0))
    frames, reader = read(
        b"a line of text\n" + acknowledge + b"another\n" + acknowledge, scales_expected=False
    )
    assert [bytes(frame) for frame in frames] == [acknowledge, acknowledge]
    assert reader.noises == 2


@given(st.binary(max_size=120), st.integers(0, 255))
@settings(max_examples=200)
def test_arbitrary_bytes_decode_or_raise_remote_errors(raw: bytes, op: int) -> None:
    for decode in (
        lambda: decode_command(op, raw),
        lambda: decode_acknowledge(raw),
        lambda: decode_data(raw),
    ):
        with contextlib.suppress(RemoteProtocolError):
            decode()
    frames, reader = read(raw)
    read_bytes = sum(len(bytes(frame)) for frame in frames)
    assert 0 <= len(raw) - read_bytes - reader.skipped <= 17
    items = describe(raw)
    assert [item["offset"] for item in items] == [
        sum(i["size"] for i in items[:k]) for k in range(len(items))
    ]
    assert sum(item["size"] for item in items) == len(raw)


# --- delimiters inside payloads


@pytest.mark.parametrize("byte", [0x3C, 0x3E])
def test_delimiters_inside_payloads_are_data(byte: int) -> None:
    word = byte * 0x101
    sample = encode_data((word,) * 6, word)
    short = encode_acknowledge(Acknowledge(byte))
    # fx = 62 N or 60 N puts a delimiter where a short acknowledge would end.
    long = encode_acknowledge(Acknowledge(0, (byte, *(word,) * 5)))
    stream = sample + short + sample + long + short + long + sample
    frames, reader = read(stream)
    assert [bytes(frame) for frame in frames] == [sample, short, sample, long, short, long, sample]
    assert reader.skipped == 0


def test_reader_that_knows_the_request_need_not_wait() -> None:
    short = encode_acknowledge(Acknowledge(0))
    long = encode_acknowledge(Acknowledge(0, (115, 108, 185, 56, 52, 61)))
    assert len(read(short, scales_expected=False)[0]) == 1
    assert len(read(short)[0]) == 0
    # A late long one is still understood, unless its first scale looks like the end.
    assert len(read(long, scales_expected=False)[0][0].payload) == 13


def test_acknowledge_of_another_length_is_noise() -> None:
    frames, reader = read(b"<01\x00\x00>" + bytes(20) + bytes(Frame(Op.BOOT_UP)))
    assert [frame.op for frame in frames] == [Op.BOOT_UP]
    assert reader.skipped == 26


def test_commands_that_the_gateway_would_misread_are_refused() -> None:
    with pytest.raises(LocalProtocolError, match=r"cut-off 3E 00 contains 3C or 3E"):
        encode_command(Command(Op.SET_FILTER, cutoff_centihertz=62))
    with pytest.raises(LocalProtocolError, match="DATA is not a command"):
        encode_command(Command(Op.DATA))
    with pytest.raises(LocalProtocolError, match="cut-off"):
        encode_command(Command(Op.SET_FILTER, cutoff_centihertz=65536))
    with pytest.raises(RemoteProtocolError, match="09 is not a command"):
        decode_command(9, b"")
    assert sendable_near(61, 2) == (61,)
    assert sendable_near(60, 2) == (59, 61)
    assert sendable_near(16_000, 4) == (15_871, 16_128)
    # A sendable 3D lies between 3C and 3E.
    assert sendable_near(0x3C80, 2) == (0x3BFF, 0x3D00)


@pytest.mark.parametrize(
    ("payload", "cutoff", "period"),
    [("", 0, 0), ("C8", 0, 0), ("C800", 200, 0), ("C800102700", 200, 0), ("C80010270000", 200, 10_000)],
)
def test_short_payload_counts_as_0(payload: str, cutoff: int, period: int) -> None:
    assert decode_command(2, bytes.fromhex(payload)) == Command(Op.START, cutoff, period)


# --- for people


def test_describe_has_frames_of_both_directions_and_noise() -> None:
    start = bytes.fromhex("3C3032C800102700003E")
    scales = bytes.fromhex("3C3031003E006C00B900380034003D003E")
    items = describe(b"x" + start + scales + bytes.fromhex("3C3031003E") + b"<0")
    noise, command, long, short, tail = items
    assert (noise["kind"], noise["size"], noise["bytes"]) == ("noise", 1, "78")
    fields = {field["name"]: (field["value"], field["unit"]) for field in command.pop("fields")}
    assert fields == {"cutoff": (2.0, "Hz"), "period": (0.01, "s")}
    assert command == {
        "offset": 1,
        "size": 10,
        "kind": "frame",
        "op": "start",
        "direction": "to gateway",
        "acknowledged": True,
        "problems": [],
    }
    values = {field["name"]: (field["value"], field["unit"]) for field in long["fields"]}
    assert values["fx"] == (62, "N")
    assert values["mz"] == (pytest.approx(6.1), "N·m")
    assert (short["direction"], short["acknowledged"], len(short["fields"])) == ("from gateway", False, 1)
    assert (tail["offset"], tail["bytes"]) == (33, "3C 30")


def test_describe_reports_what_a_gateway_would_misread() -> None:
    (item,) = describe(bytes.fromhex("3C30353E003E"))
    assert item["problems"] == [
        "the payload contains 3C or 3E: the gateway interprets it as < or > and misreads the frame"
    ]
