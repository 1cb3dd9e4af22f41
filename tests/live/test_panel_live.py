"""The panel as a person uses it: a run in one terminal, `hil-bridge panel` in another."""

import json
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from hil_bridge.errors import BridgeError
from hil_bridge.record import read

pytestmark = pytest.mark.live

HIL = (sys.executable, "-c", "from hil_bridge.cli import main; main()")
PATIENCE = 60.0
"""Longest wait for a whole process on a busy machine, s."""
LOOPBACK = "tcp-listen://127.0.0.1:0"


def start(*arguments: str) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [*HIL, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, bufsize=1
    )


def panel(url: str, *arguments: str) -> str:
    done = subprocess.run([*HIL, "panel", url, *arguments], capture_output=True, text=True, timeout=PATIENCE)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def tracking(record: Path) -> bool:
    """Whether a run whose record is being written has come to follow the surface."""
    with suppress(BridgeError):  # nothing of it is on the disk yet
        return any(cycle.phase == "track" for cycle in read(record).cycles)
    return False


def test_an_emergency_stop_from_another_terminal_ends_the_run(tmp_path: Path) -> None:
    record, summary = tmp_path / "r.mcap", tmp_path / "s.json"
    run = start(
        *("run", "--no-view", "--panel", LOOPBACK, "--record", str(record), "--summary", str(summary))
    )
    try:
        assert run.stdout is not None
        url = run.stdout.readline().strip().removeprefix("panel: ")
        ends = time.monotonic() + PATIENCE
        while not tracking(record):
            assert time.monotonic() < ends
            assert run.poll() is None
            time.sleep(0.2)
        shown = panel(url, "show")
        assert shown.startswith("mode          operation, movement sequence\n")
        assert panel(url, "emergency-stop").splitlines()[1].split()[1:3] == ["EMERGENCY", "STOP,"]
        output, errors = run.communicate(timeout=PATIENCE)
    finally:
        run.kill()
        run.communicate()
    assert run.returncode == 3
    assert "stopped" in output.splitlines()
    assert errors.count("\n") == 1
    assert "its status now shows: emergency stop" in errors
    figures = json.loads(summary.read_text())
    assert (figures["outcome"], figures["truncated"]) == ("stopped", False)
    assert "its status now shows: emergency stop" in figures["text"]
    recording = read(record)
    assert not recording.truncated
    assert any("operational error 13.0" in event.text for event in recording.events)
    assert recording.cycles[-1].phase == "track"


def test_an_emulated_robot_is_operated_and_ends_well() -> None:
    process = start("emulate", "robot", "--panel", LOOPBACK, "--json")
    try:
        assert process.stdout is not None
        where = json.loads(process.stdout.readline())
        assert list(where) == ["robot", "panel"]
        assert "key in MANUAL" in panel(where["panel"], "key", "manual")
        assert "corrupt-block (2)" in panel(where["panel"], "inject", "corrupt-block", "count=2")
        process.send_signal(signal.SIGTERM)
        assert process.communicate(timeout=PATIENCE) == ("", "")
        assert process.returncode == 0
    finally:
        process.kill()
        process.communicate()
    gone = subprocess.run([*HIL, "panel", where["panel"]], capture_output=True, text=True, timeout=PATIENCE)
    assert gone.returncode == 3
    assert gone.stderr.count("\n") == 1
    assert "no panel answers" in gone.stderr
