"""The register protocol: telegrams, server, start-up sequence and client, on a board of plain words."""

import itertools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.devices.jr3.board import (
    REGISTERS,
    CommandCode,
    check_instructions,
    check_range,
    from_signed,
    pack_words,
)
from protocol.devices.jr3.registers import (
    BURST,
    FILTER_DELAYS,
    MAX_WORDS,
    REQUEST,
    RESPONSE,
    BoardClient,
    BoardClientProfile,
    BoardPhase,
    Burst,
    ConnectionOver,
    Garbage,
    Load,
    Op,
    ProgramWord,
    Read,
    RegisterServer,
    RegisterServerProfile,
    Request,
    Reset,
    ResetRefused,
    Response,
    Status,
    Step,
    Steps,
    Wait,
    Write,
    command,
    encode_request,
    encode_response,
    farewell,
    filter_tick,
    request_reader,
    response_reader,
    start_up,
)
from protocol.endpoint import LocalProtocolError, RemoteProtocolError, Trouble
from protocol.fields import Layout
from protocol.wrench import (
    SensorEvent,
    SensorFailed,
    SensorNotice,
    SensorReady,
    SensorRestarted,
    SensorStopped,
    WrenchFrame,
    Zeroed,
)

EPOCH = 4321.5
"""Virtual time begins anywhere but at 0."""

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
    ).map(lambda found: (count, tuple(found)))
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
    lambda op, status, tag, at, told: Response(op, status, tag, at, *told),
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
def test_round_trip(asked: list[Request], answered: list[Response]) -> None:
    assert request_reader().feed(b"".join(map(encode_request, asked))) == asked
    assert response_reader().feed(b"".join(map(encode_response, answered))) == answered


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
    found = [
        item
        for begin, end in zip([0, *cuts], [*cuts, len(WIRE)], strict=True)
        for item in reader.feed(WIRE[begin:end])
    ]
    assert found == request_reader().feed(WIRE)
    assert [type(item) for item in found] == [Garbage, *[Request] * len(GOLDEN_REQUESTS), Garbage, Request]


def test_every_single_cut_gives_the_same_telegrams() -> None:
    whole = request_reader().feed(WIRE)
    for cut in range(len(WIRE)):
        reader = request_reader()
        assert reader.feed(WIRE[:cut]) + reader.feed(WIRE[cut:]) == whole
    reader = request_reader()
    assert [item for byte in WIRE for item in reader.feed(bytes([byte]))] == whole


def test_garbage_then_valid_recovers() -> None:
    (golden, request_), *_ = GOLDEN_REQUESTS.items()
    for garbage in (
        b"\x00",
        b"JJ",
        b"GET / HTTP/1.1\r\n\r\n",
        bytes.fromhex("4A52 02 01 0001 00E7 0101 00000000"),
    ):
        told, found = request_reader().feed(garbage + bytes.fromhex(golden))
        assert isinstance(told, Garbage)
        assert found == request_
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


def test_what_cannot_be_said_is_refused() -> None:
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
def test_the_page_shows_the_tables_of_the_code(layout: Layout) -> None:
    sizes = {"B": 1, "H": 2, "I": 4, "Q": 8}
    page = (Path(__file__).parents[2] / "docs" / "reference" / "jr3-registers.md").read_text(encoding="utf-8")
    rows = [f"| {f.offset} | {sizes[f.format]} | `{f.name}` | {f.meaning} |" for f in layout.fields]
    assert "\n".join(rows) in page
    for status in Status:
        assert f"| {status.value} | {status.meaning} |" in page


# --- a board of plain words


