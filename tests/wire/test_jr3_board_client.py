"""Client of the register protocol, connected to its server over a board with plain words."""

import itertools
from collections.abc import Sequence
from dataclasses import replace

import pytest

from protocol.devices.jr3.registers import (
    FILTER_DELAYS,
    BoardClient,
    BoardClientProfile,
    BoardPhase,
    Burst,
    Load,
    Op,
    ProgramWord,
    Read,
    RegisterServer,
    RegisterServerProfile,
    Response,
    Status,
    Wait,
    encode_response,
    farewell,
    filter_tick,
    start_up,
)
from protocol.endpoint import LocalProtocolError, Trouble
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
from tests.wire.plain_board import EPOCH, PROFILE, Words, perform, responses_of, tick

# --- client


class Pair:
    """A client and its server, connected without a wire; time advances from deadline to deadline."""

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
        """Continue to a time since the epoch; return the events since the last call."""
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
    """Counts filter2's outputs, 2000 per second, as time advances; fz is 100."""

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


def test_polling_yields_same_samples_as_streaming() -> None:
    board = Ticking()
    pair = Pair(board, replace(FAST, mode="poll", period_ms=1.0, filter=1))
    frames = pair.frames(0.5)
    assert len(frames) > 300
    assert {round((b.at - a.at) * 1e6) for a, b in itertools.pairwise(frames)} == {1000}
    assert {b.sequence - a.sequence for a, b in itertools.pairwise(frames)} == {8}


def test_bursts_that_arrive_together_are_dated_apart() -> None:
    board = Ticking()
    pair = Pair(board, replace(FAST, period_ms=1.0, bursts=10))
    frames = pair.frames(0.5)
    assert len(frames) % 10 == 0
    assert {round((b.at - a.at) * 1e6) for a, b in itertools.pairwise(frames)} == {1000}


def test_no_burst_is_dated_before_an_earlier_one() -> None:
    """All of a delayed delivery is dated late; the next one arrives on time."""
    pair = Pair(Ticking(), replace(FAST, period_ms=1.0, bursts=10))
    pair.frames(0.3)
    delayed, pair.now = b"", EPOCH + 0.3
    while not delayed:
        pair.now = pair.server.next_deadline() or 0.0
        pair.server.handle_deadline(pair.now)
        delayed = pair.server.data_to_send(pair.now)
    delivered = pair.now
    pair.client.receive(delayed, delivered + 0.008)
    late, in_time = pair.frames(0.3)[-10:], pair.frames(delivered - EPOCH + 0.0105)[-10:]
    assert [frame.at - delivered for frame in late] == pytest.approx([k * 1e-3 for k in range(-1, 9)])
    assert [frame.at - delivered for frame in in_time] == pytest.approx([0.008] * 8 + [0.009, 0.01])


def test_counter_wraps_without_a_gap(pair: Pair) -> None:
    frames = pair.frames(70.0)
    assert max(frame.counter for frame in frames) > 65500
    assert {b.sequence - a.sequence for a, b in itertools.pairwise(frames)} == {20}
    assert pair.client.statistics.lost == 0


def test_late_server_is_counted(pair: Pair) -> None:
    pair.frames(0.3)
    pair.now += 0.05
    pair.server.handle_deadline(pair.now)
    pair.exchange()
    pair.frames(1.0)
    assert pair.client.statistics.lost in (4, 5)


def test_zero_is_reported_once_settled(pair: Pair) -> None:
    pair.client.zero()
    events = pair.run(0.5)
    at = next(i for i, event in enumerate(events) if isinstance(event, Zeroed))
    before = events[at - 1]
    assert isinstance(before, WrenchFrame)
    assert before.at - EPOCH == pytest.approx(0.225 + 0.02 + 0.099, abs=0.011)
    assert pair.board.commands[-1] == 0x0800
    assert sum(isinstance(event, Zeroed) for event in events) == 1


def test_zero_before_the_start_up_is_over_waits_for_it() -> None:
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


def test_stop_without_stream_completes_immediately() -> None:
    pair = Pair(Words(), FAST)
    pair.client.stop()
    assert pair.run(0.0) == [SensorStopped()]
    pair.client.receive(encode_response(Response(Op.RESET, Status.OK, 1)), EPOCH)
    assert pair.run(1.0) == []


