"""Replay of a recorded run: exactly the same commands, or the first difference."""

import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from msgspec import structs

import hil_bridge.cli
from hil_bridge import simulate
from hil_bridge.errors import ConfigError
from hil_bridge.record import CycleRecord, Outcome, Recorder, Recording, Writing, read
from hil_bridge.runs.replay import changes_of, recorded_config, replay
from hil_bridge.settings.configuration import read_config
from tests.near_surface import CLOSE, merged
from tests.recordings import Recordings


@pytest.fixture
def recording(recordings: Recordings) -> Path:
    """Run of more than 50 cycles."""
    adaptive = {"controller": {"name": "fuzzy-adaptive"}, "frame": {"follow_normal": True}}
    return recordings.path(merged(CLOSE, {**adaptive, "run": {"duration_s": 8.5}}))


def differences(recording: Recording, forced: bool = False, **changes: object) -> list[int]:
    config = recorded_config(recording, changes)
    return [cycle.record.cycle for cycle in replay(recording, config, forced) if cycle.differences]


def changed(recording: Recording, number: int, **sample: Any) -> Recording:
    """Return the recording with other inputs in one cycle."""
    cycles = list(recording.cycles)
    before = cycles[number].sample
    assert before is not None
    cycles[number] = structs.replace(cycles[number], sample=structs.replace(before, **sample))
    return replace(recording, cycles=tuple(cycles))


def test_replay_reproduces_every_command_exactly(recording: Path) -> None:
    record = read(recording)
    assert len(record.cycles) > 50
    assert {cycle.phase for cycle in record.cycles} == {"approach", "track", "retract"}
    assert differences(record) == []
    assert differences(record, forced=True) == []


def test_replay_changed_input_changes_later_commands(recording: Path) -> None:
    record = read(recording)
    number = next(c.cycle for c in record.cycles if c.phase == "track") + 10
    sample = record.cycles[number].sample
    assert sample is not None
    assert differences(changed(record, number, force=sample.force + 1.0))[0] == number


def test_replay_reproduces_stop(bench: Callable[..., Any], recording: Path) -> None:
    run = bench(
        run={"duration_s": 5.0},
        task={"expected_stiffness_n_m": 500.0, "approach_speed_mm_s": 11.0},
        cell={"surface": {"stiffness_n_m": 5e4}},
    )
    assert run.result is not None
    assert run.result.outcome is Outcome.STOPPED
    cycles: tuple[CycleRecord, ...] = tuple(run.cycles)
    assert "stop" in {cycle.verdict for cycle in cycles}
    assert [c for c in replay(Recording(cycles), run.config, forced=False) if c.differences] == []


def test_replay_other_controller_gets_recorded_inputs(recording: Path) -> None:
    record = read(recording)
    config = recorded_config(record, changes_of(None, "pi"))
    assert config.controller.parameters == {}
    cycles = list(replay(record, config, forced=True))
    assert {c.record.phase for c in cycles if c.differences} >= {"track"}
    # a step from where the tool really was, not from where this controller would have led it
    assert max(abs(c.decision.target.depth - c.record.depth_commanded) for c in cycles) < 5e-3


def test_replay_with_tighter_limits_shows_stop(recording: Path, tmp_path: Path) -> None:
    record = read(recording)
    along = {c.cycle: max(c.sample.force, c.sample.peak_force) for c in record.cycles if c.sample is not None}
    highest = max(along.values())
    file = tmp_path / "limits.toml"
    file.write_text(f"[limits]\nforce_limit_n = {highest - 0.1!r}\n[task]\nforce_n = 9.0\n")
    config = recorded_config(record, changes_of(file, None))
    assert config.controller.name == "fuzzy-adaptive"
    stops = [c.record.cycle for c in replay(record, config, forced=True) if c.decision.verdict.kind == "stop"]
    assert stops
    assert stops[0] == next(cycle for cycle, force in along.items() if force > highest - 0.1)


def test_replay_ends_at_missing_cycle(recording: Path) -> None:
    record = read(recording)
    gap = replace(record, cycles=record.cycles[:5] + record.cycles[6:])
    with pytest.raises(ConfigError, match="inputs of cycle 5 are not in the recording"):
        differences(gap)


@pytest.mark.parametrize("config", ["", "{}}", '{"run": {"speed": 3}}'])
def test_replay_refuses_other_version_in_one_line(recording: Path, config: str) -> None:
    record = replace(read(recording), metadata={"config": config})
    with pytest.raises(ConfigError) as refused:
        recorded_config(record, {})
    assert "recording" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_replay_uses_defaults_for_missing_settings(recording: Path) -> None:
    record = replace(read(recording), metadata={"config": "{}"})
    assert recorded_config(record, changes_of(None, "pi")).controller.name == "pi"
    assert recorded_config(record, {}) == read_config({})


