"""Outputs of a run, and files that it never overwrites; in virtual time and in an empty folder."""

import errno
import io
import json
import os
import re
import subprocess
import sys
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO

import pytest

from hil_bridge.errors import ConfigError
from hil_bridge.record import Outcome, read
from hil_bridge.record import files as files_module
from hil_bridge.record import recorder as recorder_module
from hil_bridge.record.files import open_record, write_atomically
from hil_bridge.runs import outputs, session
from tests.command_line import Command, Result

pytestmark = pytest.mark.sweep

VIRTUAL = ("run", "--virtual", "--no-view", "--duration", "0.5")


def refused(result: Result) -> str:
    """Return the one-line refusal."""
    code, output, errors = result
    assert (code, output) == (2, ""), errors
    assert errors.startswith("hil-bridge: ")
    assert errors.count("\n") == 1
    return errors


def everything(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


# --- a folder for every run


def test_run_folder_has_time_and_configuration_name(hil: Command, tmp_path: Path) -> None:
    Path("site.toml").write_text("[task]\nforce_n = 8.0\n")
    code, output, errors = hil(*VIRTUAL, "site.toml")
    assert (code, errors) == (0, "")
    (folder,) = Path("runs").iterdir()
    assert re.fullmatch(r"\d{4}-\d\d-\d\d-\d{4}-\d\d-site", folder.name)
    assert sorted(path.name for path in folder.iterdir()) == ["run.mcap", "summary.json"]
    lines = output.splitlines()
    assert f"record: {folder}/run.mcap" in lines
    assert f"summary: {folder}/summary.json" in lines
    assert not read(folder / "run.mcap").truncated
    assert json.loads((folder / "summary.json").read_text())["force_reference_n"] == 8.0


def test_runs_in_same_second_have_separate_folders(hil: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outputs, "wall_time", lambda: datetime(2026, 11, 22, 14, 15, 3))
    for _ in range(3):
        assert hil(*VIRTUAL, "--duration", "0.1", "--report")[0] == 0
    names = [f"2026-11-22-1415-03-default{number}" for number in ("", "-2", "-3")]
    assert sorted(path.name for path in Path("runs").iterdir()) == names
    assert {len(list((Path("runs") / name).iterdir())) for name in names} == {3}


def test_long_run_without_recording_uses_temporary_file(
    hil: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[Path] = []

    def open_and_note(path: Path, overwrite: bool) -> BinaryIO:
        opened.append(path)
        return open_record(path, overwrite)

    monkeypatch.setattr(recorder_module, "open_record", open_and_note)
    figures = []
    for most in (session.KEPT_RECORDS, 100):
        monkeypatch.setattr(session, "KEPT_RECORDS", most)
        summary = f"{most}.json"
        assert hil(*VIRTUAL, "--no-record", "--summary", summary)[0] == 0
        figures.append(json.loads(Path(summary).read_text()))
    assert figures[0] == figures[1]
    (temporary,) = opened  # only the long run
    assert not temporary.exists()


def test_named_or_disabled_recording_makes_no_folder(hil: Command, tmp_path: Path) -> None:
    code, output, _ = hil(*VIRTUAL, "--no-record", "--summary", "s.json")
    assert code == 0
    assert "record:" not in output
    assert everything(tmp_path) == ["s.json"]
    assert hil(*VIRTUAL, "--record", "there/r.mcap", "--report")[0] == 0
    assert everything(tmp_path) == [
        "s.json",
        *("there", "there/r.mcap", "there/report.html"),
    ]
    assert "exclude each other" in refused(hil(*VIRTUAL, "--record", "x.mcap", "--no-record"))
    assert "give --report a folder" in refused(hil(*VIRTUAL, "--no-record", "--report"))


# --- nothing is overwritten


@pytest.mark.parametrize(
    ("options", "name"),
    [
        (("--record", "old"), "old"),
        (("--summary", "old"), "old"),
        (("--report", "."), "report.html"),
    ],
)
def test_existing_files_are_kept_by_default(
    hil: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: Sequence[str], name: str
) -> None:
    Path(name).write_bytes(b"an hour of work")
    with monkeypatch.context() as patched:
        patched.setattr("hil_bridge.runs.session.Session.main", lambda self: pytest.fail("it moved"))
        error = refused(hil(*VIRTUAL, *options))
    assert f"{name} already exists; name another file, or give --overwrite" in error
    assert everything(tmp_path) == [name], "no run folder either"
    assert Path(name).read_bytes() == b"an hour of work"
    assert hil(*VIRTUAL, *options, "--overwrite")[0] == 0
    assert Path(name).read_bytes() != b"an hour of work"


def test_other_commands_keep_existing_files(hil: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    assert hil(*VIRTUAL, "--duration", "3", "--record", "r.mcap", "--report", ".")[0] == 0
    kept = Path("kept")
    kept.write_text("mine")
    monkeypatch.setattr("hil_bridge.site.tool.measuring.measure", lambda *_: pytest.fail("it moved"))
    for command in (
        ("report", "r.mcap"),
        ("replay", "r.mcap", "--csv", "kept"),
        ("latency", "r.mcap", "-o", "kept"),
        ("config", "init", "kept"),
        ("identify", "tool", "--virtual", "-o", "kept"),
        ("identify", "tool", "--virtual", "--save", "kept"),
        ("probe", "robot", "s3+tcp://127.0.0.1:1", "-o", "kept"),
    ):
        assert "already exists; name another file, or give --overwrite" in refused(hil(*command)), command
    assert kept.read_text() == "mine"
    for command in (
        ("report", "r.mcap"),
        ("replay", "r.mcap", "--csv", "kept"),
        ("latency", "r.mcap", "-o", "kept"),
        ("config", "init", "kept"),
    ):
        kept.write_text("mine")
        assert hil(*command, "--overwrite")[0] == 0, command
        assert command[0] == "report" or kept.read_text() != "mine", command


def test_file_created_after_check_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "s.json"
    path.write_text("of another process")
    for check in ("check_place", "check_record_path"):
        monkeypatch.setattr(files_module, check, lambda path, overwrite: None)
    with pytest.raises(ConfigError, match="already exists"):
        write_atomically(path, b"mine")
    with pytest.raises(ConfigError, match="already exists"):
        open_record(path, overwrite=False)
    os.mkfifo(tmp_path / "pipe")
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    with pytest.raises(ConfigError, match="is a pipe or device, not a file"):
        open_record(tmp_path / "pipe", overwrite=True)
    os.close(reader)
    assert everything(tmp_path) == ["pipe", "s.json"]
    assert path.read_text() == "of another process"


def test_file_is_created_without_hard_links(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_links(*_: object) -> None:
        raise PermissionError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(os, "link", no_links)
    write_atomically(tmp_path / "s.json", b"mine")
    monkeypatch.setattr(files_module, "check_place", lambda path, overwrite: None)
    with pytest.raises(ConfigError, match="already exists"):
        write_atomically(tmp_path / "s.json", b"yours")
    assert everything(tmp_path) == ["s.json"]
    assert (tmp_path / "s.json").read_bytes() == b"mine"


def test_recording_in_use_is_not_truncated(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with open_record(path, overwrite=False) as file:
        file.write(b"so far")
        file.flush()
        with pytest.raises(ConfigError, match="another run writes it"):
            open_record(path, overwrite=True)
        assert path.read_bytes() == b"so far"
    with open_record(path, overwrite=True):
        assert path.read_bytes() == b""


# --- recordings that cannot be written


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ("pipe", "is a pipe or device, not a file"),
        ("/dev/null", "is a pipe or device, not a file"),
        ("link", "is a pipe or device, not a file"),
        (".", "it is a folder; name a file in it"),
    ],
)
def test_recording_to_non_file_is_refused(hil: Command, target: str, message: str) -> None:
    os.mkfifo("pipe")
    Path("link").symlink_to("/dev/null")
    for options in ((), ("--overwrite",)):
        assert message in refused(hil(*VIRTUAL, "--record", target, *options))


def test_folder_without_permission_is_refused(hil: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path).name != "closed")
    assert "cannot write into closed: no permission" in refused(hil(*VIRTUAL, "--record", "closed/r.mcap"))


@pytest.mark.parametrize("options", [(), ("--record", "r.mcap"), ("--no-record",)])
def test_nearly_full_disk_is_refused(
    hil: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: Sequence[str]
) -> None:
    monkeypatch.setattr(outputs.shutil, "disk_usage", lambda folder: SimpleNamespace(free=49_000_000))
    assert "49 MB are free, but at least 50 MB are needed" in refused(hil(*VIRTUAL, *options))
    assert everything(tmp_path) in ([], ["runs"])


class FullDisk(io.BytesIO):
    """File on a disk with room for this many bytes."""

    def __init__(self, path: Path, room: int) -> None:
        super().__init__()
        self._file, self._room = path.open("wb"), room

    def write(self, data: Any) -> int:
        self._room -= len(data)
        if self._room < 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        self._file.write(data)
        self._file.flush()
        return len(data)

    def tell(self) -> int:
        return self._file.tell()

    def close(self) -> None:
        self._file.close()
        super().close()


def fill(monkeypatch: pytest.MonkeyPatch, room: int) -> None:
    def opened(path: Path, overwrite: bool) -> BinaryIO:
        return FullDisk(path, room)

    monkeypatch.setattr(recorder_module, "open_record", opened)


def test_full_disk_is_reported_at_once_and_at_end(hil: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    reported: list[tuple[str, int]] = []

    def tell(self: Any, recorder: Any, log: Any, view: Any) -> None:
        if recorder.trouble and not reported:
            reported.append((recorder.trouble, self.notes.cycles))

    monkeypatch.setattr("hil_bridge.runs.session.Session._check_recorder", tell)
    fill(monkeypatch, 120_000)
    code, output, errors = hil("run", "--virtual", "--no-view", "--duration", "30", "--summary", "s.json")
    ((text, cycles),) = reported
    assert text == "is incomplete: No space left on device"
    assert 10 < cycles < 150, "long before the end of some 200 cycles"
    assert code == 3
    assert errors.endswith(f"run.mcap {text}\n")
    assert errors.startswith("hil-bridge: the recording ")
    assert output.startswith("completed\n")
    assert output.endswith("left: retracted, 0.0 N\n")
    summary = json.loads(Path("s.json").read_text())
    assert (summary["outcome"], summary["truncated"]) == (Outcome.COMPLETED, True)


def test_output_failure_is_reported_during_run(hil: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    fill(monkeypatch, 120_000)
    code, _, errors = hil("run", "--virtual", "--no-view", "--duration", "30")
    assert code == 3
    at_once, at_the_end = errors.splitlines()
    assert at_once == f"{at_the_end}; the run continues"


def test_full_disk_is_reported_before_movement(hil: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    fill(monkeypatch, 100)
    monkeypatch.setattr("hil_bridge.runs.compose.open_devices", lambda *_: pytest.fail("a device was opened"))
    code, output, errors = hil(*VIRTUAL)
    assert (code, output, errors.count("\n")) == (3, "", 1)
    assert "is incomplete: No space left on device" in errors


@pytest.mark.full
def test_file_size_limit_is_reported(tmp_path: Path) -> None:
    limited = (
        "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (120_000, 120_000)); "
        "from hil_bridge.cli import main; main()"
    )
    command = [sys.executable, "-c", limited, "run", "--virtual", "--no-view", "--duration", "30"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    at_once, at_the_end = done.stderr.splitlines()
    assert at_once == f"{at_the_end}; the run continues"
    assert at_the_end.endswith("run.mcap is incomplete: File too large")
    assert done.returncode == 3
    assert done.stdout.startswith("completed\n")
    (record,) = tmp_path.glob("runs/*/run.mcap")
    assert read(record).truncated
