"""Tests of the panel as an operator uses it: a run in one terminal, `hil-bridge panel` in another."""

import json
import re
import signal
import subprocess
import time
from pathlib import Path

import pytest

from hil_bridge.record import read
from tests.live.processes import (
    HIL,
    NEAR,
    PATIENCE_S,
    Growing,
    emulator_urls,
    start,
    wait_until,
    without_notices,
)

pytestmark = pytest.mark.live

LOOPBACK = "tcp-listen://127.0.0.1:0"
STOOD_S = 0.4
"""Time for which a process is paused, s."""


def panel(url: str, *arguments: str) -> str:
    done = subprocess.run(
        [*HIL, "panel", url, *arguments], capture_output=True, text=True, timeout=PATIENCE_S
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def test_emergency_stop_from_other_terminal_ends_run(tmp_path: Path) -> None:
    record, summary = tmp_path / "r.mcap", tmp_path / "s.json"
    config = tmp_path / "c.toml"
    config.write_text(NEAR)
    run = start(
        *(
            "run",
            str(config),
            "--no-view",
            "--panel",
            LOOPBACK,
            "--record",
            str(record),
            "--summary",
            str(summary),
        )
    )
    try:
        assert run.stdout is not None
        url = run.stdout.readline().strip().removeprefix("panel: ")
        wait_until(Growing(record).tracks, run)
        displayed = panel(url, "show")
        assert displayed.startswith("mode          operation, movement sequence\n")
        assert panel(url, "emergency-stop").splitlines()[1].split()[1:3] == ["EMERGENCY", "STOP,"]
        output, errors = run.communicate(timeout=PATIENCE_S)
    finally:
        run.kill()
        run.communicate()
    assert run.returncode == 3
    assert "stopped" in output.splitlines()
    assert errors.count("\n") == 1
    assert "emergency stop" in errors
    figures = json.loads(summary.read_text())
    assert (figures["outcome"], figures["truncated"]) == ("stopped", False)
    assert "emergency stop" in figures["text"]
    recording = read(record)
    assert not recording.truncated
    assert any("operational error 13.0" in event.text for event in recording.events)
    assert recording.cycles[-1].phase == "track"


def test_emulated_robot_is_operated_by_panel() -> None:
    process = start("emulate", "robot", "--panel", LOOPBACK, "--json")
    try:
        where = emulator_urls(process)
        assert list(where) == ["robot", "panel"]
        assert "key in MANUAL" in panel(where["panel"], "key", "manual")
        assert "corrupt-block (2)" in panel(where["panel"], "inject", "corrupt-block", "count=2")
        process.send_signal(signal.SIGTERM)
        output, errors = process.communicate(timeout=PATIENCE_S)
        assert (output, without_notices(errors)) == ("", "")
        assert process.returncode == 0
    finally:
        process.kill()
        process.communicate()
    gone = subprocess.run([*HIL, "panel", where["panel"]], capture_output=True, text=True, timeout=PATIENCE_S)
    assert gone.returncode == 3
    assert gone.stderr.count("\n") == 1
    assert "no panel answers" in gone.stderr


def test_paused_emulator_reports_duration() -> None:
    """Its clients then miss packets, although no cable is at fault."""
    process = start("emulate", "robot", "--robot", "egm", "--json")
    try:
        emulator_urls(process)
        time.sleep(1.2)
        process.send_signal(signal.SIGSTOP)
        time.sleep(STOOD_S)
        process.send_signal(signal.SIGCONT)
        time.sleep(1.5)
        process.send_signal(signal.SIGTERM)
        _, errors = process.communicate(timeout=PATIENCE_S)
    finally:
        process.kill()
        process.communicate()
    *parts, last = [line for line in errors.splitlines() if line.startswith("this process was late")]
    late_ms = [
        float(part.partition("late by up to ")[2].partition(" ms, and its devices with it")[0])
        for part in parts
    ]
    assert max(late_ms) >= STOOD_S * 0.9e3
    assert re.fullmatch(
        r"this process was late in \d+ of \d+ s, by up to \d+ ms: end other programs .*", last
    )
    assert f"by up to {max(late_ms):.0f} ms" in last
