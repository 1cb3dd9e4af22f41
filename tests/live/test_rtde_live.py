"""The robot over RTDE in real time, over TCP on this computer."""

import json
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from protocol.rtde import packets

pytestmark = pytest.mark.live

CONFIG = """
[run]
period_ms = 20
[controller]
sample_ms = 20
[cell]
start_position_mm = [900, -100, 592]
"""


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "hil_bridge", *arguments]


def test_ten_newtons_in_real_time_over_three_ports(tmp_path: Path) -> None:
    config, summary = tmp_path / "ur.toml", tmp_path / "s.json"
    config.write_text(CONFIG)
    arguments = ["run", str(config), "--robot", "rtde", "--duration", "1.5", "--no-view", "--no-record"]
    done = subprocess.run(
        command(*arguments, "--summary", str(summary)),
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "left: retracted" in done.stdout
    found = json.loads(summary.read_text())
    assert found["force_mean_steady_n"] == pytest.approx(10.0, abs=1.0)
    assert found["link"]["answers"] == found["link"]["packets"]


def wait_until_fed(host: str, port: int) -> None:
    """Until another client is told that the input is in use. It asks for no_input too, so that it claims nothing."""
    asking = packets.inputs_request(("external_force_torque", "no_input"))
    for _ in range(200):
        with socket.create_connection((host, port), timeout=10) as rtde:
            rtde.sendall(asking)
            if b"IN_USE" in rtde.recv(100):
                return
        time.sleep(0.05)
    raise AssertionError("the force source holds no input")


def test_a_force_source_ends_at_its_time_and_with_its_robot() -> None:
    with subprocess.Popen(
        command("emulate", "robot", "--robot", "rtde", "--json"), stdout=subprocess.PIPE, text=True
    ) as serving:
        try:
            assert serving.stdout is not None
            url = json.loads(serving.stdout.readline())["robot"]
            feed = command("force-source", url, "--duration")
            told = subprocess.run(
                [*feed, "0.5"], capture_output=True, text=True, timeout=30, check=True
            ).stdout
            assert told.startswith("gave the force to ")
            assert int(told.split()[4]) > 50
            with subprocess.Popen([*feed, "60"], stderr=subprocess.PIPE, text=True) as until:
                host, _, port = url.partition("//")[2].partition("?")[0].partition(":")
                wait_until_fed(host, int(port))
                serving.send_signal(signal.SIGTERM)
                _, why = until.communicate(timeout=30)
            assert until.returncode == 3
            assert why.count("\n") == 1
        finally:
            serving.kill()
