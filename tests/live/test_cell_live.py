"""Tests of bridge and emulator as two processes, over pseudo-terminals and TCP in real time."""

import json
import os
import pty
import signal
import time
import tty
from pathlib import Path

import pytest

from hil_bridge.record import read
from tests.live.processes import Growing, emulated, finish, start, wait_until

pytestmark = pytest.mark.live

SETTLED_S = 2.0
"""Tracking time after which the force is steady, s."""


def test_two_processes_hold_ten_newtons(tmp_path: Path, near: str) -> None:
    record, summary = tmp_path / "r.mcap", tmp_path / "s.json"
    with emulated("cell", near) as (_, options):
        options = [text for text in options if text not in ("--tool-mass-kg", "0.5")]
        outputs = ("--record", str(record), "--summary", str(summary))
        run = start("run", near, *options, "--duration", "5", "--no-view", *outputs)
        code, lines, errors = finish(run)
    assert (code, errors) == (0, "")
    assert "completed" in lines
    assert json.loads(summary.read_text())["sensor_frames_lost"] == 0
    tracked = [cycle for cycle in read(record).cycles if cycle.phase == "track"]
    steady = [
        cycle.force for cycle in tracked if cycle.sample.sensor_at > tracked[0].sample.sensor_at + SETTLED_S
    ]
    assert len(steady) > 5
    assert sum(steady) / len(steady) == pytest.approx(10.0, abs=0.6)


def test_killed_emulator_ends_run_with_cause(tmp_path: Path, near: str) -> None:
    record = tmp_path / "r.mcap"
    port = ("--robot-port", "s3+tcp-listen://127.0.0.1:0?baudrate=9600&parity=E")
    with emulated("cell", near, *port) as (cell, options):
        assert options[1].startswith("s3+tcp://127.0.0.1:")
        run = start("run", *options, "--unchecked", "--no-view", "--record", str(record))
        wait_until(Growing(record).tracks, run)
        cell.kill()
        killed = time.monotonic()
        code, lines, errors = finish(run)
        assert time.monotonic() - killed < 5.0
        assert (code, errors.count("\n")) == (3, 1)
        assert "stopped" in lines
        assert errors.startswith(f"hil-bridge: stopped: {options[1].removeprefix('s3+')}: the other side ")
    code, _, errors = finish(start("report", str(record), "--output", str(tmp_path)))
    assert (code, errors) == (0, "")


def test_ctrl_c_retracts_and_cleans_up(tmp_path: Path, near: str) -> None:
    record, summary = tmp_path / "r.mcap", tmp_path / "s.json"
    run = start(
        *(
            "run",
            near,
            "--no-view",
            "--record",
            str(record),
            "--summary",
            str(summary),
            "--report",
            str(tmp_path),
        )
    )
    wait_until(Growing(record).tracks, run)
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
            requested = time.monotonic()
            code, lines, errors = finish(run)
            assert time.monotonic() - requested < 5.0
            assert (code, errors.strip()) == (130, "")
            assert lines == ["interrupted: before the movement began", f"record: {record}"]
            assert record.stat().st_size
    finally:
        os.close(master)
        os.close(slave)


def test_port_in_use_is_named(tmp_path: Path) -> None:
    with emulated("sensor") as (_, options):
        master, slave = pty.openpty()
        address = f"s3+serial://{os.ttyname(slave)}"
        holder = start("run", "--robot", address, *options, "--unchecked", "--no-view", "--no-record")
        try:
            assert os.read(master, 1) == b"\x05"
            code, _, errors = finish(
                start("run", "--robot", address, *options, "--unchecked", "--no-view", "--no-record")
            )
            assert (code, errors.count("\n")) == (3, 1)
            assert "another program holds the port; `fuser -v " in errors
        finally:
            holder.kill()
            holder.communicate()
            os.close(master)
            os.close(slave)