class Words:
    """Memory of a board that does commands in no time; filter2 says what is put there."""

    def __init__(self) -> None:
        self.memory = [0] * 0x4000
        self.resets = 0
        self.may_reset = True
        self.commands: list[int] = []
        self.loads: list[tuple[int, ...]] = []
        self.answers: dict[int, int] = {}
        """Next value of command_word0, by command; 0 otherwise."""
        self.poke("serial_no", 4711)
        self.poke("model_no", 67)
        self.poke("units", 1)
        for i, scale in enumerate((400, 400, 800, 250, 250, 260)):
            self.poke("max_full_scale", scale, i)

    def poke(self, name: str, value: int, index: int = 0) -> None:
        self.memory[REGISTERS[name].address + index] = from_signed(value)

    def peek(self, name: str, count: int = 1) -> list[int]:
        at = REGISTERS[name].address
        return self.memory[at : at + count]

    def read(self, address: int, count: int, now: float) -> tuple[int, ...]:
        check_range(address, count)
        return tuple(self.memory[address : address + count])

    def burst(self, address: int, count: int, now: float) -> bytes:
        return pack_words(self.read(address, count, now))

    def write(self, address: int, words: Sequence[int], now: float) -> None:
        check_range(address, len(words))
        self.memory[address : address + len(words)] = words
        if address <= 0xE7 < address + len(words):
            code = self.memory[0xE7]
            self.commands.append(code)
            if code == CommandCode.BIT_RESET:
                self.memory[self.memory[0xE6]] &= ~self.memory[0xE5]
            self.memory[0xE7] = from_signed(self.answers.get(code, 0))

    def reset(self, now: float) -> None:
        if not self.may_reset:
            raise ResetRefused("not this one")
        self.resets += 1

    def load(self, address: int, words: Sequence[int], now: float) -> None:
        check_instructions(address, words)
        self.loads.append((address, *words))


def tick(board: Words, counter: int, fz: int = 0, number: int = 2) -> None:
    board.poke(f"filter{number}", fz, 2)
    board.poke(f"count{max(number, 1)}", counter)


def perform(board: Words, sequence: Steps[Any], now: float = EPOCH) -> tuple[Any, list[Step], float]:
    """Run a sequence straight on a board: what it came to, its steps, and how long it took."""
    steps: list[Step] = []
    begin = now
    try:
        step = next(sequence)
        while True:
            steps.append(step)
            answer: Sequence[int] = ()
            match step:
                case Read(address, count):
                    answer = board.read(address, count, now)
                case Write(address, values):
                    board.write(address, values, now)
                case Reset():
                    board.reset(now)
                case Load(address, values):
                    board.load(address, values, now)
                case Wait(duration):
                    now += duration
            step = sequence.send(answer)
    except StopIteration as end:
        return end.value, steps, now - begin


# --- start-up

PROFILE = BoardClientProfile()


def test_the_start_up_is_the_drivers() -> None:
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


def test_a_changed_sensor_is_acknowledged_and_waited_for() -> None:
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
        ("serial_no", 0, "calibration is not read after 10 s", "is it plugged in?"),
        ("model_no", 0, "calibration is not read after 10 s", "is it plugged in?"),
        ("max_full_scale", 0, "full scale of fx is 0", "calibration not read?"),
        ("max_full_scale", -3, "full scale of fx is -3", "calibration not read?"),
        ("units", 4, "counts in unit 4", ""),
    ],
)
def test_start_up_that_cannot_be(name: str, value: int, text: str, remedy: str) -> None:
    board = Words()
    board.poke(name, value)
    with pytest.raises(RemoteProtocolError, match=text) as raised:
        perform(board, start_up(replace(PROFILE, offset_polls=0)))
    assert raised.value.remedy == remedy


def test_a_command_that_fails_or_never_ends() -> None:
    board = Words()
    board.answers = {0x0500: -1, 0x0D00: 0x0D00}
    with pytest.raises(RemoteProtocolError, match=r"command 0500 \(use transform\) failed with -1"):
        perform(board, command(PROFILE, 0x0500))
    with pytest.raises(RemoteProtocolError, match="command 0D00 has no end after 1 s"):
        perform(board, command(PROFILE, 0x0D00))


# --- server


def asked(server: RegisterServer, *telegrams: Request, now: float = EPOCH) -> list[Response | Garbage]:
    server.receive(b"".join(map(encode_request, telegrams)), now)
    return told(server, now)


def told(server: RegisterServer, now: float) -> list[Response | Garbage]:
    reader, found = response_reader(), list[Response | Garbage]()
    while data := server.data_to_send(now):
        found += reader.feed(data)
    return found


