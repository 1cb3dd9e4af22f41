"""Deciding a recorded run again: the same commands to the bit, or the first that differs."""

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
    """A run of more than 50 cycles."""
    adaptive = {"controller": {"name": "fuzzy-adaptive"}, "frame": {"follow_normal": True}}
    return recordings.path(merged(CLOSE, {**adaptive, "run": {"duration_s": 8.5}}))


def differences(recording: Recording, forced: bool = False, **changes: object) -> list[int]:
    config = recorded_config(recording, changes)
    return [cycle.record.cycle for cycle in replay(recording, config, forced) if cycle.differences]


def changed(recording: Recording, number: int, **sample: Any) -> Recording:
    """The recording with other inputs in one cycle."""
    cycles = list(recording.cycles)
    before = cycles[number].sample
    assert before is not None
    cycles[number] = structs.replace(cycles[number], sample=structs.replace(before, **sample))
    return replace(recording, cycles=tuple(cycles))


def test_every_command_of_a_run_is_decided_again_to_the_bit(recording: Path) -> None:
    record = read(recording)
    assert len(record.cycles) > 50
    assert {cycle.phase for cycle in record.cycles} == {"approach", "track", "retract"}
    assert differences(record) == []
    assert differences(record, forced=True) == []


def test_one_other_input_changes_the_commands_from_its_cycle_on(recording: Path) -> None:
    record = read(recording)
    number = next(c.cycle for c in record.cycles if c.phase == "track") + 10
    sample = record.cycles[number].sample
    assert sample is not None
    assert differences(changed(record, number, force=sample.force + 1.0))[0] == number


def test_a_run_that_was_stopped_is_replayed_with_its_stop(bench: Callable[..., Any], recording: Path) -> None:
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


def test_another_controller_is_asked_in_the_real_situations(recording: Path) -> None:
    record = read(recording)
    config = recorded_config(record, changes_of(None, "pi"))
    assert config.controller.parameters == {}
    cycles = list(replay(record, config, forced=True))
    assert {c.record.phase for c in cycles if c.differences} >= {"track"}
    # a step from where the tool really was, not from where this controller would have led it
    assert max(abs(c.decision.target.depth - c.record.depth_commanded) for c in cycles) < 5e-3


def test_tighter_limits_show_where_they_would_have_stopped_the_run(recording: Path, tmp_path: Path) -> None:
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


def test_a_cycle_missing_in_the_record_ends_the_replay(recording: Path) -> None:
    record = read(recording)
    gap = replace(record, cycles=record.cycles[:5] + record.cycles[6:])
    with pytest.raises(ConfigError, match="inputs of cycle 5 are not in the recording"):
        differences(gap)


@pytest.mark.parametrize("config", ["", "{}}", '{"run": {"speed": 3}}'])
def test_a_foreign_configuration_is_refused_in_one_line(recording: Path, config: str) -> None:
    record = replace(read(recording), metadata={"config": config})
    with pytest.raises(ConfigError) as refused:
        recorded_config(record, {})
    assert "recording" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_recording_that_names_no_setting_has_the_defaults(recording: Path) -> None:
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


def test_a_controller_that_is_not_installed_is_named_with_its_package(tmp_path: Path) -> None:
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
        "or ask another by `hil-bridge replay --controller NAME`"
    )
    assert recorded_config(record, changes_of(None, "pi")).controller.name == "pi"
    unknown = replace(record, metadata={"config": record.metadata["config"]})
    with pytest.raises(ConfigError, match="install the package that offers it, or ask another"):
        recorded_config(unknown, {})


@pytest.mark.parametrize("controller", [None, "pi"])
def test_a_change_that_is_no_table_is_refused_in_one_line(
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
    """The recording with another force in its cycle 30."""
    record, path = read(recording), folder / "broken.mcap"
    sample = record.cycles[30].sample
    assert sample is not None
    recorder = Recorder(path, lambda at: round(at * 1e9), record.metadata, Writing(threaded=False))
    for cycle in changed(record, 30, force=sample.force + 2.0).cycles:
        recorder.put(cycle)
    recorder.close()
    return path


def test_the_command_tells_the_first_difference_and_ends_with_1(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    record = read(recording)
    assert command(monkeypatch, str(recording)) == 0
    assert f"{len(record.cycles)} cycles replayed, every command identical" in capsys.readouterr().out
    assert command(monkeypatch, str(changed_file(recording, tmp_path))) == 1
    told = capsys.readouterr().out
    assert "cycle 30 of" in told
    assert "depth_commanded: recorded" in told


@pytest.mark.full
@pytest.mark.parametrize(("arguments", "code"), [((), 0), (("--controller", "fuzzy"), 0), (("differs",), 1)])
def test_a_reader_that_has_left_does_not_change_the_exit_code(
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


def test_the_command_says_that_other_limits_would_have_stopped(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    limits = tmp_path / "limits.toml"
    limits.write_text("[limits]\nforce_limit_n = 5.0\n[task]\nforce_n = 4.0\n")
    assert command(monkeypatch, str(recording), str(limits)) == 0
    told = capsys.readouterr().out
    assert re.search(
        r"the supervisor would have stopped the run in \d+ more; first in \d+: contact force .* beyond 5 N",
        told,
    )


def test_the_command_shows_what_another_controller_would_have_done(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "replay.csv"
    assert command(monkeypatch, str(recording), "--controller", "fuzzy", "--csv", str(table)) == 0
    told = capsys.readouterr().out
    assert "first difference: cycle" in told
    assert len(table.read_text().splitlines()) == len(read(recording).cycles) + 1
