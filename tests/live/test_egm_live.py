"""Test of a robot guided by EGM and its sensor in one process, the bridge in another, in real time over UDP."""

import json
import socket
import subprocess
from pathlib import Path

import pytest

from tests.live.processes import HIL, PATIENCE_S, PATIENT, Growing, emulated, finish, start, wait_until

pytestmark = pytest.mark.live

QUICK = f"""
{PATIENT}
[run]
period_ms = 20
duration_s = {{seconds}}
[controller]
sample_ms = 20
[task]
approach_speed_mm_s = 5.0
retract_speed_mm_s = 20.0
retract_mm = 5.0
[cell]
start_position_mm = [900.0, -100.0, 593.0]
jr3.gateway.boot_s = 0.2
[cell.egm]
retry_s = 0.5
"""


def free_url() -> str:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return f"egm+udp://127.0.0.1:{probe.getsockname()[1]}"


def test_run_over_udp_succeeds_after_killed_run(tmp_path: Path) -> None:
    """The robot times out, waits, and begins another session at its current pose."""
    short, long = tmp_path / "short.toml", tmp_path / "long.toml"
    short.write_text(QUICK.format(seconds=1.0))
    long.write_text(QUICK.format(seconds=60.0))
    with emulated("cell", str(short), "--robot-port", free_url()) as (_, options):
        record, summary = tmp_path / "killed.mcap", tmp_path / "run.json"
        killed = start("run", str(long), *options, "--no-view", "--record", str(record))
        try:
            wait_until(Growing(record).tracks, killed)
        finally:
            killed.kill()
            killed.communicate()
        free = [*HIL, "free", str(short), *options, "--distance-mm", "5"]
        lifted = subprocess.run(free, capture_output=True, text=True, check=False, timeout=PATIENCE_S)
        assert lifted.returncode == 0, lifted.stderr
        outputs = ("--no-record", "--summary", str(summary))
        code, _, errors = finish(start("run", str(short), *options, "--no-view", *outputs))
    assert (code, errors) == (0, "")
    result = json.loads(summary.read_text())
    assert result["outcome"] == "completed"
    assert result["left"].startswith("retracted")