def test_server_reads_and_writes_and_resets() -> None:
    board = Words()
    server = RegisterServer(board, RegisterServerProfile(), EPOCH)
    assert asked(
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
def test_server_says_why_not_and_goes_on(request_: Request, status: Status) -> None:
    board = Words()
    board.may_reset = False
    server = RegisterServer(board, RegisterServerProfile(), EPOCH)
    refused, served = asked(server, request_, Request(Op.READ, 10, 0xF8, 1))
    assert isinstance(refused, Response)
    assert (refused.op, refused.status, refused.tag, refused.bursts) == (request_.op, status, 9, ())
    assert isinstance(served, Response)
    assert served.bursts[0].words == (4711,)
    assert server.next_event() is None
    assert server.next_deadline() == EPOCH + 60.0


def test_server_tells_whom_it_lost_and_begins_anew() -> None:
    server = RegisterServer(Words(), RegisterServerProfile(), EPOCH)
    server.receive(
        encode_request(Request(Op.STREAM, 1, 0, 1, period_us=1000))
        + b"GET / HTTP/1.1\r\n\r\n"
        + encode_request(Request(Op.READ, 2, 0, 1)),
        EPOCH,
    )
    assert told(server, EPOCH) == [
        Response(Op.STREAM, Status.OK, 1, 0, 1),
        Response(Op.CONNECTION, Status.BAD_FRAME, 0),
    ]
    assert server.next_event() == ConnectionOver("no request begins with 47")
    assert server.next_deadline() == EPOCH + 60.0
    assert len(asked(server, Request(Op.READ, 3, 0, 1))) == 1


def test_server_drops_the_silent_but_not_a_stream() -> None:
    server = RegisterServer(Words(), RegisterServerProfile(idle_timeout_s=2.0), EPOCH)
    asked(server, Request(Op.READ, 1, 0, 1), now=EPOCH + 1.0)
    server.handle_deadline(EPOCH + 2.9)
    assert server.next_event() is None
    server.handle_deadline(EPOCH + 3.0)
    assert told(server, EPOCH + 3.0) == [Response(Op.CONNECTION, Status.IDLE, 0)]
    assert server.next_event() == ConnectionOver("no request for 2 s")
    asked(server, Request(Op.STREAM, 1, 0, 1, period_us=10_000_000), now=EPOCH + 4.0)
    assert server.next_deadline() == EPOCH + 14.0
    patient = RegisterServer(Words(), RegisterServerProfile(idle_timeout_s=0.0), EPOCH)
    assert patient.next_deadline() is None
    patient.handle_deadline(EPOCH + 1e6)
    assert patient.next_event() is None


def test_stream_is_paced_by_its_anchor_and_leaves_out_what_it_missed() -> None:
    board = Words()
    server = RegisterServer(board, RegisterServerProfile(), EPOCH)
    asked(server, Request(Op.STREAM, 5, 0xE9, 1, period_us=1000, bursts=2))
    stamps = []
    for late in (0.0, 0.0002, 0.0035, 0.0, 0.0, 0.0):
        now = (server.next_deadline() or 0.0) + late
        server.handle_deadline(now)
        for response in told(server, now):
            assert isinstance(response, Response)
            assert (response.op, response.tag, response.count) == (Op.STREAM, 5, 1)
            assert len(response.bursts) == 2
            stamps += [burst.time_ns - 4_321_500_000_000 for burst in response.bursts]
    assert stamps == pytest.approx([1e6, 2.2e6, 6.5e6, 7e6, 8e6, 9e6], abs=2)
    assert asked(server, Request(Op.STREAM, 6)) == [Response(Op.STREAM, Status.OK, 6)]
    assert (server.next_deadline() or 0.0) > EPOCH + 59.0


def test_a_flood_of_requests_is_answered_in_bounded_pieces() -> None:
    server = RegisterServer(Words(), RegisterServerProfile(), EPOCH)
    server.receive(encode_request(Request(Op.READ, 1, 0, 256)) * 200, EPOCH)
    pieces = [len(piece) for piece in iter(lambda: server.data_to_send(EPOCH), b"")]
    assert max(pieces) < 17_000
    assert sum(pieces) == 200 * (12 + 8 + 512)


# --- client


class Pair:
    """A client and its server, joined without a wire; time goes from deadline to deadline."""

    def __init__(
        self, board: Words, profile: BoardClientProfile, program: Sequence[ProgramWord] = ()
    ) -> None:
        self.now = EPOCH
        self.board = board
        self.server = RegisterServer(board, RegisterServerProfile(), self.now)
        self.client = BoardClient(profile, self.now, program)
        self.events: list[SensorEvent] = []
        self.cut = False

    def exchange(self) -> None:
        while True:
            up = self.client.data_to_send(self.now)
            self.server.receive(up, self.now)
            down = b"" if self.cut else self.server.data_to_send(self.now)
            self.client.receive(down, self.now)
            while (event := self.client.next_event()) is not None:
                self.events.append(event)
            if not up and not down:
                return

    def run(self, until: float) -> list[SensorEvent]:
        """Go on to a time since the epoch; the events since the last call."""
        self.exchange()
        while True:
            ends = (self.client, self.server)
            due = min(d for d in (*(end.next_deadline() for end in ends), float("inf")) if d is not None)
            if due > EPOCH + until:
                break
            self.now = due
            for end in ends:
                end.handle_deadline(due)
            self.exchange()
        self.now = EPOCH + until
        events, self.events = self.events, []
        return events

    def frames(self, until: float) -> list[WrenchFrame]:
        return [event for event in self.run(until) if isinstance(event, WrenchFrame)]


FAST = BoardClientProfile(offset_polls=0)


class Ticking(Words):
    """Counts filter2's outputs, 2000 a second, as the time goes; fz is 100."""

    def read(self, address: int, count: int, now: float) -> tuple[int, ...]:
        number = round((now - EPOCH) * 2000) - self.behind
        if not self.still:
            self.poke("count2", number)
            self.poke("count1", 4 * number)
        return super().read(address, count, now)

    still = False
    behind = 0


@pytest.fixture
def pair() -> Pair:
    board = Ticking()
    tick(board, 0, 100)
    pair = Pair(board, FAST)
    pair.run(0.225)
    assert pair.client.phase is BoardPhase.READY
    return pair


def test_client_starts_up_and_streams() -> None:
    board = Ticking()
    tick(board, 0, 100)
    pair = Pair(board, BoardClientProfile())
    notice, ready, *others = pair.run(10.325)
    frames = [event for event in others if isinstance(event, WrenchFrame)]
    assert frames == others
    assert board.resets == 1
    assert board.commands == [0x0500, 0x0A00, 0x0600, 0x0700]
    assert notice == SensorNotice("board: sensor model 67, serial number 4711")
    assert isinstance(ready, SensorReady)
    assert ready.facts.full_scales == (400.0, 400.0, 800.0, 25.0, 25.0, 26.0)
    assert ready.facts.model == "sensor model 67, serial number 4711"
    # start-up 10.125 s, settling 15 × 6.598 ms, then a sample every 10 ms
    assert [frame.at - EPOCH for frame in frames] == pytest.approx(
        [10.22397 + 0.01 * k for k in range(1, 11)]
    )
    assert {frame.values for frame in frames} == {(0, 0, 100, 0, 0, 0)}
    assert {b.sequence - a.sequence for a, b in itertools.pairwise(frames)} == {20}
    assert (ready.facts.delay, ready.facts.period) == (FILTER_DELAYS[2], 0.01)
    assert pair.client.statistics.lost == pair.client.statistics.repeated == 0


def test_client_polls_as_it_streams() -> None:
    board = Ticking()
    pair = Pair(board, replace(FAST, mode="poll", period_ms=1.0, filter=1))
    frames = pair.frames(0.5)
    assert len(frames) > 300
    assert {round((b.at - a.at) * 1e6) for a, b in itertools.pairwise(frames)} == {1000}
    assert {b.sequence - a.sequence for a, b in itertools.pairwise(frames)} == {8}


def test_bursts_that_come_together_are_dated_apart() -> None:
    board = Ticking()
    pair = Pair(board, replace(FAST, period_ms=1.0, bursts=10))
    frames = pair.frames(0.5)
    assert len(frames) % 10 == 0
    assert {round((b.at - a.at) * 1e6) for a, b in itertools.pairwise(frames)} == {1000}


def test_no_burst_is_dated_before_one_that_came_earlier() -> None:
    """A delivery that was held up is dated late as a whole; the next comes in time."""
    pair = Pair(Ticking(), replace(FAST, period_ms=1.0, bursts=10))
    pair.frames(0.3)
    held, pair.now = b"", EPOCH + 0.3
    while not held:
        pair.now = pair.server.next_deadline() or 0.0
        pair.server.handle_deadline(pair.now)
        held = pair.server.data_to_send(pair.now)
    delivered = pair.now
    pair.client.receive(held, delivered + 0.008)
    late, in_time = pair.frames(0.3)[-10:], pair.frames(delivered - EPOCH + 0.0105)[-10:]
    assert [frame.at - delivered for frame in late] == pytest.approx([k * 1e-3 for k in range(-1, 9)])
    assert [frame.at - delivered for frame in in_time] == pytest.approx([0.008] * 8 + [0.009, 0.01])


def test_counter_wraps_without_a_gap(pair: Pair) -> None:
    frames = pair.frames(70.0)
    assert max(frame.counter for frame in frames) > 65500
    assert {b.sequence - a.sequence for a, b in itertools.pairwise(frames)} == {20}
    assert pair.client.statistics.lost == 0


def test_a_late_server_is_counted(pair: Pair) -> None:
    pair.frames(0.3)
    pair.now += 0.05
    pair.server.handle_deadline(pair.now)
    pair.exchange()
    pair.frames(1.0)
    assert pair.client.statistics.lost in (4, 5)


def test_zero_is_told_once_it_has_settled(pair: Pair) -> None:
    pair.client.zero()
    events = pair.run(0.5)
    at = next(i for i, event in enumerate(events) if isinstance(event, Zeroed))
    before = events[at - 1]
    assert isinstance(before, WrenchFrame)
    assert before.at - EPOCH == pytest.approx(0.225 + 0.02 + 0.099, abs=0.011)
    assert pair.board.commands[-1] == 0x0800
    assert sum(isinstance(event, Zeroed) for event in events) == 1


def test_a_zero_before_the_start_up_is_over_waits_for_it() -> None:
    pair = Pair(Ticking(), FAST)
    pair.client.zero()
    events = [event for event in pair.run(1.0) if not isinstance(event, WrenchFrame)]
    assert [type(event) for event in events] == [SensorNotice, SensorReady, Zeroed]


def test_stop_ends_the_stream(pair: Pair) -> None:
    pair.client.stop()
    assert pair.run(1.0)[-1] == SensorStopped()
    assert pair.client.phase is BoardPhase.STOPPED
    assert pair.client.next_deadline() is None
    pair.client.stop()
    assert pair.run(2.0) == []
    with pytest.raises(LocalProtocolError, match="cannot zero: the session is stopped"):
        pair.client.zero()


def test_stop_without_a_stream_is_at_once() -> None:
    pair = Pair(Words(), FAST)
    pair.client.stop()
    assert pair.run(0.0) == [SensorStopped()]
    pair.client.receive(encode_response(Response(Op.RESET, Status.OK, 1)), EPOCH)
    assert pair.run(1.0) == []


def test_a_server_that_does_not_answer_the_stop(pair: Pair) -> None:
    pair.cut = True
    pair.client.stop()
    (failed,) = (event for event in pair.run(2.0) if isinstance(event, SensorFailed))
    assert failed.text == "board: the server has not answered for 1 s"
    assert pair.client.stop_patience == 1.0


def test_a_refused_reset_is_told_and_passed_over() -> None:
    board = Ticking()
    board.may_reset = False
    events = Pair(board, FAST).run(1.0)
    assert isinstance(events[0], SensorNotice)
    assert "does not reset" in events[0].text
    assert isinstance(events[2], SensorReady)


PROGRAM = (
    *(ProgramWord(0x10 + k, k, 0xEF) for k in range(130)),
    ProgramWord(0x3FFF, 0xABCD, 0x56),
)


def test_a_program_is_loaded_between_the_reset_and_the_pause_after_it() -> None:
    board = Ticking()
    _, steps, _ = perform(board, start_up(FAST, PROGRAM))
    assert [type(step) for step in steps[:6]] == [Load, Load, Load, Load, Wait, Read]
    assert [(load[0], len(load) - 1) for load in board.loads] == [(0, 0), (0x10, 256), (0x90, 4), (0x3FFF, 2)]
    assert board.loads[2:] == [(0x90, 128, 0xEF, 129, 0xEF), (0x3FFF, 0xABCD, 0x56)]
    assert board.resets == 0


def test_a_client_with_a_program_starts_up_over_its_server() -> None:
    board = Ticking()
    board.may_reset = False
    pair = Pair(board, FAST, PROGRAM)
    _, ready, *_ = pair.run(1.0)
    assert isinstance(ready, SensorReady)
    assert [load[0] for load in board.loads] == [0, 0x10, 0x90, 0x3FFF]


def test_a_program_outside_the_processor_s_memory_is_refused() -> None:
    pair = Pair(Ticking(), FAST, (ProgramWord(0x4000, 1, 2),))
    assert failure(pair.run(1.0)) == (
        "board: the server refuses a program: words outside the board's memory map"
    )
    with pytest.raises(ValueError, match="program is loaded by start_up = driver alone"):
        BoardClientProfile(program="x.idm", start_up="none")


def test_a_second_client_takes_the_board_as_it_is() -> None:
    board = Ticking()
    for i in range(6):
        board.poke("full_scale", 100 + i, i)
    ready = next(
        e for e in Pair(board, replace(FAST, start_up="none")).run(0.2) if isinstance(e, SensorReady)
    )
    assert ready.facts.full_scales == (100.0, 101.0, 102.0, 10.3, 10.4, 10.5)
    assert (board.resets, board.commands) == (0, [])


def failure(events: list[SensorEvent]) -> str:
    (failed,) = [event for event in events if isinstance(event, SensorFailed)]
    return str(Trouble(failed.text, failed.remedy))


def test_an_unplugged_sensor_ends_the_session(pair: Pair) -> None:
    pair.board.poke("errors", 0xC000)
    assert failure(pair.run(1.0)) == (
        "board: it hears no sensor (watch dog2, watch dog); check the sensor's plug and cable"
    )
    assert pair.client.phase is BoardPhase.FAILED
    assert pair.run(100.0) == []


def test_a_changed_sensor_begins_again_without_a_reset(pair: Pair) -> None:
    before = pair.frames(0.3)[-1].sequence
    pair.board.poke("errors", 0x0800)
    events = pair.run(3.0)
    kinds = [type(event) for event in events if not isinstance(event, WrenchFrame)]
    assert kinds == [SensorRestarted, SensorNotice, SensorReady]
    assert pair.board.resets == 1
    first = next(event for event in events if isinstance(event, WrenchFrame))
    assert first.sequence == before + 1


def test_a_calibration_that_is_read_again_is_seen_while_it_is_read(pair: Pair) -> None:
    """The same sensor plugged in again sets no `sensor changed`, but its offsets are lost."""
    pair.frames(0.3)
    pair.board.poke("errors", 0x3000)
    assert SensorRestarted() in pair.run(0.4)


def test_a_sensor_that_was_away_between_two_samples_is_seen_by_its_counter() -> None:
    board = Ticking()
    pair = Pair(board, replace(FAST, period_ms=200.0))
    events = pair.run(2.0)
    assert SensorRestarted() not in events
    assert isinstance(events[-1], WrenchFrame)
    board.behind = 66  # 33 ms of filter2's outputs
    assert SensorRestarted() in pair.run(2.25)


def test_saturation_is_told_once_and_again_after_a_quiet_time(pair: Pair) -> None:
    def texts(until: float, errors: int, warnings: int) -> list[str]:
        pair.board.poke("errors", errors)
        pair.board.poke("warnings", warnings)
        return [event.text for event in pair.run(until) if isinstance(event, SensorNotice)]

    assert texts(0.3, 0x04, 0x06) == ["board: raw fz saturated, fy near saturation, fz near saturation"]
    assert texts(0.4, 0, 0) == []
    assert texts(0.5, 0x04, 0x06) == []
    assert texts(1.6, 0, 0) == []
    assert texts(1.7, 0, 0x20) == ["board: raw mz near saturation"]


def test_the_end_of_the_range_stays_where_it_is_when_a_zero_is_taken(pair: Pair) -> None:
    """Frames count from a board's zero before the board says that it holds: the offset is that of its order."""
    tick(pair.board, 0, 20000)
    assert pair.frames(0.3)[-1].saturated == 0
    pair.client.zero()
    pair.exchange()
    tick(pair.board, 0, 0)
    assert any(isinstance(event, Zeroed) for event in pair.run(0.5))
    tick(pair.board, 0, 32764 - 20000)
    saturated, *_ = reversed(pair.run(0.6))
    assert isinstance(saturated, WrenchFrame)
    assert saturated.saturated == 0b100


def test_no_sample_is_taken_while_the_board_is_busy(pair: Pair) -> None:
    pair.board.poke("errors", 0x1000)
    assert pair.frames(0.5) == []
    pair.board.poke("errors", 0)
    assert len(pair.frames(0.6)) == 10


def test_a_counter_that_stands_still(pair: Pair) -> None:
    assert isinstance(pair.board, Ticking)
    pair.board.still = True
    text = failure(pair.run(5.0))
    assert "has stood at" in text
    assert "does its program run?" in text
    assert pair.client.statistics.repeated > 90


def test_silence_has_an_end(pair: Pair) -> None:
    pair.run(0.9)
    pair.cut = True
    assert failure(pair.run(5.0)) == "board: no data for 1 s; server or network stuck?"
    silent = Pair(Words(), FAST)
    silent.cut = True
    assert failure(silent.run(5.0)) == "board: the server has not answered for 1 s"


def test_start_up_failures_become_the_end() -> None:
    board = Words()
    board.poke("max_full_scale", 0, 5)
    assert failure(Pair(board, FAST).run(5.0)) == "board: full scale of mz is 0; calibration not read?"


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"SSH-2.0-OpenSSH", "what answers is no register server: no response begins with 53"),
        (farewell(Status.TOO_MANY_CLIENTS), "closes the connection: the server has all the clients it takes"),
        (
            encode_response(Response(Op.RESET, Status.OUTSIDE_MAP, 1)),
            "the server refuses a reset: words outside the board's",
        ),
    ],
)
def test_answers_that_end_the_session(data: bytes, text: str) -> None:
    client = BoardClient(PROFILE, EPOCH)
    client.receive(data, EPOCH)
    failed = client.next_event()
    assert isinstance(failed, SensorFailed)
    assert text in failed.text
    assert client.data_to_send(EPOCH) == b""


