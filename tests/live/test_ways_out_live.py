"""Every way out of a run in contact, over pseudo-terminals, with the cell in a process of its own.

The cell outlives the run: its panel tells where the tool was left, and so with what force.
"""

import json
import os
import pty
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pytest

from hil_bridge.devices.robots.s3.panel import ask
from hil_bridge.errors import ConfigError
from hil_bridge.record import read

pytestmark = pytest.mark.live

HIL = "from hil_bridge.cli import main; main()"
BUG = (
    "import hil_bridge.runs.cycle as run\n"
    "told = run.cycle_record\n"
    "def broken(report, sample, decision, course, task):\n"
    "    if course.cycle and decision.output.phase == 'track' and decision.output.command.stiffness:\n"
    "        raise ZeroDivisionError('lost count')\n"
    "    return told(report, sample, decision, course, task)\n"
    "run.cycle_record = broken\n"
)
"""A bug that strikes once the surface is tracked."""
AT_THE_KEYBOARD = "import fcntl, termios\nfcntl.ioctl(0, termios.TIOCSCTTY, 0)\n"
"""Standard input becomes the terminal that the process was started from."""
PATIENCE = 90.0
"""Longest wait for a whole process on a busy machine, s."""
SURFACE_MM, STIFFNESS_N_MM = 590.0, 5.0
CONFIG = """
[task]
retract_mm = 3.0
[limits]
cycle_deadline_ms = 5000.0
stale_after_ms = 1500.0
retract_patience_s = 2.0
[cell]
start_position_mm = [900.0, -100.0, 592.0]
"""
"""Near the surface, to save time, and patient with a busy machine."""


@dataclass
class End:
    """End of a run, and the state in which it left the tool."""

    code: int
    last: str
    said: str
    force: float
    """True force that is left, N."""
    outcome: str
    told: list[str]
    """Texts of the events that a person caused."""


def inject(target: str, fault: str, **parameters: object) -> Callable[["Cell", subprocess.Popen[str]], None]:
    def act(cell: "Cell", run: "subprocess.Popen[str]") -> None:
        ask(cell.panel, {"do": "inject", "target": target, "fault": fault, "with": parameters})

    return act


def send(number: signal.Signals) -> Callable[["Cell", subprocess.Popen[str]], None]:
    return lambda cell, run: run.send_signal(number)


def press(key: str) -> Callable[["Cell", subprocess.Popen[str]], None]:
    def act(cell: "Cell", run: "subprocess.Popen[str]") -> None:
        os.write(cell.keyboard, key.encode())

    return act


@dataclass(frozen=True)
class Way:
    """A way to end a run, and its promises."""

    act: Callable[["Cell", subprocess.Popen[str]], None]
    code: int
    last: str
    """Begin of the last line."""
    presses: bool = False
    """The tool is left on the surface."""
    cause: str = ""
    program: str = HIL
    view: str = "--no-view"


RETRACTED, NOT = "left: retracted, ", "left: NOT retracted: left at "
WAYS: dict[str, Way] = {
    "SIGINT": Way(send(signal.SIGINT), 130, RETRACTED),
    "SIGTERM": Way(send(signal.SIGTERM), 130, RETRACTED),
    "SIGHUP": Way(send(signal.SIGHUP), 130, RETRACTED),
    "SIGQUIT": Way(send(signal.SIGQUIT), 130, RETRACTED),
    "SIGUSR1": Way(send(signal.SIGUSR1), 130, RETRACTED),
    "SIGALRM": Way(send(signal.SIGALRM), 130, RETRACTED),
    "SIGABRT": Way(send(signal.SIGABRT), 130, RETRACTED),
    "refused move": Way(inject("robot", "refuse", function=24), 3, RETRACTED, cause="refused order 24: 31"),
    "emergency stop": Way(inject("robot", "emergency-stop"), 3, NOT, True, "emergency stop"),
    "dead link": Way(inject("link", "off", for_s=600.0), 3, NOT, True, "robot on serial://"),
    "late answer": Way(inject("robot", "late-answer", seconds=12.0), 3, RETRACTED, cause="no answer"),
    "silent sensor": Way(inject("frames", "off", for_s=600.0), 3, NOT, False, "force"),
    "bug": Way(
        lambda cell, run: None, 3, RETRACTED, False, "a bug ended the run: ZeroDivisionError", BUG + HIL
    ),
    "key r": Way(press("mr"), 130, RETRACTED, False, "", AT_THE_KEYBOARD + HIL, "--overwrite"),
    "kill -9": Way(send(signal.SIGKILL), -9, "", True),
}


