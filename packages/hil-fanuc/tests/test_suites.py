"""Suites of hil_bridge for robots."""

import pytest
from hil_fanuc.room import ROBOT

from hil_bridge.testing import RobotCase
from hil_bridge.testing.robot_clients import *  # noqa: F403
from hil_bridge.testing.robot_emulators import *  # noqa: F403


@pytest.fixture
def robot_client() -> RobotCase:
    return RobotCase(ROBOT, stop=("robot", "emergency-stop"), numbered=True)


@pytest.fixture
def robot_emulator() -> RobotCase:
    return RobotCase(ROBOT)
