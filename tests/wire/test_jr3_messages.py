"""Frames of the JR3 CAN gateway: golden bytes, round trips, and invalid frames."""

import contextlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.can.frame import CanFilter, CanFrame
from protocol.devices.jr3 import (
    Acknowledge,
    Command,
    Op,
    Triple,
    client_filters,
    decode_acknowledge,
    decode_command,
    decode_triple,
    describe,
    encode_acknowledge,
    encode_command,
    encode_sample,
    facts_of,
    full_scales_si,
    gateway_filters,
    identifier,
    parse_frame,
    split,
)
from protocol.devices.jr3.can_gateway.messages import ACKNOWLEDGED, FORCES, MOMENTS
from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.wrench import wrench_of

GOLDEN_COMMANDS = {
    # Example of the gateway firmware's description.
    "201#C80010270000": Command(Op.START_ASYNC, 1, cutoff_centihertz=200, period_us=10_000),
    # Worked out by hand from the firmware's op and payload tables.
    "080#": Command(Op.SYNC),
    "181#E803": Command(Op.START_SYNC, 1, cutoff_centihertz=1000),
    "2FF#": Command(Op.STOP, 127),
    "301#": Command(Op.ZERO, 1),
    "382#FFFF": Command(Op.SET_FILTER, 2, cutoff_centihertz=65535),
    "401#": Command(Op.GET_STATE, 1),
    "481#": Command(Op.GET_FORCE_FULL_SCALES, 1),
    "501#": Command(Op.GET_MOMENT_FULL_SCALES, 1),
    "581#": Command(Op.RESET, 1),
}


@pytest.mark.parametrize("text", GOLDEN_COMMANDS)
def test_golden_commands_feed_encoder_and_decoder(text: str) -> None:
    command = GOLDEN_COMMANDS[text]
    assert str(encode_command(command)) == text
    assert decode_command(parse_frame(text)) == command


def test_golden_answers() -> None:
    assert str(encode_acknowledge(1, Acknowledge(1))) == "101#01"
    # 115 111 185 N, then 56 52 61 in N·m×10: the ratings of a wrist sensor.
    assert str(encode_acknowledge(1, Acknowledge(0, (115, 111, 185)))) == "101#0073006F00B900"
    assert decode_acknowledge(bytes.fromhex("00380034003D00")) == Acknowledge(0, (56, 52, 61))
    forces, moments = encode_sample(1, (1, -1, 16384, -16384, 0, 256), 0x1234)
    assert str(forces) == "601#0100FFFF00403412"
    assert str(moments) == "681#00C0000000013412"
    assert decode_triple(forces.data, FORCES) == Triple((1, -1, 16384), 0x1234)
    assert decode_triple(moments.data, MOMENTS) == Triple((-16384, 0, 256), 0x1234)


@given(
    st.sampled_from(sorted(ACKNOWLEDGED)),
    st.integers(1, 127),
    st.integers(0, 65535),
    st.integers(0, 2**32 - 1),
)
def test_commands_survive_the_wire(op: Op, node: int, cutoff: int, period: int) -> None:
    carries_cutoff = op in (Op.START_SYNC, Op.START_ASYNC, Op.SET_FILTER)
    command = Command(op, node, cutoff if carries_cutoff else 0, period if op is Op.START_ASYNC else 0)
    assert decode_command(encode_command(command)) == command


words = st.integers(0, 65535)
counts = st.integers(-32768, 32767)


@given(st.integers(0, 255), st.none() | st.tuples(words, words, words))
def test_acknowledges_survive_the_wire(state: int, scales: tuple[int, int, int] | None) -> None:
    acknowledge = Acknowledge(state, scales)
    assert decode_acknowledge(encode_acknowledge(5, acknowledge).data) == acknowledge


@given(st.tuples(*[counts] * 6), words)
def test_samples_survive_the_wire(sample: tuple[int, ...], counter: int) -> None:
    forces, moments = encode_sample(127, sample, counter)
    one, two = decode_triple(forces.data, FORCES), decode_triple(moments.data, MOMENTS)
    assert (*one.counts, *two.counts) == sample
    assert one.counter == two.counter == counter


@given(st.integers(0, 0x7FF), st.binary(max_size=8))
@settings(max_examples=200)
def test_arbitrary_frames_decode_or_raise_remote_errors(number: int, data: bytes) -> None:
    frame = CanFrame(number, data)
    for decode in (
        lambda: decode_command(frame),
        lambda: decode_acknowledge(data),
        lambda: decode_triple(data, FORCES),
    ):
        with contextlib.suppress(RemoteProtocolError):
            decode()
    assert describe(frame)["identifier"] == f"{number:03X}"


@pytest.mark.parametrize(
    ("text", "cutoff", "period"),
    [("201#", 0, 0), ("201#C8", 0, 0), ("201#C800", 200, 0), ("201#C800102700", 200, 0), ("181#C8", 0, 0)],
)
def test_short_payload_counts_as_0(text: str, cutoff: int, period: int) -> None:
    command = decode_command(parse_frame(text))
    assert (command.cutoff_centihertz, command.period_us) == (cutoff, period)


