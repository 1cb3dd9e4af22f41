"""Test of a program in real time: the robot's own cycle, its real wires, a tool that follows the surface."""

import json
import subprocess
from pathlib import Path

import pytest

from tests.live.processes import HIL, PATIENCE_S, PATIENT

pytestmark = pytest.mark.live

PROGRAM = """
[cell]
start_position_mm = [900.0, -12.0, 592.0]
netft.boot_s = 0.2
[cell.surface]
kind = "sphere"
radius_mm = 300.0
[task]
retract_mm = 3.0
[[task.step]]
do = "approach"
[[task.step]]
do = "track"
path = { kind = "polyline", points_mm = [[0, 0], [15, 0], [15, 8]] }
speed_mm_s = 5.0
orientation = "normal"
criterion = { within_n = 3.0, for_percent = 80 }
[[task.step]]
do = "hold"
for_s = 0.5
name = "end"
[[task.step]]
do = "retract"
"""


def test_program_follows_curved_surface_in_real_time(tmp_path: Path) -> None:
    config, record, summary = (tmp_path / name for name in ("program.toml", "run.mcap", "summary.json"))
    config.write_text(PROGRAM + PATIENT, encoding="utf-8")
    command = (*HIL, "run", config, "--robot", "egm", "--sensor", "netft", "--no-view")
    outputs = ("--record", record, "--summary", summary)
    done = subprocess.run(
        (*command, *outputs), capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert done.returncode == 0, done.stderr + done.stdout
    reported = json.loads(summary.read_text(encoding="utf-8"))
    assert reported["figures"]["contact_losses"] == 0
    assert reported["left"].startswith("retracted")
    again = subprocess.run(
        (*HIL, "replay", record), capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert again.returncode == 0, again.stdout + again.stderr
