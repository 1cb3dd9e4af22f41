"""Register protocol: telegrams, start-up sequence and server, on a board with plain words."""

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.devices.jr3.registers import (
    BURST,
    MAX_WORDS,
    REQUEST,
    RESPONSE,
    Burst,
    ConnectionOver,
    Garbage,
    Op,
    Read,
    RegisterServer,
    RegisterServerProfile,
    Request,
    Reset,
    Response,
    Status,
    Wait,
    Write,
    command,
    encode_request,
    encode_response,
    request_reader,
    response_reader,
    start_up,
)
from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.fields import Layout
from tests.wire.plain_board import EPOCH, PROFILE, Words, perform, responses_of

# --- telegrams


GOLDEN_REQUESTS = {
    # Worked out by hand from the byte tables of docs/reference/jr3-registers.md.
    "4A52 01 01 1234 00A0 0052 00000000": Request(Op.READ, 0x1234, 0x00A0, 82),
    "4A52 02 01 0001 00E7 0001 00000000 0800": Request(Op.WRITE, 1, 0x00E7, 1, (0x0800,)),
    "4A52 03 01 FFFF 0000 0000 00000000": Request(Op.RESET, 0xFFFF),
    "4A52 05 01 0003 0000 0000 00000000": Request(Op.PROGRAM, 3),
    "4A52 05 01 0004 3FFF 0002 00000000 ABCD 0056": Request(Op.PROGRAM, 4, 0x3FFF, 2, (0xABCD, 0x56)),
    "4A52 04 0A 0002 0090 0062 000003E8": Request(Op.STREAM, 2, 0x0090, 98, (), 1000, 10),
}
GOLDEN_RESPONSES = {
    "6A72 02 00 0001 00E7 0001 00 00": Response(Op.WRITE, Status.OK, 1, 0x00E7, 1),
    "6A72 01 02 1234 FFFF 0052 00 00": Response(Op.READ, Status.OUTSIDE_MAP, 0x1234, 0xFFFF, 82),
    "6A72 01 00 0007 00A0 0002 01 00 0000000077359401 4000 FFFF": Response(
        Op.READ, Status.OK, 7, 0x00A0, 2, (Burst(2_000_000_001, (0x4000, 0xFFFF)),)
    ),
    "6A72 00 06 0000 0000 0000 00 00": Response(Op.CONNECTION, Status.TOO_MANY_CLIENTS, 0),
}

words = st.integers(0, 0xFFFF)
bytes_ = st.integers(0, 0xFF)
bursts = st.integers(0, 8).flatmap(
    lambda count: st.lists(
        st.builds(
            Burst, st.integers(0, 2**64 - 1), st.lists(words, min_size=count, max_size=count).map(tuple)
        ),
        max_size=3,
    ).map(lambda items: (count, tuple(items)))
)
writes = st.lists(words, min_size=1, max_size=MAX_WORDS).map(tuple)
requests = st.one_of(
    st.builds(
        Request,
        st.sampled_from([1, 3, 4, 99]),
        words,
        words,
        words,
        period_us=st.integers(0, 2**32 - 1),
        bursts=bytes_,
    ),
    st.builds(lambda tag, at, values: Request(Op.WRITE, tag, at, len(values), values), words, words, writes),
)
responses = st.builds(
    lambda op, status, tag, at, responses_of: Response(op, status, tag, at, *responses_of),
    bytes_,
    st.sampled_from(Status),
    words,
    words,
    bursts,
)


@pytest.mark.parametrize(("text", "request_"), GOLDEN_REQUESTS.items())
def test_golden_requests(text: str, request_: Request) -> None:
    assert encode_request(request_) == bytes.fromhex(text)
    assert request_reader().feed(bytes.fromhex(text)) == [request_]


@pytest.mark.parametrize(("text", "response"), GOLDEN_RESPONSES.items())
def test_golden_responses(text: str, response: Response) -> None:
    assert encode_response(response) == bytes.fromhex(text)
    assert response_reader().feed(bytes.fromhex(text)) == [response]


@given(st.lists(requests, max_size=3), st.lists(responses, max_size=3))
@settings(max_examples=100, deadline=None)
def test_round_trip(sent: list[Request], replies: list[Response]) -> None:
    assert request_reader().feed(b"".join(map(encode_request, sent))) == sent
    assert response_reader().feed(b"".join(map(encode_response, replies))) == replies


WIRE = (
    b"noise"
    + b"".join(map(bytes.fromhex, GOLDEN_REQUESTS))
    + b"J+"
    + bytes.fromhex(next(iter(GOLDEN_REQUESTS)))
)


