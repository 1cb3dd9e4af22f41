"""A robot guided by EGM and its sensor in one process, the bridge in another, in real time over UDP."""

import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

pytestmark = pytest.mark.live

HIL = (sys.executable, "-c", "from hil_bridge.cli import main; main()")
PATIENCE_S = 60.0
QUICK = """
[run]
period_ms = 20
duration_s = {seconds}
[controller]
sample_ms = 20
[task]
approach_speed_mm_s = 5.0
retract_speed_mm_s = 20.0
retract_mm = 5.0
[cell]
start_position_mm = [900.0, -100.0, 593.0]
[cell.egm]
retry_s = 0.5
"""


@contextmanager
def emulated_cell(config: Path) -> Iterator[list[str]]:
    """Options of a run that reaches an emulated cell in another process."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        url = f"egm+udp://127.0.0.1:{probe.getsockname()[1]}"
    command = [*HIL, "emulate", "cell", str(config), "--robot-port", url, "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            where = json.loads(process.stdout.readline())
            yield [text for device, at in where.items() for text in (f"--{device}", at)]
            process.send_signal(signal.SIGTERM)
            assert process.communicate(timeout=PATIENCE_S) == ("", "")
        finally:
            process.kill()


def command(config: Path, options: list[str], *more: str) -> list[str]:
    return [*HIL, "run", str(config), *options, "--no-view", *more]


def test_a_run_over_udp_and_another_one_behind_one_that_was_killed(tmp_path: Path) -> None:
    """The robot is left by a time-out, waits, and begins another session where the tool stands."""
    short, long = tmp_path / "short.toml", tmp_path / "long.toml"
    short.write_text(QUICK.format(seconds=1.0))
    long.write_text(QUICK.format(seconds=60.0))
    with emulated_cell(short) as options:
        with subprocess.Popen(
            command(long, options, "--record", str(tmp_path / "killed.mcap")), stderr=subprocess.DEVNULL
        ) as killed:
            time.sleep(7.0)  # in the midst of it
            killed.kill()
        lifted = subprocess.run(
            [*HIL, "free", str(short), *options, "--distance-mm", "5"],
            capture_output=True,
            text=True,
            check=False,
            timeout=PATIENCE_S,
        )
        assert lifted.returncode == 0, lifted.stderr
        summary = tmp_path / "run.json"
        done = subprocess.run(
            command(short, options, "--record", str(tmp_path / "run.mcap"), "--summary", str(summary)),
            capture_output=True,
            text=True,
            check=False,
            timeout=PATIENCE_S,
        )
    assert done.returncode == 0, done.stderr
    found = json.loads(summary.read_text())
    assert found["outcome"] == "completed"
    assert found["left"].startswith("retracted")