OWN_LAW = """
from dataclasses import dataclass
from typing import ClassVar

from hil_bridge.control import Command

@dataclass(frozen=True)
class Own:
    name: ClassVar[str] = "own-law"
    sample_ms: ClassVar[float] = 180.0

    def initial(self):
        return None

    def step(self, state, measurement, reference):
        return None, Command(measurement.commanded + 1e-5, 1e-5)
"""


def test_replay_names_missing_controller_package(tmp_path: Path) -> None:
    package = tmp_path / "own_control-1.2.dist-info"
    package.mkdir()
    (tmp_path / "own_law.py").write_text(OWN_LAW)
    (package / "METADATA").write_text("Metadata-Version: 2.1\nName: own-control\nVersion: 1.2\n")
    (package / "entry_points.txt").write_text("[hil_bridge.controllers]\nown-law = own_law:Own\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(tmp_path))
        result = simulate({"run": {"duration_s": 0.2}}, controller="own-law")
    record = read(result.save(tmp_path / "run.mcap"))
    with pytest.raises(ConfigError) as refused:
        recorded_config(record, {})
    assert str(refused.value) == (
        "the recording was made with the controller 'own-law', which is not installed here: install own-control 1.2, "
        "or choose another by `hil-bridge replay --controller NAME`"
    )
    assert recorded_config(record, changes_of(None, "pi")).controller.name == "pi"
    unknown = replace(record, metadata={"config": record.metadata["config"]})
    with pytest.raises(ConfigError, match="install the package that provides it, or choose another"):
        recorded_config(unknown, {})


@pytest.mark.parametrize("controller", [None, "pi"])
def test_replay_refuses_change_that_is_not_a_table(
    recording: Path, tmp_path: Path, controller: str | None
) -> None:
    file = tmp_path / "changes.toml"
    file.write_text("controller = 3\n")
    with pytest.raises(ConfigError, match=r"controller must be a table of settings, got 3"):
        recorded_config(read(recording), changes_of(file, controller))


def command(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["hil-bridge", "replay", *arguments])
    with pytest.raises(SystemExit) as ended:
        hil_bridge.cli.main()
    return int(ended.value.code or 0)


def changed_file(recording: Path, folder: Path) -> Path:
    """Recording with another force in its cycle 30."""
    record, path = read(recording), folder / "broken.mcap"
    sample = record.cycles[30].sample
    assert sample is not None
    recorder = Recorder(path, lambda at: round(at * 1e9), record.metadata, Writing(threaded=False))
    for cycle in changed(record, 30, force=sample.force + 2.0).cycles:
        recorder.put(cycle)
    recorder.close()
    return path


def test_replay_command_reports_difference_with_code_1(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    record = read(recording)
    assert command(monkeypatch, str(recording)) == 0
    assert f"{len(record.cycles)} cycles replayed, every command identical" in capsys.readouterr().out
    assert command(monkeypatch, str(changed_file(recording, tmp_path))) == 1
    message = capsys.readouterr().out
    assert "cycle 30 of" in message
    assert "depth_commanded: recorded" in message


@pytest.mark.full
@pytest.mark.parametrize(("arguments", "code"), [((), 0), (("--controller", "fuzzy"), 0), (("differs",), 1)])
def test_replay_closed_pipe_keeps_exit_code(
    recording: Path, tmp_path: Path, arguments: tuple[str, ...], code: int
) -> None:
    """As `| head -1`: 1 means that a command differs, and nothing else."""
    path = recording
    if arguments == ("differs",):
        arguments, path = (), changed_file(recording, tmp_path)
    reading, writing = os.pipe()
    os.close(reading)
    program = [sys.executable, "-m", "hil_bridge", "replay", str(path), *arguments]
    done = subprocess.run(program, stdout=writing, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writing)
    assert (done.returncode, done.stderr) == (code, "")


def test_replay_command_reports_stop_by_other_limits(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    limits = tmp_path / "limits.toml"
    limits.write_text("[limits]\nforce_limit_n = 5.0\n[task]\nforce_n = 4.0\n")
    assert command(monkeypatch, str(recording), str(limits)) == 0
    message = capsys.readouterr().out
    assert re.search(
        r"the supervisor would have stopped the run in \d+ more; first in \d+: contact force .* beyond 5 N",
        message,
    )


def test_replay_command_shows_other_controller(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "replay.csv"
    assert command(monkeypatch, str(recording), "--controller", "fuzzy", "--csv", str(table)) == 0
    message = capsys.readouterr().out
    assert "first difference: cycle" in message
    assert len(table.read_text().splitlines()) == len(read(recording).cycles) + 1
