"""Tests of the ends of a run in contact over pseudo-terminals, with the cell in a separate process.

The cell outlives the run: its panel shows where the tool was left, and so its force.
`tests/guard/test_process_edges.py` and `tests/guard/test_ways_out.py` test the effects of signals and faults in virtual
time.
"""

import os
import pty
import subprocess
import termios
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hil_bridge.devices.panel import ask
from hil_bridge.record import EventKind, read
from tests.live.processes import HIL, NEAR, PATIENCE_S, Growing, emulator_urls, start, wait_until

pytestmark = pytest.mark.live

AT_THE_KEYBOARD = "import fcntl, termios\nfcntl.ioctl(0, termios.TIOCSCTTY, 0)\n"
"""Makes standard input the terminal from which the process was started."""
SURFACE_MM, STIFFNESS_N_MM = 590.0, 5.0
CONFIG = f"""
{NEAR}
[limits]
cycle_deadline_ms = 5000.0
stale_after_ms = 1500.0
retract_patience_s = 2.0
"""
"""Configuration that tolerates a busy machine."""


class Cell:
    """Emulated cell in a separate process."""

    def __init__(self, folder: Path) -> None:
        (folder / "c.toml").write_text(CONFIG)
        panel = ("--panel", "tcp-listen://127.0.0.1:0")
        self.process = start("emulate", "cell", str(folder / "c.toml"), "--json", *panel)
        where = emulator_urls(self.process)
        self.panel = where.pop("panel")
        self.options = [text for name, value in where.items() for text in (f"--{name}", value)]

    @property
    def force(self) -> float:
        """Return the true force of the surface, N."""
        z = ask(self.panel, {"do": "show"})["state"]["true_position_mm"][2]
        return max(0.0, SURFACE_MM - float(z)) * STIFFNESS_N_MM


@pytest.fixture
def cell(tmp_path: Path) -> Iterator[Cell]:
    made = Cell(tmp_path)
    yield made
    made.process.kill()
    made.process.communicate()


def test_keys_mark_and_end_run_and_restore_terminal(cell: Cell, tmp_path: Path) -> None:
    master, slave = pty.openpty()
    typing = termios.tcgetattr(slave)
    command = [HIL[0], "-c", AT_THE_KEYBOARD + HIL[2], "run", "c.toml", *cell.options]
    run = subprocess.Popen(
        [*command, "--overwrite", "--duration", "600", "--record", "run.mcap"],
        cwd=tmp_path,
        stdin=slave,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    try:
        wait_until(Growing(tmp_path / "run.mcap").presses, run)
        os.write(master, b"mr")
        output, _ = run.communicate(timeout=PATIENCE_S)
        wait_until(lambda: cell.force == 0.0)
        assert termios.tcgetattr(slave) == typing
    finally:
        run.kill()
        run.communicate()
        os.close(master)
        os.close(slave)
    assert (run.returncode, output.splitlines()[-1][:17]) == (130, "left: retracted, ")
    assert "Traceback" not in output
    record = read(tmp_path / "run.mcap")
    assert record.end["outcome"] == "interrupted"
    reported = [event.text for event in record.events if event.kind in (EventKind.MARK, EventKind.OPERATOR)]
    assert reported == ["number 1", "requested the end with the key r"]


@pytest.mark.timeout(300)
def test_run_after_kill_9_is_refused_until_tool_is_freed(cell: Cell, tmp_path: Path) -> None:
    """An operator then frees it."""

    def hil(*arguments: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            [*HIL, *arguments], cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE_S, check=False
        )

    run = subprocess.Popen(
        [*HIL, "run", "c.toml", *cell.options, "--no-view", "--record", "run.mcap"],
        cwd=tmp_path,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        wait_until(Growing(tmp_path / "run.mcap").presses, run)
    finally:
        run.kill()
        run.wait()
    time.sleep(1.0)  # until the arm stands still, where the last order left it
    left = cell.force
    assert left > 3.0
    again = hil("run", "c.toml", *cell.options, "--no-view", "--no-record")
    assert (again.returncode, cell.force) == (3, pytest.approx(left, abs=0.7))
    assert "the tool touches something" in again.stderr
    freed = hil("free", "c.toml", *cell.options, "--distance-mm", "4")
    assert (freed.returncode, freed.stderr) == (0, "")
    last = freed.stdout.splitlines()[-1]
    assert last.startswith("freed by 4.0 mm: contact force ")
    assert last.endswith(" N before, 0.0 N after")
    assert cell.force == 0.0
