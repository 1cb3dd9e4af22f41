"""Suites for sensors, and tests of the load cell in closed loop and of its client without a wire."""

import pytest
from toy_sensor.room import SENSOR
from toy_sensor.wire import SAMPLE, LoadClient

import hil_bridge
from hil_bridge.testing import SensorCase
from hil_bridge.testing.sensor_clients import *  # noqa: F403
from hil_bridge.testing.sensor_emulators import *  # noqa: F403
from protocol.wrench import SensorReady, WrenchFrame

NEAR = {"start_position_mm": [900.0, -100.0, 593.0]}  # just above the surface


@pytest.fixture
def sensor_client() -> SensorCase:
    return SensorCase(SENSOR, numbered=True)


@pytest.fixture
def sensor_emulator() -> SensorCase:
    return SensorCase(SENSOR)


def test_the_loop_closes_over_the_load_cell() -> None:
    result = hil_bridge.simulate(
        {
            "robot": {"emulated": "egm"},
            "sensor": {"emulated": "toyload"},
            "run": {"duration_s": 1.0},
            "cell": NEAR,
        },
        seed=7,
    )
    assert result.outcome == "completed", result.text
    assert abs(result.figures.force_mean_steady_n - 10.0) < 0.5


def test_a_sample_becomes_a_frame_and_a_repeated_one_does_not() -> None:
    client = LoadClient(0.0)
    sample = SAMPLE.pack(b"LS", 5, 0, 0, -10_000, 0, 0, 0, 0)
    client.receive([sample, sample, b"LS"], 0.0)
    ready, frame = client.next_event(), client.next_event()
    assert isinstance(ready, SensorReady)
    assert isinstance(frame, WrenchFrame)
    assert frame.values[2] * ready.facts.scales[2] == -10.0
    assert client.next_event() is None
    assert (client.statistics.repeated, client.statistics.malformed) == (1, 1)