class Cell:
    """An emulated cell in a process of its own."""

    keyboard: int
    """The other end of the terminal of the run."""

    def __init__(self, folder: Path) -> None:
        (folder / "c.toml").write_text(CONFIG)
        self.folder = folder
        self.process = subprocess.Popen(
            [
                sys.executable,
                "-c",
                HIL,
                "emulate",
                "cell",
                "c.toml",
                "--json",
                "--panel",
                "tcp-listen://127.0.0.1:0",
            ],
            cwd=folder,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        where = json.loads(self.process.stdout.readline())
        self.panel = where.pop("panel")
        self.options = [text for name, value in where.items() for text in (f"--{name}", value)]

    @property
    def force(self) -> float:
        """True force of the surface, N."""
        z = ask(self.panel, {"do": "show"})["state"]["true_position_mm"][2]
        return max(0.0, SURFACE_MM - float(z)) * STIFFNESS_N_MM

    def close(self) -> None:
        self.process.kill()
        self.process.communicate()


def leave(way: Way, folder: Path) -> End:
    """Run in contact, end it this way, and look at what is left."""
    cell = Cell(folder)
    master, slave = pty.openpty()
    cell.keyboard, typing = master, termios.tcgetattr(slave)
    record = folder / "run.mcap"
    command = [sys.executable, "-c", way.program, "run", "c.toml", *cell.options]
    run = subprocess.Popen(
        [*command, way.view, "--duration", "600", "--record", "run.mcap"],
        cwd=folder,
        stdin=slave,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    try:
        wait_until(lambda: run.poll() is not None or presses(record))
        way.act(cell, run)
        output, _ = run.communicate(timeout=PATIENCE)
        time.sleep(0.5)  # until the arm stands still
        assert way.code == -9 or termios.tcgetattr(slave) == typing
        kept = None if way.code == -9 else read(record)
        outcome = "" if kept is None else str(kept.end.get("outcome"))
        events = [] if kept is None else kept.events
        told = [event.text for event in events if event.kind in ("mark", "operator")]
        lines = output.splitlines() or [""]
        return End(run.returncode, lines[-1], output, cell.force, outcome, told)
    finally:
        run.kill()
        run.communicate()
        cell.close()
        os.close(master)
        os.close(slave)


def presses(record: Path) -> bool:
    """Whether the recording, as far as it is written, holds a cycle that pressed with most of the force."""
    with suppress(ConfigError, ValueError):
        return any(cycle.phase == "track" and cycle.force > 8.0 for cycle in read(record).cycles)
    return False


def wait_until(happened: Callable[[], bool]) -> None:
    ends = time.monotonic() + PATIENCE
    while not happened():
        assert time.monotonic() < ends
        time.sleep(0.1)


@pytest.fixture(scope="module")
def ends(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, "Future[End]"]]:
    """All of them, some at a time: they mostly wait."""
    with ThreadPoolExecutor(3) as pool:
        yield {name: pool.submit(leave, way, tmp_path_factory.mktemp("way")) for name, way in WAYS.items()}


@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", WAYS)
def test_a_way_out_keeps_its_promises(ends: dict[str, "Future[End]"], name: str) -> None:
    way, end = WAYS[name], ends[name].result()
    assert end.code == way.code, end.said
    assert end.last.startswith(way.last), end.said
    assert way.cause in end.said, end.said
    assert "Traceback" not in end.said
    if way.presses:
        assert end.force > 3.0, end.said
    else:
        assert end.force == 0.0, end.said
    if way.code == 130:
        assert end.outcome == "interrupted"
    if name == "key r":
        assert end.told == ["mark 1", "asked for the end with the key r"]
    if way.code == 3:
        assert end.outcome == "stopped"


@pytest.mark.timeout(600)
def test_after_kill_9_the_next_run_is_refused_and_the_tool_freed(tmp_path: Path) -> None:
    """A person frees it then."""
    cell = Cell(tmp_path)

    def hil(*arguments: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            [sys.executable, "-c", HIL, *arguments],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            check=False,
        )

    try:
        run = subprocess.Popen(
            [sys.executable, "-c", HIL, "run", "c.toml", *cell.options, "--no-view", "--record", "run.mcap"],
            cwd=tmp_path,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        wait_until(lambda: presses(tmp_path / "run.mcap"))
        run.kill()
        run.wait()
        time.sleep(1.0)
        left = cell.force
        again = hil("run", "c.toml", *cell.options, "--no-view", "--no-record")
        assert (again.returncode, cell.force) == (3, pytest.approx(left, abs=0.7))
        assert "the tool touches something" in again.stderr
        freed = hil("free", "c.toml", *cell.options, "--distance-mm", "4")
        assert (freed.returncode, freed.stderr) == (0, "")
        last = freed.stdout.splitlines()[-1]
        assert last.startswith("freed by 4.0 mm: contact force ")
        assert last.endswith(" N before, 0.0 N after")
        assert cell.force == 0.0
    finally:
        cell.close()
