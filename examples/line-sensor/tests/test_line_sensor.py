"""Suites for sensors, and tests of the sensor in closed loop, its faults, and its client without a wire."""

from binascii import crc_hqx

import pytest
from line_sensor.room import SENSOR
from line_sensor.wire import BAUDRATE, COUNTERS, SIZE, LineClient, Message, encode

import hil_bridge
from hil_bridge.devices.kinds import default_settings
from hil_bridge.testing import SensorCase
from hil_bridge.testing.sensor_clients import *  # noqa: F403
from hil_bridge.testing.sensor_emulators import *  # noqa: F403
from protocol.wrench import SensorFailed, SensorReady, WrenchFrame

NEAR = {"start_position_mm": [900.0, -100.0, 593.0]}  # just above the surface
SITE = {
    "robot": {"emulated": "egm"},
    "sensor": {"emulated": "toyline"},
    "run": {"duration_s": 2.0},
    "cell": NEAR,
}
PUSH = (0, 0, -100, 0, 0, 0)


@pytest.fixture
def sensor_client() -> SensorCase:
    return SensorCase(SENSOR, numbered=True, checked=True)


@pytest.fixture
def sensor_emulator() -> SensorCase:
    return SensorCase(SENSOR)


def frames(client: LineClient) -> list[WrenchFrame]:
    """Return the waiting frames; other events are dropped."""
    events = iter(client.next_event, None)
    return [event for event in events if isinstance(event, WrenchFrame)]


def test_the_loop_closes_over_the_line() -> None:
    result = hil_bridge.simulate(SITE, seed=7)
    assert result.outcome == "completed", result.text
    assert abs(result.figures.force_mean_steady_n - 10.0) < 0.5


@pytest.mark.parametrize(
    ("on", "fault", "cause"),
    [
        ("signal", "stuck", "unanswered"),
        ("sensor", "unplugged", "force-too-old"),
        ("sensor-wire", "off", "force-too-old"),
    ],
)
def test_a_sensor_that_fails_ends_the_run(on: str, fault: str, cause: str) -> None:
    failing = {"on": on, "fault": fault, "phase": "track", "after_s": 0.2}
    heavy = SITE | {"cell": NEAR | {"tool": {"mass_kg": 1.0}}}  # a lost weight would not look like the touch
    result = hil_bridge.simulate(heavy, faults=[failing], seed=7)
    assert result.outcome == "stopped"
    assert result.cause is not None
    assert result.cause.value == cause


def test_a_message_in_golden_bytes() -> None:
    """Source of the check sum: the check value of CRC-16/CCITT-FALSE in catalogues of such sums, 29B1."""
    assert crc_hqx(b"123456789", 0xFFFF) == 0x29B1
    data = encode(Message(7, PUSH))
    assert data[:-2] == bytes.fromhex("a55a 07 0000 0000 9cff 0000 0000 0000")
    assert data[-2:] == crc_hqx(data[:-2], 0xFFFF).to_bytes(2, "little")
    assert len(data) == SIZE


def test_bytes_that_are_cut_anywhere_make_the_same_frames() -> None:
    data = b"".join(encode(Message(number, PUSH)) for number in range(3))
    for cut in range(len(data)):
        client = LineClient(0.0)
        for piece in (data[:cut], data[cut:]):
            client.receive(piece, 0.0)
        assert [frame.counter for frame in frames(client)] == [0, 1, 2]


def test_the_sequence_goes_on_where_the_counter_wraps() -> None:
    client = LineClient(0.0)
    for number in (254, 255, 256, 258):  # 257 is lost
        client.receive(encode(Message(number, PUSH)), 0.0)
    result = frames(client)
    assert [frame.counter for frame in result] == [254, 255, 0, 2]
    assert [frame.sequence for frame in result] == [0, 1, 2, 4]
    assert client.statistics.lost == 1


def test_a_message_from_before_is_dropped_and_a_damaged_one_counted() -> None:
    client = LineClient(0.0)
    message = encode(Message(COUNTERS - 1, PUSH))
    damaged = bytearray(encode(Message(0, PUSH)))
    damaged[5] ^= 1
    client.receive(message + message + bytes(damaged), 0.0)
    assert isinstance(client.next_event(), SensorReady)
    assert len(frames(client)) == 1
    assert (client.statistics.repeated, client.statistics.standing, client.statistics.malformed) == (1, 1, 1)


def test_a_silent_sensor_is_told_with_the_line_to_look_at() -> None:
    client = LineClient(1.0)
    due = client.next_deadline()
    assert due == 3.0
    client.handle_deadline(due)
    event = client.next_event()
    assert isinstance(event, SensorFailed)
    assert "115200 baud" in event.remedy
    assert client.next_deadline() is None


@pytest.mark.parametrize(
    ("url", "baudrate"),
    [
        ("serial:///dev/ttyUSB0", BAUDRATE),
        ("serial:///dev/ttyUSB0?baudrate=57600", 57600),
        ("tcp://h:1", None),
    ],
)
def test_a_serial_line_has_the_rate_of_the_sensor_where_its_url_names_none(
    url: str, baudrate: int | None
) -> None:
    line = SENSOR.parse(url, default_settings(SENSOR)).line
    assert (line.baudrate if line else None) == baudrate
