"""Test of the harmless part of the suites, on devices that another process emulates over loopback."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.live

MODULE = """
import pytest
from hil_bridge.devices.kinds import ROBOTS, SENSORS
from hil_bridge.testing import RobotCase, SensorCase
from hil_bridge.testing.robot_clients import *
from hil_bridge.testing.sensor_clients import *

@pytest.fixture
def robot_client():
    return RobotCase(ROBOTS.kind("rtde"))

@pytest.fixture
def sensor_client():
    return SensorCase(SENSORS.kind("netft"))
"""
PATIENCE_S = 60.0
OPTIONS = ("-q", "-p", "hil_bridge.testing.plugin", "-p", "no:cacheprovider", "-k", "live")


def test_harmless_tests_pass_on_devices_of_other_process(tmp_path: Path) -> None:
    (tmp_path / "test_mine.py").write_text(MODULE)
    emulate = [sys.executable, "-m", "hil_bridge", "emulate", "cell", "--robot", "rtde", "--sensor", "netft"]
    emulator = subprocess.Popen([*emulate, "--json"], stdout=subprocess.PIPE, text=True)
    try:
        assert emulator.stdout is not None
        urls = json.loads(emulator.stdout.readline())
        live = [f"--hil-live={urls[device]}" for device in ("robot", "sensor")]
        reported = subprocess.run(
            [sys.executable, "-m", "pytest", *OPTIONS, *live, str(tmp_path)],
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
        assert reported.returncode == 0, reported.stdout
        assert "robot client, suite version 2: 1 run (1 passed), 0 skipped" in reported.stdout
        assert "sensor client, suite version 2: 1 run (1 passed), 0 skipped" in reported.stdout
    finally:
        emulator.terminate()
        emulator.communicate(timeout=PATIENCE_S)