@given(st.lists(st.integers(0, len(WIRE)), max_size=6).map(sorted))
@settings(max_examples=100, deadline=None)
def test_any_split_gives_the_same_telegrams(cuts: list[int]) -> None:
    reader = request_reader()
    result = [
        item
        for begin, end in zip([0, *cuts], [*cuts, len(WIRE)], strict=True)
        for item in reader.feed(WIRE[begin:end])
    ]
    assert result == request_reader().feed(WIRE)
    assert [type(item) for item in result] == [Garbage, *[Request] * len(GOLDEN_REQUESTS), Garbage, Request]


def test_every_single_cut_gives_the_same_telegrams() -> None:
    complete = request_reader().feed(WIRE)
    for cut in range(len(WIRE)):
        reader = request_reader()
        assert reader.feed(WIRE[:cut]) + reader.feed(WIRE[cut:]) == complete
    reader = request_reader()
    assert [item for byte in WIRE for item in reader.feed(bytes([byte]))] == complete


def test_garbage_then_valid_recovers() -> None:
    (golden, request_), *_ = GOLDEN_REQUESTS.items()
    for garbage in (
        b"\x00",
        b"JJ",
        b"GET / HTTP/1.1\r\n\r\n",
        bytes.fromhex("4A52 02 01 0001 00E7 0101 00000000"),
    ):
        garbage_report, result = request_reader().feed(garbage + bytes.fromhex(golden))
        assert isinstance(garbage_report, Garbage)
        assert result == request_
    (golden_response, response), *_ = GOLDEN_RESPONSES.items()
    for text in ("6A72 01 63 0000 0000 0000 00 00", "6A72 01 00 0000 0000 FFFF 01 00"):
        refused, answer = response_reader().feed(bytes.fromhex(text) + bytes.fromhex(golden_response))
        assert isinstance(refused, Garbage)
        assert answer == response


@given(st.binary(max_size=200), st.binary(max_size=40))
@settings(max_examples=200, deadline=None)
def test_arbitrary_bytes_do_no_harm(noise: bytes, more: bytes) -> None:
    for reader, magic in ((request_reader(), b"JR"), (response_reader(), b"jr")):
        reader.feed(noise)
        reader.feed(magic + more)


def test_unencodable_values_are_refused() -> None:
    for request_ in (
        Request(Op.WRITE, 1, 0, 0, ()),
        Request(Op.WRITE, 1, 0, 2, (1,)),
        Request(Op.WRITE, 1, 0, 257, (0,) * 257),
        Request(Op.PROGRAM, 1, 0, 2, (1,)),
        Request(Op.PROGRAM, 1, 0, 257, (0,) * 257),
        Request(Op.WRITE, 1, 0, 1, (70000,)),
        Request(Op.READ, 70000),
    ):
        with pytest.raises(LocalProtocolError):
            encode_request(request_)
    for response in (
        Response(Op.READ, Status.OK, 1, 0, 2, (Burst(0, (1,)),)),
        Response(Op.STREAM, Status.OK, 1, 0, 256, (Burst(0, (0,) * 256),) * 32),
    ):
        with pytest.raises(LocalProtocolError):
            encode_response(response)


@pytest.mark.parametrize("layout", [REQUEST, RESPONSE, BURST], ids=lambda layout: layout.name)
def test_page_shows_the_tables_of_the_code(layout: Layout) -> None:
    sizes = {"B": 1, "H": 2, "I": 4, "Q": 8}
    page = (Path(__file__).parents[2] / "docs" / "reference" / "jr3-registers.md").read_text(encoding="utf-8")
    rows = [f"| {f.offset} | {sizes[f.format]} | `{f.name}` | {f.meaning} |" for f in layout.fields]
    assert "\n".join(rows) in page
    for status in Status:
        assert f"| {status.value} | {status.meaning} |" in page


# --- start-up


def test_start_up_is_the_drivers() -> None:
    board = Words()
    identity, steps, took = perform(board, start_up(PROFILE))
    assert steps == [
        Reset(),
        Wait(0.025),
        *[step for _ in range(10) for step in (Read(0xF1, 9), Wait(1.0))],
        Read(0xF1, 9),
        Write(0x200, (0, 0)),
        Write(0xE7, (0x0500,)),
        Wait(0.02),
        Read(0xE7),
        Read(0x78, 6),
        Write(0x80, (400, 400, 800, 250, 250, 260)),
        Write(0xE7, (0x0A00,)),
        Wait(0.02),
        Read(0xE7),
        Write(0xE7, (0x0600,)),
        Wait(0.04),
        Read(0xE7),
        Write(0x88, (0,) * 6),
        Write(0xE7, (0x0700,)),
        Wait(0.02),
        Read(0xE7),
        Read(0x80, 6),
        Read(0xF8, 5),
    ]
    assert took == pytest.approx(10.125)
    assert (identity.serial_no, identity.model_no) == (4711, 67)
    assert identity.full_scales == (400.0, 400.0, 800.0, 25.0, 25.0, 26.0)


