"""Test of bridge and emulator as two processes whose set points are sent every few milliseconds."""

import json
from pathlib import Path

import pytest

from tests.live.processes import PATIENT, emulated, finish, start

pytestmark = pytest.mark.live

QUICK_BOARD = (
    "[sensor.jr3.board]\noffset_polls = 1\npoll_s = 0.2\n[cell.jr3.board]\noffsets_zeroed_s = 0.05\n"
)


@pytest.mark.parametrize(("robot", "sensor"), [("rsi", "ft300"), ("rtde", "jr3-board")])
def test_two_processes_hold_ten_newtons_with_current_devices(
    robot: str, sensor: str, tmp_path: Path, near: str
) -> None:
    """UDP, TCP and a pseudo-terminal in real time; set points are sent every few milliseconds."""
    summary = tmp_path / "s.json"
    with Path(near).open("a") as config:
        config.write(QUICK_BOARD + PATIENT)
    with emulated("cell", near, "--robot", robot, "--sensor", sensor) as (_, options):
        options = [text for text in options if text not in ("--tool-mass-kg", "0.5")]
        if sensor == "jr3-board":
            options[-1] += "?filter=2"
            assert options[-1].startswith("jr3-board+tcp://127.0.0.1:")
        code, lines, errors = finish(
            start(
                *("run", near, *options, "--duration", "2", "--no-view", "--no-record"),
                *("--summary", str(summary)),
            )
        )
    assert (code, errors) == (0, ""), lines
    figures = json.loads(summary.read_text())
    assert figures["force_mean_steady_n"] == pytest.approx(10.0, abs=0.5)
    assert figures["figures"]["contact_losses"] == 0
    assert lines[-1].startswith("left: retracted")