def test_server_that_does_not_answer_the_stop_times_out(pair: Pair) -> None:
    pair.cut = True
    pair.client.stop()
    (failed,) = (event for event in pair.run(2.0) if isinstance(event, SensorFailed))
    assert failed.text == "board: the server has not answered for 1 s"
    assert pair.client.stop_patience == 1.0


def test_refused_reset_is_reported_and_skipped() -> None:
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


def test_program_is_loaded_between_reset_and_pause() -> None:
    board = Ticking()
    _, steps, _ = perform(board, start_up(FAST, PROGRAM))
    assert [type(step) for step in steps[:6]] == [Load, Load, Load, Load, Wait, Read]
    assert [(load[0], len(load) - 1) for load in board.loads] == [(0, 0), (0x10, 256), (0x90, 4), (0x3FFF, 2)]
    assert board.loads[2:] == [(0x90, 128, 0xEF, 129, 0xEF), (0x3FFF, 0xABCD, 0x56)]
    assert board.resets == 0


def test_client_with_a_program_starts_up_over_its_server() -> None:
    board = Ticking()
    board.may_reset = False
    pair = Pair(board, FAST, PROGRAM)
    _, ready, *_ = pair.run(1.0)
    assert isinstance(ready, SensorReady)
    assert [load[0] for load in board.loads] == [0, 0x10, 0x90, 0x3FFF]


def test_program_outside_the_processor_s_memory_is_refused() -> None:
    pair = Pair(Ticking(), FAST, (ProgramWord(0x4000, 1, 2),))
    assert failure(pair.run(1.0)) == (
        "board: the server refuses a program: words outside the board's memory map"
    )
    with pytest.raises(ValueError, match="program is loaded only with start_up = driver"):
        BoardClientProfile(program="x.idm", start_up="none")


def test_second_client_uses_the_board_as_it_is() -> None:
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


def test_unplugged_sensor_ends_the_session(pair: Pair) -> None:
    pair.board.poke("errors", 0xC000)
    assert failure(pair.run(1.0)) == (
        "board: it receives no sensor data (watch dog2, watch dog); check the sensor's plug and cable"
    )
    assert pair.client.phase is BoardPhase.FAILED
    assert pair.run(100.0) == []


def test_changed_sensor_restarts_without_a_reset(pair: Pair) -> None:
    before = pair.frames(0.3)[-1].sequence
    pair.board.poke("errors", 0x0800)
    events = pair.run(3.0)
    kinds = [type(event) for event in events if not isinstance(event, WrenchFrame)]
    assert kinds == [SensorRestarted, SensorNotice, SensorReady]
    assert pair.board.resets == 1
    first = next(event for event in events if isinstance(event, WrenchFrame))
    assert first.sequence == before + 1


def test_repeated_calibration_is_detected_while_it_is_read(pair: Pair) -> None:
    """The same sensor plugged in again sets no `sensor changed`, but its offsets are lost."""
    pair.frames(0.3)
    pair.board.poke("errors", 0x3000)
    assert SensorRestarted() in pair.run(0.4)


def test_sensor_away_between_samples_is_detected_by_its_counter() -> None:
    board = Ticking()
    pair = Pair(board, replace(FAST, period_ms=200.0))
    events = pair.run(2.0)
    assert SensorRestarted() not in events
    assert isinstance(events[-1], WrenchFrame)
    board.behind = 66  # 33 ms of filter2's outputs
    assert SensorRestarted() in pair.run(2.25)


def test_saturation_is_reported_once_and_after_a_quiet_time(pair: Pair) -> None:
    def texts(until: float, errors: int, warnings: int) -> list[str]:
        pair.board.poke("errors", errors)
        pair.board.poke("warnings", warnings)
        return [event.text for event in pair.run(until) if isinstance(event, SensorNotice)]

    assert texts(0.3, 0x04, 0x06) == ["board: raw fz saturated, fy near saturation, fz near saturation"]
    assert texts(0.4, 0, 0) == []
    assert texts(0.5, 0x04, 0x06) == []
    assert texts(1.6, 0, 0) == []
    assert texts(1.7, 0, 0x20) == ["board: raw mz near saturation"]