def test_a_read_answered_without_words_ends_the_session() -> None:
    client = BoardClient(replace(PROFILE, start_up="none"), EPOCH)
    client.receive(encode_response(Response(Op.READ, Status.OK, 1, 0xF1, 9)), EPOCH)
    failed = client.next_event()
    assert isinstance(failed, SensorFailed)
    assert "a read of 9 words from 00F1 is answered with 0 bursts of 9 words" in failed.text
    assert client.statistics.malformed == 1


def test_a_write_outside_the_servers_map_ends_the_session() -> None:
    client = BoardClient(FAST, EPOCH)
    reset, write = (
        encode_response(Response(op, status, tag))
        for op, status, tag in ((Op.RESET, Status.OK, 1), (Op.WRITE, Status.OUTSIDE_MAP, 3))
    )
    client.receive(reset, EPOCH)
    client.handle_deadline(EPOCH + 0.025)
    found = Response(Op.READ, Status.OK, 2, 0xF1, 9, (Burst(0, (0,) * 7 + (1, 1)),))
    client.receive(encode_response(found) + write, EPOCH)
    failed = client.next_event()
    assert isinstance(failed, SensorFailed)
    assert "the server refuses a write of 2 words to 0200: words outside" in failed.text


def test_data_that_is_not_what_was_asked_for(pair: Pair) -> None:
    (tag,) = {r.tag for r in told_at_next_deadline(pair)}
    pair.client.receive(
        encode_response(Response(Op.STREAM, Status.OK, tag, 0, 1, (Burst(0, (1,)),))), pair.now
    )
    assert pair.client.statistics.malformed == 1
    pair.client.receive(encode_response(Response(Op.STREAM, Status.OK, 0, 0, 1, (Burst(0, (1,)),))), pair.now)
    assert pair.client.statistics.malformed == 1
    pair.client.receive(encode_response(Response(Op.STREAM, Status.BAD_PERIOD, tag)), pair.now)
    assert "gives no data: the server does not stream as fast" in failure(pair.run(0.3))


def told_at_next_deadline(pair: Pair) -> list[Response]:
    due = pair.server.next_deadline()
    assert due is not None
    pair.server.handle_deadline(due)
    return [item for item in told(pair.server, due) if isinstance(item, Response)]


# --- profiles


def test_periods_are_no_shorter_than_the_filters_own() -> None:
    assert [filter_tick(n) for n in range(7)] == [
        1 / 8000,
        1 / 8000,
        1 / 2000,
        1 / 500,
        1 / 125,
        4 / 125,
        16 / 125,
    ]
    assert BoardClientProfile(filter=6).period == pytest.approx(0.128)
    assert BoardClientProfile(filter=1, period_ms=0.25).period == pytest.approx(0.00025)


@pytest.mark.parametrize(
    ("setting", "text"),
    [
        ({"filter": 7}, "filter must be at most 6"),
        ({"filter": -1}, "filter must be at least 0"),
        ({"period_ms": 0.0}, "period_ms must be at least 0.25"),
        ({"mode": "push"}, "mode must be stream or poll, got push"),
        ({"start_up": "half"}, "start_up must be driver or none, got half"),
    ],
)
def test_impossible_settings(setting: dict[str, object], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        BoardClientProfile(**setting)  # type: ignore[arg-type]
