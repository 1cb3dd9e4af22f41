"""Bridge and emulator as two processes, over pseudo-terminals and TCP in real time."""

import json
import math
import os
import pty
import signal
import subprocess
import sys
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from hil_bridge.errors import ConfigError
from hil_bridge.record import read

pytestmark = pytest.mark.live

HIL = (sys.executable, "-c", "from hil_bridge.cli import main; main()")
PATIENCE = 60.0
"""Longest wait for a whole process on a busy machine, s."""


def start(*arguments: str) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [*HIL, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, bufsize=1
    )


@contextmanager
def emulated(
    *arguments: str, stop: signal.Signals = signal.SIGTERM
) -> Iterator[tuple["subprocess.Popen[str]", list[str]]]:
    """An emulator process, and the options that connect a run to it; it must end well when asked to."""
    process = start("emulate", *arguments, "--json")
    try:
        assert process.stdout is not None
        where = json.loads(process.stdout.readline())
        yield process, [text for device, url in where.items() for text in (f"--{device}", url)]
        if process.poll() is None:
            process.send_signal(stop)
            assert process.communicate(timeout=PATIENCE) == ("", "")
            assert process.returncode == 0
    finally:
        process.kill()
        process.communicate()


def wait_until(happened: Callable[[], bool]) -> None:
    ends = time.monotonic() + PATIENCE
    while not happened():
        assert time.monotonic() < ends
        time.sleep(0.05)


def tracking(record: Path) -> Callable[[], bool]:
    """Whether the recording, as far as it is written, has come to the tracking of the surface."""

    def reached() -> bool:
        try:
            return read(record).cycles[-1].phase == "track"
        except ConfigError:  # not there yet, or no whole cycle in it
            return False

    return reached


@pytest.fixture
def short(tmp_path: Path) -> str:
    """A configuration that retracts by little, to save time, and knows the emulated cell's tool."""
    path = tmp_path / "c.toml"
    path.write_text(
        "[task]\nretract_mm = 3.0\n[tool]\nmass_kg = 0.5\ncentre_of_gravity_mm = [0.0, 0.0, 80.0]\n"
    )
    return str(path)


def finish(process: "subprocess.Popen[str]") -> tuple[int, list[str], str]:
    output, errors = process.communicate(timeout=PATIENCE)
    return process.returncode, output.splitlines(), errors


def test_two_processes_hold_ten_newtons(tmp_path: Path, short: str) -> None:
    with emulated("cell") as (_, options):
        summary = tmp_path / "s.json"
        code, lines, errors = finish(
            # a steady state is 40 cycles, which on a busy machine may take twice their time
            start(
                "run",
                short,
                *options,
                "--duration",
                "15",
                "--no-view",
                "--no-record",
                "--summary",
                str(summary),
            )
        )
        assert (code, errors) == (0, "")
        assert "completed" in lines
        figures = json.loads(summary.read_text())
        assert figures["force_mean_steady_n"] == pytest.approx(10.0, abs=0.6)
        assert figures["sensor_frames_lost"] == 0


def test_a_run_speaks_as_the_observed_client_over_a_pseudo_terminal(short: str) -> None:
    with emulated("cell", "--link-profile", "observed-client") as (_, options):
        code, lines, errors = finish(
            start(
                "run",
                short,
                *options,
                "--link-profile",
                "observed-client",
                "--duration",
                "4",
                "--no-view",
                "--no-record",
            )
        )
        assert (code, errors) == (0, "")
        assert "completed" in lines


def test_a_run_emulates_the_sensor_that_it_is_told_to(tmp_path: Path) -> None:
    config, record = tmp_path / "c.toml", tmp_path / "run.mcap"
    config.write_text(
        '[task]\nretract_mm = 3.0\n[sensor]\nemulated = "jr3-uart"\n'
        "[sensor.jr3.uart]\npause_s = 0.3\nack_timeout_s = 0.5\n[cell.jr3.uart]\nboot_s = 0.2\ndeaf_s = 0.2\n"
    )
    code, lines, errors = finish(
        start("run", str(config), "--duration", "4", "--no-view", "--record", str(record))
    )
    assert (code, errors) == (0, "")
    assert "completed" in lines
    truths = read(record).truths
    # when the sample was taken only the cell knows
    assert sum(math.isfinite(truth.sampled_at) for truth in truths) > 0.9 * len(truths) > 0.0