def test_end_of_range_does_not_move_with_a_zero(pair: Pair) -> None:
    """Frames are relative to a board's zero before the board confirms it: the offset is the one at the order."""
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


def test_no_sample_is_used_while_the_board_is_busy(pair: Pair) -> None:
    pair.board.poke("errors", 0x1000)
    assert pair.frames(0.5) == []
    pair.board.poke("errors", 0)
    assert len(pair.frames(0.6)) == 10


def test_stuck_counter_ends_the_session(pair: Pair) -> None:
    assert isinstance(pair.board, Ticking)
    pair.board.still = True
    text = failure(pair.run(5.0))
    assert "has been stuck at" in text
    assert "does its program run" in text
    assert pair.client.statistics.repeated > 90


def test_silence_ends_the_session(pair: Pair) -> None:
    pair.run(0.9)
    pair.cut = True
    assert failure(pair.run(5.0)) == "board: no data for 1 s; server or network stuck?"
    silent = Pair(Words(), FAST)
    silent.cut = True
    assert failure(silent.run(5.0)) == "board: the server has not answered for 1 s"


def test_start_up_failures_end_the_session() -> None:
    board = Words()
    board.poke("max_full_scale", 0, 5)
    assert failure(Pair(board, FAST).run(5.0)) == "board: full scale of mz is 0; calibration not read?"


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"SSH-2.0-OpenSSH", "the peer is not a register server: no response begins with 53"),
        (
            farewell(Status.TOO_MANY_CLIENTS),
            "closes the connection: the maximum number of clients is connected",
        ),
        (
            encode_response(Response(Op.RESET, Status.OUTSIDE_MAP, 1)),
            "the server refuses a reset: words outside the board's",
        ),
    ],
)
def test_invalid_responses_end_the_session(data: bytes, text: str) -> None:
    client = BoardClient(PROFILE, EPOCH)
    client.receive(data, EPOCH)
    failed = client.next_event()
    assert isinstance(failed, SensorFailed)
    assert text in failed.text
    assert client.data_to_send(EPOCH) == b""


def test_read_answered_without_words_ends_the_session() -> None:
    client = BoardClient(replace(PROFILE, start_up="none"), EPOCH)
    client.receive(encode_response(Response(Op.READ, Status.OK, 1, 0xF1, 9)), EPOCH)
    failed = client.next_event()
    assert isinstance(failed, SensorFailed)
    assert "a read of 9 words from 00F1 is answered with 0 bursts of 9 words" in failed.text
    assert client.statistics.malformed == 1


def test_write_outside_the_servers_map_ends_the_session() -> None:
    client = BoardClient(FAST, EPOCH)
    reset, write = (
        encode_response(Response(op, status, tag))
        for op, status, tag in ((Op.RESET, Status.OK, 1), (Op.WRITE, Status.OUTSIDE_MAP, 3))
    )
    client.receive(reset, EPOCH)
    client.handle_deadline(EPOCH + 0.025)
    result = Response(Op.READ, Status.OK, 2, 0xF1, 9, (Burst(0, (0,) * 7 + (1, 1)),))
    client.receive(encode_response(result) + write, EPOCH)
    failed = client.next_event()
    assert isinstance(failed, SensorFailed)
    assert "the server refuses a write of 2 words to 0200: words outside" in failed.text


def test_unrequested_data_ends_the_session(pair: Pair) -> None:
    (tag,) = {r.tag for r in responses_at_next_deadline(pair)}
    pair.client.receive(
        encode_response(Response(Op.STREAM, Status.OK, tag, 0, 1, (Burst(0, (1,)),))), pair.now
    )
    assert pair.client.statistics.malformed == 1
    pair.client.receive(encode_response(Response(Op.STREAM, Status.OK, 0, 0, 1, (Burst(0, (1,)),))), pair.now)
    assert pair.client.statistics.malformed == 1
    pair.client.receive(encode_response(Response(Op.STREAM, Status.BAD_PERIOD, tag)), pair.now)
    assert "sends no data: the requested stream is too fast" in failure(pair.run(0.3))


def responses_at_next_deadline(pair: Pair) -> list[Response]:
    due = pair.server.next_deadline()
    assert due is not None
    pair.server.handle_deadline(due)
    return [item for item in responses_of(pair.server, due) if isinstance(item, Response)]


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
