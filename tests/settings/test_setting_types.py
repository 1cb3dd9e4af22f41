"""Settings are typed: a misspelt one fails the type check, for built-in and plug-in kinds."""

import subprocess
import sys
from pathlib import Path

import pytest

HEAD = """
from hil_bridge.devices.robots.s3.room import ROBOT
from hil_bridge.devices.sensors.jr3.room import CAN_GATEWAY
from hil_bridge.settings.configuration import read_config
from hil_bridge.settings.kinds import settings_of

config = read_config({})
s3, jr3 = settings_of(config, ROBOT), settings_of(config, CAN_GATEWAY)
"""
RIGHT = """
baudrate: int = s3.client.link.baudrate
damping: float = s3.emulated.servo.damping_ratio
period_ms: float = jr3.client.gateway.period_ms
"""
WRONG = {
    "s3.client.link.baudrat": '"LinkProfile" has no attribute "baudrat"',
    "s3.emulated.servos": '"S3Profiles" has no attribute "servos"',
    "jr3.client.gateways": '"Jr3Settings" has no attribute "gateways"',
    "config.robot.link": '"RobotConfig" has no attribute "link"',
    "config.sensor.gatewy": '"SensorConfig" has no attribute "gatewy"',
    "config.cell.servo": '"CellSection" has no attribute "servo"',
}


@pytest.fixture(scope="module")
def mypy_output(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return the output of the type check for valid and invalid settings, each invalid one on a separate line."""
    file = tmp_path_factory.mktemp("types") / "snippet.py"
    file.write_text(HEAD + RIGHT + "".join(f"print({text})\n" for text in WRONG))
    root = Path(__file__).parents[2]
    command = [sys.executable, "-m", "mypy", "--config-file", str(root / "pyproject.toml"), str(file)]
    return subprocess.run(command, cwd=root, capture_output=True, text=True, check=False).stdout


def test_type_check_refuses_misspelt_setting(mypy_output: str) -> None:
    for text, message in WRONG.items():
        assert message in mypy_output, text


def test_type_check_accepts_existing_settings(mypy_output: str) -> None:
    assert f"Found {len(WRONG)} errors in 1 file" in mypy_output
