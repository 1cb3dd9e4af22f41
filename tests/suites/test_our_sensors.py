"""Built-in sensors, tested by the suites for third-party sensors."""

from dataclasses import replace
from typing import Any

import pytest

from hil_bridge.devices.kinds import SENSORS, KindSettings, default_settings
from hil_bridge.testing import SensorCase
from hil_bridge.testing.sensor_clients import *  # noqa: F403
from hil_bridge.testing.sensor_emulators import *  # noqa: F403

pytestmark = pytest.mark.sweep


def still(name: str) -> KindSettings[Any, Any]:
    """Return settings of a sensor without creep, which would persist after the fiftyfold overload of the suite."""
    usual = default_settings(SENSORS.kind(name))
    return replace(usual, emulated=replace(usual.emulated, creep_share=0.0))


CASES = {
    "jr3": SensorCase(SENSORS.kind("jr3"), numbered=True),
    "jr3-uart": SensorCase(SENSORS.kind("jr3-uart"), numbered=True),
    "jr3-board": SensorCase(SENSORS.kind("jr3-board"), settle_s=0.15),
    "netft": SensorCase(
        SENSORS.kind("netft"), numbered=True, overload=6.0, settle_s=0.1, settings=still("netft")
    ),
    "ft300": SensorCase(SENSORS.kind("ft300"), checked=True, settings=still("ft300")),
    "ft300-urcap": SensorCase(SENSORS.kind("ft300-urcap"), settings=still("ft300-urcap")),
    "ati-can": SensorCase(
        SENSORS.kind("ati-can"),
        full=(40.0, 40.0, 120.0, 2.0, 2.0, 2.0),
        overload=6.0,
        settle_s=0.1,
        settings=still("ati-can"),
    ),
}


@pytest.fixture(params=list(CASES.values()), ids=list(CASES))
def sensor_client(request):
    return request.param


@pytest.fixture(params=list(CASES.values()), ids=list(CASES))
def sensor_emulator(request):
    return request.param
