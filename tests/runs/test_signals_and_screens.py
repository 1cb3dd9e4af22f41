"""End of a process: signals, blocked outputs, closed pipes, and bugs."""

import logging
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from hil_bridge.console.screen import Screen, Terminal
from hil_bridge.control import ControlLoop
from hil_bridge.record import CycleRecord, EventKind, read
from hil_bridge.runs import outputs, session
from hil_bridge.runs.notes import Notes
from hil_bridge.runs.retreat import FallbackRetraction
from hil_bridge.runs.signals import ENDING, Signals, as_ctrl_c
from tests.command_line import Command

pytestmark = pytest.mark.full

VIRTUAL = ("run", "--virtual", "--no-view", "--duration", "2", "--record", "r.mcap")


# --- signals


def signalled(monkeypatch: pytest.MonkeyPatch, *numbers: signal.Signals) -> None:
    """Let these come from the middle of a run on, one with each cycle."""
    reported, coming = Notes._cycle, list(numbers)

    def cycle(self: Notes, record: CycleRecord) -> None:
        reported(self, record)
        if record.phase in {"track", "retract"} and coming:
            signal.raise_signal(coming.pop(0))

    monkeypatch.setattr(Notes, "_cycle", cycle)


@pytest.mark.parametrize(
    "number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP]
)
def test_signal_retracts_and_is_named(
    hil: Command, monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    signalled(monkeypatch, number, number)
    before = {kind: signal.getsignal(kind) for kind in (*ENDING, signal.SIGTTOU)}
    code, output, errors = hil(*VIRTUAL)
    assert (code, errors) == (130, "")
    lines = output.splitlines()
    assert lines[0] == "interrupted"
    assert lines[-1].startswith("left: retracted, 0.0 N")
    recording = read(Path("r.mcap"))
    assert (recording.cycles[-1].phase, recording.end["outcome"]) == ("retract", "interrupted")
    assert [event.text for event in recording.events if event.kind == EventKind.SIGNAL] == [number.name] * 2
    assert {kind: signal.getsignal(kind) for kind in before} == before


def test_ignored_sighup_stays_ignored(hil: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    signalled(monkeypatch, signal.SIGHUP)
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        code, output, _ = hil(*VIRTUAL)
    finally:
        signal.signal(signal.SIGHUP, before)
    assert (code, output.splitlines()[0]) == (0, "completed")


def resting(monkeypatch: pytest.MonkeyPatch, *numbers: signal.Signals) -> None:
    """Send these signals when the movement has ended and the tool stops."""
    rest = FallbackRetraction.rest

    async def signalled_rest(*arguments: object) -> object:
        for number in numbers:
            signal.raise_signal(number)
        return await rest(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(FallbackRetraction, "rest", signalled_rest)


def test_signal_after_movement_keeps_report(hil: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    resting(monkeypatch, signal.SIGINT)
    code, output, errors = hil(*VIRTUAL, "--summary", "s.json")
    lines = output.splitlines()
    assert (code, errors, lines[0], lines[-1]) == (0, "", "completed", "left: retracted, 0.0 N")
    assert Path("s.json").exists()


def test_second_signal_ends_run_with_complete_recording(
    hil: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    signalled(monkeypatch, signal.SIGINT)
    resting(monkeypatch, signal.SIGINT)
    code, output, errors = hil(*VIRTUAL, "--summary", "s.json")
    assert (code, errors) == (130, "")
    lines = output.splitlines()
    assert lines[:2] == ["interrupted", "record: r.mcap"]
    assert lines[2].startswith("left: retracted, 0.0 N")
    assert not read(Path("r.mcap")).truncated
    assert not Path("s.json").exists()


def test_double_sighup_still_writes_files(hil: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    signalled(monkeypatch, signal.SIGHUP)
    resting(monkeypatch, signal.SIGHUP)
    write = outputs.write_outputs

    def write_after_hangup(*arguments: object) -> object:
        signal.raise_signal(signal.SIGHUP)
        return write(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(session, "write_outputs", write_after_hangup)
    code, output, errors = hil(*VIRTUAL, "--summary", "s.json")
    assert (code, errors) == (130, "")
    assert "summary: s.json" in output.splitlines()
    assert Path("s.json").exists()


def test_ctrl_c_while_writing_report_ends_at_once(hil: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    def drawing(*_: object) -> None:
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr("hil_bridge.show.report.page.page", drawing)
    code, output, errors = hil(*VIRTUAL, "--report", "rep")
    assert (code, errors) == (130, "")
    assert output.splitlines() == [
        *("completed", "record: r.mcap", "interrupted before all requested outputs were written"),
        "left: retracted, 0.0 N",
    ]
    assert not any(Path("rep").iterdir())


def test_every_signal_acts_like_ctrl_c_for_tasks() -> None:
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP, signal.SIGUSR1)
    before = {number: signal.getsignal(number) for number in ENDING}
    for number in numbers:
        with pytest.raises(KeyboardInterrupt), as_ctrl_c():
            signal.raise_signal(number)
    with as_ctrl_c():
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGHUP)
        signal.raise_signal(signal.SIGHUP)
    assert {number: signal.getsignal(number) for number in ENDING} == before


def test_signals_outside_main_thread_set_no_handler() -> None:
    before = signal.getsignal(signal.SIGTERM)
    inside: list[object] = []

    def elsewhere() -> None:
        with Signals().installed():
            inside.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert inside == [before]


# --- outputs that take nothing


def test_full_pipe_blocks_only_the_screen() -> None:
    there, here = os.pipe()
    os.set_blocking(here, False)
    filled = os.write(here, b"x" * (1 << 20))
    os.set_blocking(here, True)
    with open(here, "w") as stream:
        screen = Screen(stream)
        for number in range(3):
            screen.say(f"line {number}")
        assert not screen.wait(0.05)
        assert screen.busy
        read_back = b""
        while len(read_back) < filled + len("line 0\n") * 3:
            read_back += os.read(there, 1 << 20)
        assert screen.wait(10.0)
        assert not screen.busy
        screen.close()
    os.close(there)
    assert read_back[filled:] == b"line 0\nline 1\nline 2\n"


def test_screen_with_closed_pipe_accepts_output() -> None:
    there, here = os.pipe()
    os.close(there)
    stream = open(here, "w")  # noqa: SIM115 - closing it fails, as it should
    with Screen(stream) as screen:
        screen.say("to no reader")
        screen.say("and again")
        assert screen.wait(10.0)
    with pytest.raises(BrokenPipeError):
        stream.close()
    nothing = Screen(None)
    nothing.say("to no stream")
    assert nothing.wait(10.0)
    nothing.close()


def test_library_logging_does_not_block_on_terminal(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    log = logging.getLogger("asyncio")
    with Terminal() as terminal:
        released = threading.Event()
        terminal.err.do(released.wait)
        log.error("a callback failed")
        assert terminal.err.busy
        assert capfd.readouterr().err == ""
        released.set()
        assert terminal.err.wait(10.0)
    assert capfd.readouterr().err == "a callback failed\n"
    assert not any(type(handler).__name__ == "_Logged" for handler in logging.getLogger().handlers)


def ended(*arguments: str, cwd: Path) -> tuple[int, bytes]:
    """Return exit code and standard error of a process whose reader of standard output left before it started."""
    there, here = os.pipe()
    os.close(there)
    try:
        done = subprocess.run(
            [sys.executable, "-m", "hil_bridge", *arguments],
            cwd=cwd,
            stdout=here,
            stderr=subprocess.PIPE,
            timeout=60,
        )
    finally:
        os.close(here)
    return done.returncode, done.stderr


def test_run_closed_pipe_keeps_exit_code(hil: Command, tmp_path: Path) -> None:
    assert hil(*VIRTUAL, "--duration", "0.5")[0] == 0
    Path("c.toml").write_text("[task]\napproach_depth_limit_mm = 1.0\n")
    Path("site.toml").write_text('[robot]\nurl = "s3+serial:///dev/there-is-none"\n')
    Path("limits.toml").write_text("[limits]\nforce_limit_n = 20.0\n")
    for expected, command in (
        (0, ("--help",)),
        (0, ("replay", "r.mcap")),
        (0, ("replay", "r.mcap", "limits.toml")),
        (0, ("list", "facts", "--all")),
        (2, ("decode", "computer-link", "55")),
        (3, ("doctor", "site.toml")),
        (0, ("run", "--virtual", "--duration", "0.5")),
    ):
        assert ended(*command, cwd=tmp_path) == (expected, b""), command
    code, errors = ended("run", "c.toml", "--virtual", "--summary", "s.json", cwd=tmp_path)
    assert code == 3
    assert errors.startswith(b"hil-bridge: stopped: no contact found within 1 mm: ")
    assert Path("s.json").exists()


def test_differing_replay_with_closed_pipe_keeps_code(tmp_path: Path) -> None:
    """The code of a difference comes from the difference, whether its lines are read or not."""
    program = (
        "import sys; from types import SimpleNamespace as made; import hil_bridge.record, hil_bridge.runs.replay\n"
        "cycle = made(record=made(cycle=3), differences={'depth': (1, 2)})\n"
        "hil_bridge.record.read = lambda path: made(truncated=False, metadata={})\n"
        "hil_bridge.runs.replay.recorded_config = lambda record, changes: None\n"
        "hil_bridge.runs.replay.replay = lambda record, config, forced: [cycle]\n"
        "sys.argv = ['hil-bridge', 'replay', 'r.mcap']\n"
        "from hil_bridge.cli import main; main()"
    )
    there, here = os.pipe()
    os.close(there)
    try:
        command = [sys.executable, "-c", program]
        done = subprocess.run(command, stdout=here, stderr=subprocess.PIPE, timeout=60, cwd=tmp_path)
    finally:
        os.close(here)
    assert (done.returncode, done.stderr) == (1, b"")


# --- bugs


def broken(*_: object) -> None:
    raise TypeError("a leg is\nmissing")


def test_bug_outside_movement_is_one_line(hil: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hil_bridge.runs.compose.open_devices", broken)
    code, output, errors = hil(*VIRTUAL)
    assert (code, output) == (70, "")
    assert errors == (
        "hil-bridge: this is a bug: TypeError: a leg is missing; record: r.mcap; repeat it with --debug for the "
        "traceback\n"
    )
    for arguments in (("--debug", *VIRTUAL), (*VIRTUAL, "--debug")):
        code, _, errors = hil(*arguments, "--overwrite")
        assert code == 70
        assert errors.startswith("Traceback (most recent call last):\n")
        assert "in broken" in errors
        assert errors.endswith("hil-bridge: this is a bug: TypeError: a leg is missing; record: r.mcap\n")


def test_bug_in_movement_retracts_and_is_reported(hil: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    propose, left = ControlLoop.propose, [40, 40]

    def once(*arguments: object) -> object:
        left[0] -= 1
        if left[0] == 0:
            left.pop(0)
            broken()
        return propose(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(ControlLoop, "propose", once)
    code, output, errors = hil(*VIRTUAL)
    assert code == 3
    assert output.splitlines()[-1].startswith("left: ")
    bug, stopped = errors.splitlines()
    assert bug.startswith("hil-bridge: this is a bug: ")
    assert bug.endswith("record: r.mcap; repeat it with --debug for the traceback")
    assert stopped.startswith("hil-bridge: stopped: a bug ended the run: TypeError")
    assert "Traceback" in hil(*VIRTUAL, "--debug", "--overwrite")[2]
    assert [event.kind for event in read(Path("r.mcap")).events if "in broken" in event.text] == ["bug"]
