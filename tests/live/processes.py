"""Processes of hil-bridge for tests in real time: how they are started, waited for, and ended."""

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
"""Longest wait for a whole process on a busy machine, s."""
POLL_S = 0.05
NEAR = """
[task]
retract_mm = 3.0
[cell]
start_position_mm = [900.0, -100.0, 592.0]
jr3.gateway.boot_s = 0.2
netft.boot_s = 0.2
"""
"""A configuration that begins near the surface, with sensors that answer soon, and retracts by little, to save time."""
PATIENT = "[limits]\npath_error_mm = 3.0\n"
"""A busy machine sends a set point late, and the guard sees that the robot does not follow: its limit is held in
virtual time. 0.3 mm is the usual one.
"""


def start(*arguments: str) -> "subprocess.Popen[str]":
    """A command of hil-bridge."""
    return subprocess.Popen(
        [*HIL, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, bufsize=1
    )


def finish(process: "subprocess.Popen[str]") -> tuple[int, list[str], str]:
    """Exit code, lines of the output, and errors of a process that ends by itself."""
    output, errors = process.communicate(timeout=PATIENCE_S)
    return process.returncode, output.splitlines(), errors


def told_first(process: "subprocess.Popen[str]") -> dict[str, str]:
    """The first line of an emulator with `--json`: its URLs by device."""
    assert process.stdout is not None
    told: dict[str, str] = json.loads(process.stdout.readline())
    return told


def without_notices(errors: str) -> str:
    """The errors of an emulator, without its lines on a late process, on a client that is not there or left, and on a
    robot that stopped.
    """
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
    """An emulator process, and the options that connect a run to it; it must end well when asked to."""
    process = start("emulate", *arguments, "--json")
    try:
        where = told_first(process)
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
    """Wait for it, as long as the process that is to bring it runs."""
    ends = time.monotonic() + PATIENCE_S
    while not happened():
        assert time.monotonic() < ends
        assert process is None or process.poll() is None
        time.sleep(POLL_S)


class Growing:
    """A recording that a process writes. It is read again only when it has grown, to leave the processor to the run."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._size = 0

    def news(self) -> Recording | None:
        """The recording as far as it is written; None where nothing has come since it was read."""
        try:
            size = self.path.stat().st_size
            if size == self._size:
                return None
            self._size = size
            return read(self.path)
        except (ConfigError, FileNotFoundError, ValueError):  # not there yet, or no whole cycle in it
            return None

    def tracks(self) -> bool:
        """Whether the surface has been touched and is followed."""
        recording = self.news()
        return recording is not None and any(
            cycle.phase == "track" and cycle.in_contact for cycle in recording.cycles
        )

    def presses(self, force_n: float = 8.0) -> bool:
        """Whether the surface is pressed with more than so many newtons."""
        recording = self.news()
        return recording is not None and any(
            cycle.phase == "track" and cycle.force > force_n for cycle in recording.cycles
        )
