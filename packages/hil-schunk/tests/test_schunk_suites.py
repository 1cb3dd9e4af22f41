"""The suites that every client and every emulator of a sensor must pass."""

from dataclasses import replace

import pytest
from hil_schunk.room import SENSOR

from hil_bridge.devices.kinds import default_settings
from hil_bridge.testing import SensorCase
from hil_bridge.testing.sensor_clients import *  # noqa: F403
from hil_bridge.testing.sensor_emulators import *  # noqa: F403

_USUAL = default_settings(SENSOR)
_WITHOUT_CREEP = replace(_USUAL, emulated=replace(_USUAL.emulated, creep_share=0.0))
_CASE = SensorCase(
    SENSOR, numbered=True, full=(500.0, 500.0, 500.0, 20.0, 20.0, 20.0), settings=_WITHOUT_CREEP
)


@pytest.fixture
def sensor_client() -> SensorCase:
    return _CASE


@pytest.fixture
def sensor_emulator() -> SensorCase:
    return _CASE
