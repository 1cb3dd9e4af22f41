"""The messages of every sensor's client to its owner: order, statuses told once, the host's zero, the end."""

import pytest

from protocol.endpoint import LocalProtocolError
from protocol.sensor_events import SensorEventQueue
from protocol.wrench import SensorFailed, SensorNotice, SensorRestarted, SensorStopped, WrenchFrame, Zeroed

RAW = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)


def events(telling: SensorEventQueue) -> list[object]:
    return list(iter(telling.next_event, None))


def test_events_come_in_the_order_in_which_they_were_told() -> None:
    telling = SensorEventQueue()
    telling.notice("first")
    telling.tell(SensorRestarted())
    telling.notice("last")
    assert events(telling) == [SensorNotice("first"), SensorRestarted(), SensorNotice("last")]
    assert telling.next_event() is None


def test_a_status_is_told_once() -> None:
    telling = SensorEventQueue()
    for status in (1, 2, 1, 2):
        telling.notice_status(status, f"status {status}")
    assert events(telling) == [SensorNotice("status 1"), SensorNotice("status 2")]
    assert telling.knows_status(2)
    assert not telling.knows_status(3)


def test_a_status_that_changes_with_every_sample_fills_no_recording() -> None:
    telling = SensorEventQueue()
    for status in range(1000):
        telling.notice_status(status, "")
    assert len(events(telling)) == 16


def test_samples_are_counted_and_a_zero_follows_the_sample_that_completes_it() -> None:
    telling = SensorEventQueue(zero_samples=2)
    telling.zero()
    for at in range(3):
        telling.sample(RAW, at, 0b1)
    assert events(telling) == [
        WrenchFrame(RAW, 1, 1, 0, 0b1),
        WrenchFrame(RAW, 2, 2, 1, 0b1),
        Zeroed(),
        WrenchFrame((0.0,) * 6, 3, 3, 2, 0b1),
    ]


def test_a_failure_names_its_part_and_ends_the_session() -> None:
    telling = SensorEventQueue("board: ")
    telling.fail("no data")
    assert telling.ended
    assert events(telling) == [SensorFailed("board: no data")]
    with pytest.raises(LocalProtocolError, match="over"):
        telling.zero()


def test_a_stop_ends_the_session() -> None:
    telling = SensorEventQueue()
    telling.zero()
    telling.stop()
    assert events(telling) == [SensorStopped()]
    with pytest.raises(LocalProtocolError, match="over"):
        telling.zero()
