"""Processes of hil-bridge for tests in real time: start, wait and end."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hil_bridge.errors import ConfigError
from hil_bridge.record import Recording, read

HIL = (sys.executable, "-c", "from hil_bridge.cli import main; main()")
PATIENCE_S = 60.0
"""Maximum wait for a complete process on a busy machine, s."""
POLL_S = 0.05
NEAR = """
[task]
retract_mm = 3.0
[cell]
start_position_mm = [900.0, -100.0, 592.0]
jr3.gateway.boot_s = 0.2
netft.boot_s = 0.2
"""
"""Configuration that starts near the surface, with sensors that answer soon, and retracts little, to save time."""
PATIENT = "[limits]\npath_error_mm = 3.0\n"
"""Larger limit of the follow error, because a busy machine sends set points late. The default limit, 0.3 mm, is tested
in virtual time.
"""


def start(*arguments: str) -> "subprocess.Popen[str]":
    """Start a command of hil-bridge."""
    return subprocess.Popen(
        [*HIL, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, bufsize=1
    )


def finish(process: "subprocess.Popen[str]") -> tuple[int, list[str], str]:
    """Return exit code, output lines, and errors of a process that ends by itself."""
    output, errors = process.communicate(timeout=PATIENCE_S)
    return process.returncode, output.splitlines(), errors


def emulator_urls(process: "subprocess.Popen[str]") -> dict[str, str]:
    """Return the first line of an emulator with `--json`: its URLs by device."""
    assert process.stdout is not None
    reported: dict[str, str] = json.loads(process.stdout.readline())
    return reported


def without_notices(errors: str) -> str:
    """Return the errors of an emulator without notices about a late process, a missing client, or a stopped robot."""
    notices = (
        "this process was late",
        "cannot be reached: no program listens there",
        "has left; it had sent datagrams before",
        "waiting for its client",
        "robot: ",
    )
    lines = errors.splitlines(keepends=True)
    return "".join(line for line in lines if not any(notice in line for notice in notices))


@contextmanager
def emulated(
    *arguments: str, stop: signal.Signals = signal.SIGTERM
) -> Iterator[tuple["subprocess.Popen[str]", list[str]]]:
    """Yield an emulator process and the options that connect a run to it; it must end cleanly when asked."""
    process = start("emulate", *arguments, "--json")
    try:
        where = emulator_urls(process)
        yield process, [text for device, url in where.items() for text in (f"--{device}", url)]
        if process.poll() is None:
            process.send_signal(stop)
            output, errors = process.communicate(timeout=PATIENCE_S)
            assert (output, without_notices(errors)) == ("", "")
            assert process.returncode == 0
    finally:
        process.kill()
        process.communicate()


def wait_until(happened: Callable[[], bool], process: "subprocess.Popen[Any] | None" = None) -> None:
    """Wait for a condition, as long as the process that should cause it runs."""
    ends = time.monotonic() + PATIENCE_S
    while not happened():
        assert time.monotonic() < ends
        assert process is None or process.poll() is None
        time.sleep(POLL_S)


class Growing:
    """Recording that a process is writing. It is read again only when it has grown, to save processor time."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._size = 0

    def news(self) -> Recording | None:
        """Return the recording so far; None if nothing was added since the last read."""
        try:
            size = self.path.stat().st_size
            if size == self._size:
                return None
            self._size = size
            return read(self.path)
        except (ConfigError, FileNotFoundError, ValueError):  # not there yet, or no whole cycle in it
            return None

    def tracks(self) -> bool:
        """Return whether the surface has been touched and is tracked."""
        recording = self.news()
        return recording is not None and any(
            cycle.phase == "track" and cycle.in_contact for cycle in recording.cycles
        )

    def presses(self, force_n: float = 8.0) -> bool:
        """Return whether the contact force exceeds this many newtons."""
        recording = self.news()
        return recording is not None and any(
            cycle.phase == "track" and cycle.force > force_n for cycle in recording.cycles
        )
