"""Test of three processes on one vcan interface: the bridge, the emulated cell, and an independent logger."""

import json
import signal
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from hil_bridge.record import read

pytestmark = pytest.mark.vcan

HIL = (sys.executable, "-c", "from hil_bridge.cli import main; main()")
FORCES = "601"
"""Identifier of the force half of a sample, from the firmware's source: forces, node 1."""
PATIENCE = 150.0
"""Maximum wait for a complete process on an emulated computer, s."""


def test_loop_holds_force_and_bus_log_agrees(
    vcan: Any, command: Callable[[str], str], tmp_path: Path
) -> None:
    record, summary, log = tmp_path / "r.mcap", tmp_path / "s.json", tmp_path / "can.log"
    config = tmp_path / "c.toml"
    config.write_text(
        "[task]\nretract_mm = 1.0\n[cell]\nstart_position_mm = [900.0, -100.0, 591.0]\njr3.gateway.boot_s = 0.5\n"
    )
    with log.open("wb") as file:
        logger = subprocess.Popen([command("candump"), "-L", vcan.name], stdout=file)
    cell = subprocess.Popen(
        [*HIL, "emulate", "cell", str(config), "--sensor-port", f"jr3+{vcan.url}", "--json"],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert cell.stdout is not None
        where = json.loads(cell.stdout.readline())
        assert where["sensor"] == f"jr3+{vcan.url}"
        run = subprocess.run(
            [
                *(*HIL, "run", str(config), "--robot", where["robot"], "--sensor", where["sensor"]),
                *(
                    "--duration",
                    "5",
                    "--unchecked",
                    "--no-view",
                    "--record",
                    str(record),
                    "--summary",
                    str(summary),
                ),
            ],
            capture_output=True,
            text=True,
            check=False,
            timeout=PATIENCE,
        )
        assert (run.returncode, run.stderr) == (0, "")
        assert "completed" in run.stdout.splitlines()
        cell.send_signal(signal.SIGTERM)
        assert cell.wait(PATIENCE) == 0
        logger.send_signal(signal.SIGTERM)
        assert logger.wait(PATIENCE) == 0
    finally:
        for process in (cell, logger):
            process.kill()
            process.wait()
        assert cell.stdout is not None
        cell.stdout.close()

    figures = json.loads(summary.read_text())
    recording = read(record)
    forces = [cycle.force for cycle in recording.cycles if cycle.phase == "track"]
    assert sum(forces[-10:]) / 10 == pytest.approx(10.0, abs=1.5)
    assert figures["sensor_frames_lost"] == sum(figures["recorder_dropped"].values()) == 0

    frames = [line.split()[2].split("#") for line in log.read_text().splitlines()]
    logged = [
        struct.unpack("<3h", bytes.fromhex(data)[:6]) for identifier, data in frames if identifier == FORCES
    ]
    recorded = [sample.counts[:3] for sample in recording.sensors]
    assert len(recorded) == figures["sensor_frames_received"] > 500
    # the stream begins before the bridge is ready for it, and its last frame may cross the stop
    assert len(recorded) <= len(logged) <= len(recorded) + 30
    assert any(
        logged[skipped : skipped + len(recorded)] == recorded
        for skipped in range(len(logged) - len(recorded) + 1)
    )
