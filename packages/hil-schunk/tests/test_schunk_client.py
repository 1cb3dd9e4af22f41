"""Client of the sensor, without a wire."""

import pytest
from hil_schunk.messages import Packet, encode_packet
from schunk_bench import EPOCH, Session

from protocol.wrench import (
    SensorFailed,
    SensorNotice,
    SensorReady,
    SensorRestarted,
    SensorStopped,
    WrenchFrame,
)


def packet(counter: int, status: int = 1, fx: float = 5.0) -> bytes:
    return encode_packet(Packet(counter, counter % 256, status, (fx, 0.0, 0.0, 0.0, 0.0, 0.0)))


def frames(session: Session) -> list[WrenchFrame]:
    return [event for event in session.events() if isinstance(event, WrenchFrame)]


def test_start_up_asks_one_by_one() -> None:
    session = Session(filter=2, tool=1)
    requests = []
    for answer in ("f0 00 0100 00 46545300", "f0 00 0100 03 00c0ffee", "30 00", "31 00", "40 00"):
        requests += session.sent()
        assert session.sent() == []
        session.answer(answer)
    assert [request.hex() for request in requests] == ["f0010000", "f0010003", "3001", "3102", "40"]
    session.packet(packet(0))
    ready, frame = session.events()
    assert isinstance(ready, SensorReady)
    assert ready.facts.model == "SCHUNK FTS 00c0ffee"  # number of bytes that are not text
    assert ready.facts.delay == pytest.approx(1.5e-3)
    assert frame.values == (5.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def test_unknown_identity_does_not_matter() -> None:
    session = Session()
    for answer in ("f0 03 0100 00", "f0 03 0100 03", "31 00", "40 00"):
        session.sent()
        session.answer(answer)
    session.packet(packet(0))
    ready, _ = session.events()
    assert ready.facts.model == "SCHUNK"


def test_refused_command_fails_the_session() -> None:
    session = Session()
    for answer in ("f0 00 0100 00", "f0 00 0100 03", "31 03"):
        session.sent()
        session.answer(answer)
    (failed,) = session.events()
    assert failed.text == "it answers the command select filter with error 03 (out of range)"
    assert session.client.next_deadline() is None


def test_missing_answer_fails_the_session() -> None:
    session = Session()
    session.expire()
    assert session.now == EPOCH + 2.0
    (failed,) = session.events()
    assert isinstance(failed, SensorFailed)
    assert failed.text == "no answer to the command read within 2 s"


def test_silent_stream_is_requested_again_ten_times() -> None:
    session = Session()
    session.begin()
    session.packet(packet(0))
    frames(session)
    requests = []
    for _ in range(10):
        session.expire()
        requests += session.sent()
    assert [request.hex() for request in requests] == ["f0010000"] * 10
    (notice,) = session.events()
    assert notice == SensorNotice("no packet for 100 ms; requested again")
    session.expire()
    (failed,) = session.events()
    assert failed.text == "no packet received after 10 requests"
    assert "54843" in failed.remedy


def test_start_up_is_repeated_after_an_interruption() -> None:
    session = Session(filter=2)
    session.begin()
    session.packet(packet(0))
    frames(session)
    session.expire()
    requests = []
    for answer in ("f0 00 0100 00 465453", "f0 00 0100 03 313233", "31 00", "40 00"):
        requests += session.sent()
        session.answer(answer)
    assert [request.hex() for request in requests] == ["f0010000", "f0010003", "3102", "40"]
    session.packet(packet(1))
    assert [frame.sequence for frame in frames(session)] == [1]


def test_other_sensor_after_an_interruption_fails_the_session() -> None:
    session = Session()
    session.begin()
    session.packet(packet(0))
    frames(session)
    session.expire()
    session.answer("f0 00 0100 00 4b4d53")
    *_, failed = session.events()
    assert failed.text == "another sensor answers: KMS instead of FTS"


def test_counter_is_unwrapped_and_losses_counted() -> None:
    session = Session()
    session.begin()
    for counter in (65534, 65535, 1, 1, 65535):
        session.packet(packet(counter))
    received = frames(session)
    assert [frame.counter for frame in received] == [65534, 65535, 1]
    assert [frame.sequence for frame in received] == [65534, 65535, 65537]
    statistics = session.client.statistics
    assert (statistics.lost, statistics.repeated, statistics.standing) == (1, 2, 1)


def test_frozen_counter_is_detected() -> None:
    session = Session()
    session.begin()
    for _ in range(4):
        session.packet(packet(7))
    assert session.client.statistics.stands


def test_restarted_counter_is_reported() -> None:
    session = Session()
    session.begin()
    session.packet(packet(5000))
    for counter in range(10):
        session.packet(packet(counter))
    events = [event for event in session.events() if not isinstance(event, SensorReady)]
    assert [type(event) for event in events] == [WrenchFrame, SensorRestarted, WrenchFrame]
    assert events[-1].sequence == 5001


def test_packet_is_dated_by_its_counter() -> None:
    """A packet that arrives 30 ms late contains the force of its own time."""
    session = Session()
    session.begin()
    for counter, at in ((0, 0.0), (1, 0.001), (2, 0.032), (3, 0.032)):
        session.now = EPOCH + at
        session.packet(packet(counter))
    ages = [session.now - frame.at for frame in frames(session)]
    assert ages == pytest.approx([0.032, 0.031, 0.030, 0.029], abs=0.001)


@pytest.mark.parametrize("status", [0b11, 0b101, 0b1001, 0b10000, 0b100001, 0])
def test_status_other_than_ready_invalidates_the_force(status: int) -> None:
    session = Session()
    session.begin()
    for counter, value in enumerate((1, status, status, 1)):
        session.packet(packet(counter, value))
    events = list(session.events())
    assert [event.saturated for event in events if isinstance(event, WrenchFrame)] == [0, 63, 63, 0]
    assert len([event for event in events if isinstance(event, SensorNotice)]) == 1


def test_sensor_that_is_not_ready_is_awaited() -> None:
    session = Session(ready_s=1.0)
    session.begin()
    session.packet(packet(0, 0))
    assert list(session.events()) == []
    session.packet(packet(1, 1))
    ready, frame = session.events()
    assert isinstance(ready, SensorReady)
    assert frame.counter == 1


def test_sensor_that_is_never_ready_fails() -> None:
    session = Session(ready_s=1.0)
    session.begin()
    session.packet(packet(0, 0b10))
    session.now += 3.0
    session.packet(packet(3000, 0b10))
    (failed,) = session.events()
    assert failed.text == "it reports: not ready, process data invalid"


def test_sensor_with_fault_fails_at_once() -> None:
    session = Session()
    session.begin()
    session.packet(packet(0, 0b1001))
    (failed,) = session.events()
    assert failed.text == "it reports: hardware fault"


def test_stop_waits_for_its_answer() -> None:
    session = Session()
    session.begin()
    session.packet(packet(0))
    frames(session)
    session.client.stop()
    assert [request.hex() for request in session.sent()] == ["41"]
    session.packet(packet(1))
    assert list(session.events()) == []
    session.answer("40 00")  # late answer to an earlier command
    assert list(session.events()) == []
    session.answer("41 00")
    assert list(session.events()) == [SensorStopped()]


def test_unanswered_stop_ends_after_its_timeout() -> None:
    session = Session()
    session.begin()
    session.client.stop()
    session.expire()
    assert list(session.events()) == []
    session.expire()
    assert session.now == EPOCH + 2.0
    assert list(session.events()) == [SensorStopped()]


def test_malformed_data_are_counted() -> None:
    session = Session()
    session.begin()
    for data in (b"", packet(0)[:-1], packet(0) + b"\0", bytes(35)):
        session.packet(data)
    session.answer("40")
    assert session.client.statistics.malformed == 5
    assert list(session.events()) == []