def test_a_killed_emulator_ends_the_run_at_once_with_its_cause(tmp_path: Path) -> None:
    record = tmp_path / "r.mcap"
    with emulated("cell", "--robot-port", "s3+tcp-listen://127.0.0.1:0?baudrate=9600&parity=E") as (
        cell,
        options,
    ):
        assert options[1].startswith("s3+tcp://127.0.0.1:")
        run = start("run", *options, "--unchecked", "--no-view", "--record", str(record))
        wait_until(tracking(record))
        cell.kill()
        killed = time.monotonic()
        code, lines, errors = finish(run)
        assert time.monotonic() - killed < 5.0
        assert (code, errors.count("\n")) == (3, 1)
        assert "stopped" in lines
        assert errors.startswith(f"hil-bridge: stopped: {options[1].removeprefix('s3+')}: the other side ")
    code, _, errors = finish(start("report", str(record), "--out", str(tmp_path)))
    assert (code, errors) == (0, "")


def test_ctrl_c_retracts_and_leaves_everything(tmp_path: Path, short: str) -> None:
    record, summary = tmp_path / "r.mcap", tmp_path / "s.json"
    run = start(
        *(
            "run",
            short,
            "--no-view",
            "--record",
            str(record),
            "--summary",
            str(summary),
            "--report",
            str(tmp_path),
        )
    )
    wait_until(tracking(record))
    run.send_signal(signal.SIGINT)
    code, lines, errors = finish(run)
    assert (code, errors) == (130, "")
    assert "interrupted" in lines
    assert lines[-2] == f"report: {tmp_path / 'report.html'}"
    assert lines[-1].startswith("left: retracted, ")
    figures = json.loads(summary.read_text())
    assert (figures["outcome"], figures["truncated"]) == ("interrupted", False)
    assert list(figures["phases_s"])[-2:] == ["track", "retract"]


def test_ctrl_c_while_connecting_ends_at_once(tmp_path: Path) -> None:
    """The robot is a pseudo-terminal that does not answer."""
    master, slave = pty.openpty()
    try:
        tty.setraw(slave)
        record = tmp_path / "r.mcap"
        device = os.ttyname(slave)
        with emulated("sensor", stop=signal.SIGINT) as (_, options):
            run = start(
                *("run", "--robot", f"s3+serial://{device}", *options, "--unchecked", "--no-view"),
                *("--record", str(record)),
            )
            assert os.read(master, 1) == b"\x05"
            run.send_signal(signal.SIGINT)
            asked = time.monotonic()
            code, lines, errors = finish(run)
            assert time.monotonic() - asked < 5.0
            assert (code, errors.strip()) == (130, "")
            assert lines == ["interrupted: before the movement began", f"record: {record}"]
            assert record.stat().st_size
    finally:
        os.close(master)
        os.close(slave)


def test_a_port_that_another_holds_is_named(tmp_path: Path) -> None:
    with emulated("sensor") as (_, options):
        master, slave = pty.openpty()
        held = f"s3+serial://{os.ttyname(slave)}"
        holder = start("run", "--robot", held, *options, "--unchecked", "--no-view", "--no-record")
        try:
            assert os.read(master, 1) == b"\x05"
            code, _, errors = finish(
                start("run", "--robot", held, *options, "--unchecked", "--no-view", "--no-record")
            )
            assert (code, errors.count("\n")) == (3, 1)
            assert "another program holds the port; `fuser -v " in errors
        finally:
            holder.kill()
            holder.communicate()
            os.close(master)
            os.close(slave)


@pytest.mark.parametrize(
    ("robot", "sensor"), [("egm", "netft"), ("rsi", "netft"), ("rtde", "ft300"), ("rtde", "jr3-board")]
)
def test_two_processes_hold_ten_newtons_with_devices_of_today(
    robot: str, sensor: str, tmp_path: Path, short: str
) -> None:
    """UDP, TCP and a pseudo-terminal in real time; the set points go over them every few milliseconds."""
    near, summary = tmp_path / "near.toml", tmp_path / "s.json"
    near.write_text("[cell]\nstart_position_mm = [900.0, -100.0, 593.0]\n[cell.netft]\nboot_s = 0.2\n")
    with emulated("cell", str(near), "--robot", robot, "--sensor", sensor) as (_, options):
        options = [text for text in options if text not in ("--tool-mass-kg", "0.5")]
        code, lines, errors = finish(
            start(
                *("run", short, *options, "--duration", "3", "--no-view", "--no-record"),
                *("--summary", str(summary)),
            )
        )
    assert (code, errors) == (0, ""), lines
    figures = json.loads(summary.read_text())
    assert figures["force_mean_steady_n"] == pytest.approx(10.0, abs=0.5)
    assert figures["figures"]["contact_losses"] == 0
    assert lines[-1].startswith("left: retracted")
