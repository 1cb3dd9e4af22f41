"""Settings are typed: a misspelt one does not pass the type check, for our kinds and for those of others."""

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
def told(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The answer of the type check to right and wrong settings, each wrong one in a line of its own."""
    file = tmp_path_factory.mktemp("types") / "snippet.py"
    file.write_text(HEAD + RIGHT + "".join(f"print({text})\n" for text in WRONG))
    root = Path(__file__).parents[2]
    command = [sys.executable, "-m", "mypy", "--config-file", str(root / "pyproject.toml"), str(file)]
    return subprocess.run(command, cwd=root, capture_output=True, text=True, check=False).stdout


def test_a_misspelt_setting_does_not_pass_the_type_check(told: str) -> None:
    for text, words in WRONG.items():
        assert words in told, text


def test_settings_that_are_there_pass(told: str) -> None:
    assert f"Found {len(WRONG)} errors in 1 file" in told
