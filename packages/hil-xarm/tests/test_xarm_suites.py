"""Suites of hil_bridge for robots and sensors."""

import pytest
from hil_xarm.force_room import SENSOR
from hil_xarm.room import ROBOT

from emulators.seams import StartPose
from hil_bridge.testing import RobotCase, SensorCase
from hil_bridge.testing.robot_clients import *  # noqa: F403
from hil_bridge.testing.robot_emulators import *  # noqa: F403
from hil_bridge.testing.sensor_clients import *  # noqa: F403
from hil_bridge.testing.sensor_emulators import *  # noqa: F403

START = StartPose((0.4, -0.1, 0.2), (0.1, 0.975, 0.15, 0.129), 0.2)
SENSOR_CASE = SensorCase(SENSOR)


@pytest.fixture
def robot_client() -> RobotCase:
    return RobotCase(ROBOT, stop=("robot", "emergency-stop"), start=START)


@pytest.fixture
def robot_emulator() -> RobotCase:
    return RobotCase(ROBOT, start=START)


@pytest.fixture
def sensor_client() -> SensorCase:
    return SENSOR_CASE


@pytest.fixture
def sensor_emulator() -> SensorCase:
    return SENSOR_CASE
