"""Events from every sensor client to its owner: order, statuses reported once, the host's zero, the end."""

import pytest

from protocol.endpoint import LocalProtocolError
from protocol.sensor_events import SensorEventQueue
from protocol.wrench import SensorFailed, SensorNotice, SensorRestarted, SensorStopped, WrenchFrame, Zeroed

RAW = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)


def events(queue: SensorEventQueue) -> list[object]:
    return list(iter(queue.next_event, None))


def test_events_keep_their_order() -> None:
    queue = SensorEventQueue()
    queue.notice("first")
    queue.restart()
    queue.notice("last")
    assert events(queue) == [SensorNotice("first"), SensorRestarted(), SensorNotice("last")]
    assert queue.next_event() is None


def test_status_is_reported_once() -> None:
    queue = SensorEventQueue()
    for status in (1, 2, 1, 2):
        queue.notice_status(status, f"status {status}")
    assert events(queue) == [SensorNotice("status 1"), SensorNotice("status 2")]
    assert queue.knows_status(2)
    assert not queue.knows_status(3)


def test_constantly_changing_status_is_limited_in_the_recording() -> None:
    queue = SensorEventQueue()
    for status in range(1000):
        queue.notice_status(status, "")
    assert len(events(queue)) == 16


def test_samples_are_counted_and_a_zero_follows_its_last_sample() -> None:
    queue = SensorEventQueue(zero_samples=2)
    queue.zero()
    for at in range(3):
        queue.sample(RAW, at, 0b1)
    assert events(queue) == [
        WrenchFrame(RAW, 1, 1, 0, 0b1),
        WrenchFrame(RAW, 2, 2, 1, 0b1),
        Zeroed(),
        WrenchFrame((0.0,) * 6, 3, 3, 2, 0b1),
    ]


def test_failure_names_its_part_and_ends_the_session() -> None:
    queue = SensorEventQueue("board: ")
    queue.fail("no data")
    assert queue.ended
    assert events(queue) == [SensorFailed("board: no data")]
    with pytest.raises(LocalProtocolError, match="ended"):
        queue.zero()


def test_stop_ends_the_session() -> None:
    queue = SensorEventQueue()
    queue.zero()
    queue.stop()
    assert events(queue) == [SensorStopped()]
    with pytest.raises(LocalProtocolError, match="ended"):
        queue.zero()
