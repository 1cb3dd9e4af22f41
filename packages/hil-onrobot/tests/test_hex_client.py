"""Client of the sensor, without a wire."""

from collections.abc import Iterator
from typing import Any

import pytest
from hex_bench import EPOCH
from hil_onrobot.client import HexClient
from hil_onrobot.client_settings import HexClientSettings
from hil_onrobot.messages import RECORD

from protocol.wrench import (
    SensorFailed,
    SensorNotice,
    SensorReady,
    SensorRestarted,
    SensorStopped,
    WrenchFrame,
)


class Session:
    """Client whose records the test gives."""

    def __init__(self, **settings: Any) -> None:
        self.now = EPOCH
        self.client = HexClient(HexClientSettings(**settings), EPOCH)

    def sent(self) -> list[str]:
        return [data.hex() for data in self.client.data_to_send(self.now)]

    def record(self, stream: int, sample: int | None = None, status: int = 0) -> None:
        number = 2 * stream if sample is None else sample
        row = RECORD.struct.pack(stream, number, status, 50_000, 0, 0, 0, 0, 100_000)
        self.client.receive([row], self.now)

    def events(self) -> Iterator[Any]:
        return iter(self.client.next_event, None)

    def expire(self) -> None:
        due = self.client.next_deadline()
        assert due is not None
        self.now = max(due, self.now)
        self.client.handle_deadline(self.now)

    def begin(self) -> None:
        """Let the client send its start."""
        while self.client._requests:
            self.expire()
        self.sent()


def frames(session: Session) -> list[WrenchFrame]:
    return [event for event in session.events() if isinstance(event, WrenchFrame)]


def test_start_is_spaced_as_in_the_example() -> None:
    session = Session(every=10, filter=4)
    sent = [(session.now - EPOCH, session.sent())]
    for _ in range(3):
        session.expire()
        sent.append((session.now - EPOCH, session.sent()))
    assert [text for _, text in sent] == [
        ["123400820000000a"],
        ["1234008100000004"],
        ["1234004200000000"],
        ["1234000200000000"],
    ]
    assert [at for at, _ in sent] == pytest.approx([0.0, 0.005, 0.01, 0.015])


def test_bias_is_left_on_request() -> None:
    session = Session(clear_bias=False)
    session.begin()
    session.expire()
    assert session.sent() == ["1234008200000002"]  # the second start
    session.expire()
    session.expire()
    assert session.sent() == ["1234008100000002", "1234000200000000"]


def test_first_record_begins_the_stream() -> None:
    session = Session(every=4, filter=3)
    session.record(7)  # of an earlier stream
    session.begin()
    session.record(1)
    ready, frame = session.events()
    assert isinstance(ready, SensorReady)
    assert ready.facts.period == 0.004
    assert ready.facts.scales == pytest.approx((1e-4,) * 3 + (1e-5,) * 3)
    assert ready.facts.delay == pytest.approx(0.0027, abs=1e-4)
    assert frame.values == (50_000, 0, 0, 0, 0, 100_000)


def test_silent_stream_is_requested_ten_times() -> None:
    session = Session()
    starts = 0
    while session.client.next_deadline() is not None:
        starts += session.sent().count("1234000200000000")
        session.expire()
    assert starts == 10
    assert session.now == pytest.approx(EPOCH + 10 * 0.115)
    (failed,) = session.events()
    assert isinstance(failed, SensorFailed)
    assert failed.text == "no record received after 10 requests"
    assert session.sent() == ["1234000000000000"]


def test_gap_is_reported_and_stream_goes_on() -> None:
    session = Session()
    session.begin()
    session.record(5, 10)
    frames(session)
    session.expire()
    session.begin()
    session.record(1, 100)
    notice, frame = session.events()
    assert notice == SensorNotice("no record for 100 ms; requested again")
    assert (frame.sequence, frame.at) == (6, session.now)


def test_losses_repeats_and_stragglers_are_counted() -> None:
    session = Session()
    session.begin()
    for stream in (2**32 - 2, 2**32 - 1, 1, 1, 0):
        session.record(stream, (2 * stream) % 2**32)
    received = frames(session)
    assert [frame.counter for frame in received] == [2**32 - 2, 2**32 - 1, 1]
    assert [frame.sequence for frame in received] == [2**32 - 2, 2**32 - 1, 2**32 + 1]
    statistics = session.client.statistics
    assert (statistics.lost, statistics.repeated) == (1, 2)


def test_sensor_that_hangs_is_detected() -> None:
    session = Session()
    session.begin()
    for stream in range(1, 5):
        session.record(stream, 77)
    assert session.client.statistics.stands
    assert len(frames(session)) == 1


def test_stream_begun_by_another_program_is_followed() -> None:
    session = Session()
    session.begin()
    session.record(500, 1000)
    session.record(1, 1010)
    assert [frame.sequence for frame in frames(session)] == [500, 501]


def test_restarted_sensor_is_reported() -> None:
    session = Session()
    session.begin()
    session.record(500, 1000)
    for stream in range(1, 11):
        session.record(stream, stream)
    events = [event for event in session.events() if not isinstance(event, SensorReady)]
    assert [type(event) for event in events] == [WrenchFrame, SensorRestarted, WrenchFrame]


def test_error_invalidates_the_force() -> None:
    session = Session()
    session.begin()
    for stream, status in ((1, 0), (2, 4), (3, 4), (4, 0)):
        session.record(stream, status=status)
    events = list(session.events())
    assert [event.saturated for event in events if isinstance(event, WrenchFrame)] == [0, 63, 63, 0]
    (notice,) = (event for event in events if isinstance(event, SensorNotice))
    assert notice.text == "status 00000004: an error of the sensor"


def test_error_at_the_start_is_awaited_then_fails() -> None:
    session = Session(ready_s=1.0)
    session.begin()
    session.record(1, status=4)
    assert list(session.events()) == []
    session.now += 1.0
    session.record(2, status=4)
    (failed,) = session.events()
    assert failed.text == "it reports the status 00000004"


def test_stop_is_repeated_while_records_arrive() -> None:
    session = Session()
    session.begin()
    session.record(1)
    frames(session)
    session.client.stop()
    session.expire()
    session.record(2)
    session.expire()
    assert session.sent() == ["1234000000000000"] * 2
    session.expire()
    assert list(session.events()) == [SensorStopped()]


def test_malformed_datagrams_are_counted() -> None:
    session = Session()
    session.begin()
    session.client.receive([b"", bytes(35), bytes(37)], session.now)
    assert session.client.statistics.malformed == 3
    assert list(session.events()) == []