@pytest.mark.parametrize(
    ("units", "force", "moment"),
    [(0, 4.4482216, 0.11298483), (1, 1.0, 0.1), (2, 0.980665, 0.0980665), (3, 4448.2216, 112.98483)],
)
def test_full_scales_of_every_unit(units: int, force: float, moment: float) -> None:
    """Factors from the definitions of pound, inch and standard gravity."""
    board = Words()
    board.poke("units", units)
    identity, _, _ = perform(board, start_up(replace(PROFILE, offset_polls=0)))
    assert identity.full_scales[0] == pytest.approx(400 * force)
    assert identity.full_scales[5] == pytest.approx(260 * moment)


def test_changed_sensor_is_acknowledged_and_waited_for() -> None:
    board = Words()
    board.poke("errors", 0x0800)
    _, steps, took = perform(board, start_up(replace(PROFILE, offset_polls=2)))
    assert board.peek("errors") == [0]
    assert Write(0xE5, (0x0800, 0xF1, 0x0400)) in steps
    assert took == pytest.approx(0.025 + 0.02 + 3.0 + 0.1)


@pytest.mark.parametrize(
    ("name", "value", "text", "remedy"),
    [
        ("errors", 0x8000, "no sensor after 10 s .watch dog.", "is it plugged in?"),
        ("errors", 0x4000, "no sensor after 10 s .watch dog2.", "is it plugged in?"),
        ("serial_no", 0, "calibration has not been read after 10 s", "is it plugged in?"),
        ("model_no", 0, "calibration has not been read after 10 s", "is it plugged in?"),
        ("max_full_scale", 0, "full scale of fx is 0", "calibration not read?"),
        ("max_full_scale", -3, "full scale of fx is -3", "calibration not read?"),
        ("units", 4, "counts in unit 4", ""),
    ],
)
def test_impossible_start_up_is_refused(name: str, value: int, text: str, remedy: str) -> None:
    board = Words()
    board.poke(name, value)
    with pytest.raises(RemoteProtocolError, match=text) as raised:
        perform(board, start_up(replace(PROFILE, offset_polls=0)))
    assert raised.value.remedy == remedy


def test_command_that_fails_or_never_ends_raises() -> None:
    board = Words()
    board.answers = {0x0500: -1, 0x0D00: 0x0D00}
    with pytest.raises(RemoteProtocolError, match=r"command 0500 \(use transform\) failed with -1"):
        perform(board, command(PROFILE, 0x0500))
    with pytest.raises(RemoteProtocolError, match="command 0D00 has not ended after 1 s"):
        perform(board, command(PROFILE, 0x0D00))


# --- server


def exchange(server: RegisterServer, *telegrams: Request, now: float = EPOCH) -> list[Response | Garbage]:
    server.receive(b"".join(map(encode_request, telegrams)), now)
    return responses_of(server, now)


def test_server_reads_and_writes_and_resets() -> None:
    board = Words()
    server = RegisterServer(board, RegisterServerProfile(), EPOCH)
    assert exchange(
        server,
        Request(Op.WRITE, 1, 0x200, 2, (5, 6)),
        Request(Op.READ, 2, 0x1FF, 3),
        Request(Op.RESET, 3),
        now=EPOCH + 0.5,
    ) == [
        Response(Op.WRITE, Status.OK, 1, 0x200, 2),
        Response(Op.READ, Status.OK, 2, 0x1FF, 3, (Burst(4_322_000_000_000, (0, 5, 6)),)),
        Response(Op.RESET, Status.OK, 3),
    ]
    assert board.resets == 1
    assert server.next_event() is None


