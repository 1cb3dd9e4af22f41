"""Tests of external ends of a run: signals, and terminals and pipes that close or stop reading.

Each one happens with the tool on the surface, in real time, and must leave it retracted with a complete recording.
`tests/runs/test_signals_and_screens.py` tests the effect of each signal in virtual time.
"""

import fcntl
import json
import os
import pty
import signal
import struct
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from hil_bridge.record import EventKind, read
from tests.live.processes import HIL, NEAR, PATIENCE_S, Growing, wait_until

pytestmark = pytest.mark.live

OWN_TERMINAL = (
    *(sys.executable, "-c"),
    "import fcntl, os, termios; os.setsid(); fcntl.ioctl(0, termios.TIOCSCTTY, 0); "
    "from hil_bridge.cli import main; main()",
)
"""Command prefix that makes the process the leader of a session whose terminal is its standard input, so that closing
it sends SIGHUP.
"""
LEFT_N = 1.0
"""Largest force that counts as a tool off the surface."""
CTRL_S, CTRL_Z = b"\x13", b"\x1a"


class Terminal:
    """Far end of a pseudo-terminal, with a reader that can stop reading."""

    def __init__(self) -> None:
        self.master, self.slave = pty.openpty()
        fcntl.ioctl(self.slave, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 100, 0, 0))
        self.output = b""
        self._closed = False
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        with suppress(OSError):
            while data := os.read(self.master, 4096):
                self.output += data

    def press(self, key: bytes) -> None:
        os.write(self.master, key)

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            os.close(self.master)


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    made = Terminal()
    yield made
    os.close(made.slave)
    made.close()


def record_in(folder: Path) -> Path:
    """Wait for the only recording in a folder, and return it."""
    wait_until(lambda: any((folder / "runs").glob("*-c/run.mcap")))
    (path,) = (folder / "runs").glob("*-c/run.mcap")
    return path


def wait_for_tracking(folder: Path) -> None:
    wait_until(Growing(record_in(folder)).tracks)


def wait_for_cycles(folder: Path, more: int) -> None:
    """Wait until the run has made this many more cycles."""
    growing = Growing(record_in(folder))
    before = len(read(growing.path).cycles)

    def come() -> bool:
        recording = growing.news()
        return recording is not None and len(recording.cycles) > before + more

    wait_until(come)


@contextmanager
def running(command: tuple[str, ...], folder: Path, **streams: object) -> Iterator["subprocess.Popen[bytes]"]:
    (folder / "c.toml").write_text(f"[run]\nduration_s = 120.0\n{NEAR}")
    process: subprocess.Popen[bytes] = subprocess.Popen(
        [*command, "run", "c.toml"],
        cwd=folder,
        env={**os.environ, "TERM": "xterm"},
        **streams,  # type: ignore[call-overload]
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def ended_well(process: "subprocess.Popen[bytes]", folder: Path, outcome: str = "interrupted") -> None:
    """Check that the process ends by itself, and that its recording says that the tool was retracted."""
    codes = {"interrupted": 130, "completed": 0, "stopped": 3}
    assert process.wait(PATIENCE_S) == codes[outcome]
    recording = read(record_in(folder))
    assert not recording.truncated
    assert recording.end["outcome"] == outcome
    assert recording.cycles[-1].phase == "retract"
    assert abs(recording.cycles[-1].force) < LEFT_N
    (summary,) = (folder / "runs").glob("*-c/summary.json")
    reported = json.loads(summary.read_text())
    assert reported["outcome"] == outcome
    assert reported["left"].startswith("retracted, ")


def test_suspend_key_retracts(tmp_path: Path, terminal: Terminal) -> None:
    on = terminal.slave
    with running(OWN_TERMINAL, tmp_path, stdin=on, stdout=on, stderr=on) as process:
        wait_for_tracking(tmp_path)
        terminal.press(CTRL_Z)
        ended_well(process, tmp_path)
    wait_until(lambda: terminal.output.splitlines()[-1].startswith(b"left: retracted, "))


def test_closed_terminal_retracts(tmp_path: Path, terminal: Terminal) -> None:
    on = terminal.slave
    with running(OWN_TERMINAL, tmp_path, stdin=on, stdout=on, stderr=on) as process:
        wait_for_tracking(tmp_path)
        wait_until(lambda: b"TRACK" in terminal.output)
        terminal.close()
        ended_well(process, tmp_path)
    assert "SIGHUP" in [
        event.text for event in read(record_in(tmp_path)).events if event.kind == EventKind.SIGNAL
    ]


def test_closed_terminal_without_sighup_keeps_run(tmp_path: Path, terminal: Terminal) -> None:
    """Without a session of its own the process receives no SIGHUP, and every write fails."""
    on = terminal.slave
    with running(HIL, tmp_path, stdin=on, stdout=on, stderr=on) as process:
        wait_for_tracking(tmp_path)
        terminal.close()
        wait_for_cycles(tmp_path, 10)
        process.send_signal(signal.SIGINT)
        ended_well(process, tmp_path)


def test_paused_terminal_blocks_neither_run_nor_ctrl_c(tmp_path: Path, terminal: Terminal) -> None:
    """Sent by another process: the key itself would let the terminal continue."""
    on = terminal.slave
    with running(OWN_TERMINAL, tmp_path, stdin=on, stdout=on, stderr=on) as process:
        wait_for_tracking(tmp_path)
        terminal.press(CTRL_S)
        time.sleep(0.5)  # until what was on its way is shown
        displayed = terminal.output
        wait_for_cycles(tmp_path, 10)
        process.send_signal(signal.SIGINT)
        wait_until(lambda: any((tmp_path / "runs").glob("*-c/summary.json")))
        time.sleep(1.0)
        assert process.poll() is None, "it waits for an operator to let the terminal continue"
        assert terminal.output == displayed, "the terminal is paused"
        process.send_signal(signal.SIGINT)
        requested = time.monotonic()
        ended_well(process, tmp_path)
        assert time.monotonic() - requested < 5.0


def test_closed_pipe_reader_does_not_affect_run(tmp_path: Path) -> None:
    with running(HIL, tmp_path, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith(b"recording into runs/")
        process.stdout.close()
        wait_for_tracking(tmp_path)
        process.send_signal(signal.SIGINT)
        ended_well(process, tmp_path)


def test_unread_pipe_blocks_neither_run_nor_end(tmp_path: Path) -> None:
    there, here = os.pipe()
    fcntl.fcntl(here, fcntl.F_SETPIPE_SZ, 4096)
    os.write(here, b"x" * 4096)  # full from the beginning
    try:
        with running(HIL, tmp_path, stdout=here, stderr=here) as process:
            wait_for_tracking(tmp_path)
            process.send_signal(signal.SIGTERM)
            ended_well(process, tmp_path)
    finally:
        os.close(there)
        os.close(here)