def test_identifiers() -> None:
    assert split(0x6FF) == (Op.MOMENTS, 127)
    assert split(0x001) == (0, 1)
    assert identifier(Op.SYNC, 9) == 0x080
    for node in (0, 128, -1):
        with pytest.raises(LocalProtocolError, match="1 … 127"):
            identifier(Op.STOP, node)
    with pytest.raises(LocalProtocolError, match="FORCES is not a command"):
        encode_command(Command(Op.FORCES, 1))
    with pytest.raises(LocalProtocolError, match="cut-off"):
        encode_command(Command(Op.START_SYNC, 1, cutoff_centihertz=65536))
    for stranger in ("081#", "101#00", "001#", "781#00000000"):
        with pytest.raises(RemoteProtocolError, match="not a command"):
            decode_command(parse_frame(stranger))


def test_counts_and_units() -> None:
    scales = full_scales_si((115, 111, 185), (56, 52, 61))
    assert scales == (115.0, 111.0, 185.0, 5.6, 5.2, 6.1)
    facts = facts_of(scales, None, 0.0)
    assert facts.full_scales == scales
    assert facts.range == tuple(2.0 * scale for scale in scales)
    assert wrench_of((16384, -8192, 0, 16384, 0, -32768), facts.scales) == (
        115.0,
        -55.5,
        0.0,
        5.6,
        0.0,
        -12.2,
    )
    # Moments as the wire has it: count · (N·m×10) / 163840.
    assert wrench_of((0, 0, 0, 1234, 0, 0), facts.scales)[3] == pytest.approx(1234 * 56 / 163840)


def test_describe_has_values_with_units() -> None:
    items = describe(parse_frame("201#C80010270000"))
    rows = items.pop("fields")
    assert isinstance(rows, list)
    fields = {row["name"]: (row["value"], row["unit"]) for row in rows}
    assert fields == {"cutoff": (2.0, "Hz"), "period": (0.01, "s")}
    assert items == {
        "identifier": "201",
        "op": "start async",
        "node": 1,
        "direction": "to gateway",
        "acknowledged": True,
        "problems": [],
    }
    assert describe(parse_frame("601#0040000000000100"))["direction"] == "from gateway"
    assert describe(parse_frame("080#"))["problems"] == []
    scales = describe(parse_frame("101#0073006F00B900"))["fields"]
    assert isinstance(scales, list)
    assert [field["name"] for field in scales] == ["state", "x", "y", "z"]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("201#C8", "asynchronous start needs 6 bytes, got 1: missing bytes count as 0"),
        ("601#00", "forces needs 8 bytes, got 1"),
        ("401#00", "no data has 0 bytes, got 1: the rest is ignored"),
        ("081#", "SYNC is the bare 080: a gateway ignores it with a node"),
        ("400#", "node 0 is not a gateway"),
        ("001#", "000 is not an op of a gateway"),
        ("00000201#", "a gateway sends only data frames with 11-bit identifiers"),
        ("201#R", "a gateway sends only data frames with 11-bit identifiers"),
    ],
)
def test_describe_reports_problems(text: str, problem: str) -> None:
    assert describe(parse_frame(text))["problems"] == [problem]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("201", "column 4: a # between identifier and data is missing"),
        ("2x1#", "column 2: 'x' is not a hexadecimal digit"),
        ("21#", "column 1: an identifier has 3 or 8 digits, got 2"),
        ("800#", "column 1: identifier 800 is too large"),
        ("201#C8 0", "column 7: ' ' is not a hexadecimal digit"),
        ("201#C80", "column 8: half a byte at the end"),
        ("201#001122334455667788", "column 21: a frame holds at most 8 bytes"),
    ],
)
def test_wrong_text_is_refused_with_its_column(text: str, message: str) -> None:
    with pytest.raises(ValueError, match="column") as caught:
        parse_frame(text)
    assert str(caught.value) == message


@given(st.integers(0, 0x7FF), st.binary(max_size=8))
def test_text_of_frames_parses_back(number: int, data: bytes) -> None:
    frame = CanFrame(number, data)
    assert parse_frame(str(frame)) == frame


@given(st.sampled_from(sorted(Op)), st.integers(1, 127), st.integers(1, 127))
def test_filters_pass_the_frames_of_each_end(op: Op, node: int, other: int) -> None:
    def passes(filters: tuple[CanFilter, ...], of: int) -> bool:
        return any(choice.accepts(CanFrame(identifier(op, of))) for choice in filters)

    from_gateway = op in (Op.FORCES, Op.MOMENTS, Op.ACKNOWLEDGE, Op.BOOT_UP)
    assert passes(client_filters(node), node) == from_gateway
    assert passes(gateway_filters(node), node)
    if other != node:
        assert passes(client_filters(node), other) == (op in (Op.ACKNOWLEDGE, Op.BOOT_UP))
        assert passes(gateway_filters(node), other) == (op is Op.SYNC)