@pytest.mark.parametrize(
    ("request_", "status"),
    [
        (Request(Op.READ, 9, 0x4000, 1), Status.OUTSIDE_MAP),
        (Request(Op.READ, 9, 0x3FFF, 2), Status.OUTSIDE_MAP),
        (Request(Op.READ, 9, 0, 0), Status.BAD_COUNT),
        (Request(Op.READ, 9, 0, 257), Status.BAD_COUNT),
        (Request(Op.WRITE, 9, 0x3FFF, 2, (1, 2)), Status.OUTSIDE_MAP),
        (Request(Op.PROGRAM, 9, 0x3FFF, 4, (1, 2, 3, 4)), Status.OUTSIDE_MAP),
        (Request(Op.PROGRAM, 9, 0, 1, (1,)), Status.OUTSIDE_MAP),
        (Request(Op.RESET, 9), Status.REFUSED),
        (Request(77, 9), Status.UNKNOWN_OP),
        (Request(Op.CONNECTION, 9), Status.UNKNOWN_OP),
        (Request(Op.STREAM, 9, 0, 1, period_us=249), Status.BAD_PERIOD),
        (Request(Op.STREAM, 9, 0, 0, period_us=1000), Status.BAD_COUNT),
        (Request(Op.STREAM, 9, 0, 256, period_us=1000, bursts=32), Status.BAD_COUNT),
        (Request(Op.STREAM, 9, 0x4000, 1, period_us=1000), Status.OUTSIDE_MAP),
    ],
)
def test_server_gives_the_reason_for_a_refusal_and_continues(request_: Request, status: Status) -> None:
    board = Words()
    board.may_reset = False
    server = RegisterServer(board, RegisterServerProfile(), EPOCH)
    refused, served = exchange(server, request_, Request(Op.READ, 10, 0xF8, 1))
    assert isinstance(refused, Response)
    assert (refused.op, refused.status, refused.tag, refused.bursts) == (request_.op, status, 9, ())
    assert isinstance(served, Response)
    assert served.bursts[0].words == (4711,)
    assert server.next_event() is None
    assert server.next_deadline() == EPOCH + 60.0


def test_server_reports_lost_framing_and_restarts() -> None:
    server = RegisterServer(Words(), RegisterServerProfile(), EPOCH)
    server.receive(
        encode_request(Request(Op.STREAM, 1, 0, 1, period_us=1000))
        + b"GET / HTTP/1.1\r\n\r\n"
        + encode_request(Request(Op.READ, 2, 0, 1)),
        EPOCH,
    )
    assert responses_of(server, EPOCH) == [
        Response(Op.STREAM, Status.OK, 1, 0, 1),
        Response(Op.CONNECTION, Status.BAD_FRAME, 0),
    ]
    assert server.next_event() == ConnectionOver("no request begins with 47")
    assert server.next_deadline() == EPOCH + 60.0
    assert len(exchange(server, Request(Op.READ, 3, 0, 1))) == 1


def test_server_drops_the_silent_but_not_a_stream() -> None:
    server = RegisterServer(Words(), RegisterServerProfile(idle_timeout_s=2.0), EPOCH)
    exchange(server, Request(Op.READ, 1, 0, 1), now=EPOCH + 1.0)
    server.handle_deadline(EPOCH + 2.9)
    assert server.next_event() is None
    server.handle_deadline(EPOCH + 3.0)
    assert responses_of(server, EPOCH + 3.0) == [Response(Op.CONNECTION, Status.IDLE, 0)]
    assert server.next_event() == ConnectionOver("no request for 2 s")
    exchange(server, Request(Op.STREAM, 1, 0, 1, period_us=10_000_000), now=EPOCH + 4.0)
    assert server.next_deadline() == EPOCH + 14.0
    patient = RegisterServer(Words(), RegisterServerProfile(idle_timeout_s=0.0), EPOCH)
    assert patient.next_deadline() is None
    patient.handle_deadline(EPOCH + 1e6)
    assert patient.next_event() is None


def test_stream_is_paced_by_its_anchor_and_skips_missed_bursts() -> None:
    board = Words()
    server = RegisterServer(board, RegisterServerProfile(), EPOCH)
    exchange(server, Request(Op.STREAM, 5, 0xE9, 1, period_us=1000, bursts=2))
    stamps = []
    for late in (0.0, 0.0002, 0.0035, 0.0, 0.0, 0.0):
        now = (server.next_deadline() or 0.0) + late
        server.handle_deadline(now)
        for response in responses_of(server, now):
            assert isinstance(response, Response)
            assert (response.op, response.tag, response.count) == (Op.STREAM, 5, 1)
            assert len(response.bursts) == 2
            stamps += [burst.time_ns - 4_321_500_000_000 for burst in response.bursts]
    assert stamps == pytest.approx([1e6, 2.2e6, 6.5e6, 7e6, 8e6, 9e6], abs=2)
    assert exchange(server, Request(Op.STREAM, 6)) == [Response(Op.STREAM, Status.OK, 6)]
    assert (server.next_deadline() or 0.0) > EPOCH + 59.0


def test_flood_of_requests_is_answered_in_bounded_pieces() -> None:
    server = RegisterServer(Words(), RegisterServerProfile(), EPOCH)
    server.receive(encode_request(Request(Op.READ, 1, 0, 256)) * 200, EPOCH)
    pieces = [len(piece) for piece in iter(lambda: server.data_to_send(EPOCH), b"")]
    assert max(pieces) < 17_000
    assert sum(pieces) == 200 * (12 + 8 + 512)
