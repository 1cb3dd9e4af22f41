"""Built-in robots, tested by the suites for third-party robots."""

import pytest

from hil_bridge.devices.kinds import ROBOTS
from hil_bridge.testing import RobotCase
from hil_bridge.testing.robot_clients import *  # noqa: F403
from hil_bridge.testing.robot_emulators import *  # noqa: F403

pytestmark = pytest.mark.sweep

CASES = {
    "s3": RobotCase(ROBOTS.kind("s3"), stop=("robot", "emergency-stop"), checked=True),
    "egm": RobotCase(ROBOTS.kind("egm"), stop=("robot", "motors-off"), numbered=True),
    "rtde": RobotCase(ROBOTS.kind("rtde"), stop=("robot", "safeguard-stop")),
    "rsi": RobotCase(ROBOTS.kind("rsi"), stop=("robot", "emergency-stop"), numbered=True),
}


@pytest.fixture(params=list(CASES.values()), ids=list(CASES))
def robot_client(request):
    return request.param


@pytest.fixture(params=list(CASES.values()), ids=list(CASES))
def robot_emulator(request):
    return request.param
