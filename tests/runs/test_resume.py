"""An interrupted program continues where its force was last controlled, and moves there without contact."""

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from hil_bridge.cli import cli
from hil_bridge.errors import BridgeError, Cause
from hil_bridge.errors.cause_table import ROWS
from hil_bridge.record import Recording, read
from hil_bridge.runs import resuming
from hil_bridge.runs.replay import recorded_config, replay
from hil_bridge.settings.faults import FaultConfig

pytestmark = pytest.mark.sweep

STROKES = 4
LENGTH_MM, GAP_MM = 8.0, 4.0
"""Length of the strokes, and the gap between them, along x."""
OVERLAP_MM = 2.0
CYCLE_MM = 1.5
"""Distance of one cycle of the slowest robot here, with its lag, mm."""
PROGRAM = """
[run]
seed = 5
[cell]
start_position_mm = [900.0, -30.0, 591.5]
[task]
speed_mm_s = 5.5
retract_mm = 2.5
retract_speed_mm_s = 20.0
safe_height_mm = 1.0
""" + "".join(
    f"""
[[task.step]]
do = "move"
to_mm = [{number * (LENGTH_MM + GAP_MM)}, 0.0]
[[task.step]]
do = "approach"
[[task.step]]
do = "track"
path = {{ kind = "line", length_mm = {LENGTH_MM} }}
[[task.step]]
do = "retract"
"""
    for number in range(STROKES)
)
THIRD_TRACK = 11
"""Number of the third stroke's track among the steps."""
RETRACT = 4
"""Number of the first stroke's retract."""
OFTEN = '\n[run]\nperiod_ms = 20\nseed = 5\n[controller]\nsample_ms = 20\n[sensor]\nemulated = "ft300"\n'
"""Five cycles of a robot that streams are decided at once: here it is about places, not about its rate."""
STOPS = {"s3": "emergency-stop", "egm": "motors-off"}


def ran(*arguments: str | Path) -> tuple[int, str]:
    result = CliRunner().invoke(cli, ["run", *map(str, arguments), "--virtual", "--no-view", "--overwrite"])
    if isinstance(result.exception, BridgeError):
        return result.exception.exit_code, str(result.exception)
    return result.exit_code, result.output


def cut_by(robot: str, folder: Path, depth: str = "travel_mm > 27") -> tuple[Path, str]:
    """A run that is cut in the third stroke, and what it printed."""
    config, record = folder / "program.toml", folder / "cut.mcap"
    fault = f'\n[[faults]]\non = "robot"\nfault = "{STOPS[robot]}"\nphase = "track"\nwhen = "{depth}"\n'
    pace = PROGRAM.replace("\n[run]\nseed = 5\n", OFTEN) if robot == "egm" else PROGRAM
    config.write_text(pace + fault, encoding="utf-8")
    code, output = ran(config, "--robot", robot, "--record", record)
    assert code == 3, output
    return record, output


def covered(recording: Recording) -> set[int]:
    """Millimetres of the x axis over which the tool went while it pressed on its path."""
    result: set[int] = set()
    before = None
    for cycle in recording.cycles:
        at = cycle.travel_commanded * 1e3
        if cycle.phase == "track" and cycle.in_contact and before is not None:
            result |= set(range(math.floor(before + 1e-6), math.ceil(at - 1e-6)))
        before = at
    return result


@pytest.fixture(scope="module", params=sorted(STOPS))
def pair(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Recording, Recording, Any]:
    """A run that was cut, the one that resumed it, and what was printed."""
    folder = tmp_path_factory.mktemp(request.param)
    record, _ = cut_by(request.param, folder)
    code, output = ran("--resume", record, "--record", folder / "rest.mcap")
    assert code == 0, output
    return read(record), read(folder / "rest.mcap"), output


@pytest.mark.full
def test_interrupted_step_is_reported_with_cause(pair: tuple[Recording, Recording, Any]) -> None:
    cut, _, output = pair
    assert cut.steps[-1].step == THIRD_TRACK
    assert not cut.steps[-1].passed
    assert "resuming step 11 (track)" in output


@pytest.mark.full
def test_resumed_run_covers_path_with_overlap(pair: tuple[Recording, Recording, Any]) -> None:
    first, second = map(covered, pair[:2])
    for number in range(STROKES):
        start = number * (LENGTH_MM + GAP_MM)
        assert set(range(math.ceil(start), math.floor(start + LENGTH_MM))) <= first | second
    # data that robot and sensor had not yet reported add to the overlap
    assert len(first & second) <= OVERLAP_MM + 3 * CYCLE_MM + 1


def test_resumed_run_moves_without_contact(pair: tuple[Recording, Recording, Any]) -> None:
    recording = pair[1]
    free = {cycle.cycle for cycle in recording.cycles if cycle.phase in ("move", "zero")}
    assert free
    forces = [np.linalg.norm(truth.force) for truth in recording.truths if truth.cycle in free]
    assert max(forces) == 0.0


def test_resumed_run_replays_identically(pair: tuple[Recording, Recording, Any]) -> None:
    for recording in pair[:2]:
        assert not any(cycle.differences for cycle in replay(recording, recorded_config(recording, {}), True))


def test_resumed_run_can_be_resumed_again(tmp_path: Path) -> None:
    record, _ = cut_by("s3", tmp_path)
    middle = tmp_path / "middle.mcap"
    changed = resuming.resume_config(read(record), {"faults": ()})
    assert changed.task.resume is not None
    assert changed.task.resume.leg == THIRD_TRACK - 1
    # the second cut comes before the step has been reached: in the move over
    code, output = resumed_with_fault(record, middle)
    assert code == 3, output
    again = resuming.resume_config(read(middle), {})
    assert again.task.resume == changed.task.resume
    code, output = ran("--resume", middle, "--record", tmp_path / "end.mcap")
    assert code == 0, output


def test_run_cut_in_retract_resumes_with_next_step(tmp_path: Path) -> None:
    """The run itself has retracted the tool, or an operator has."""
    config, record = tmp_path / "program.toml", tmp_path / "cut.mcap"
    fault = '\n[[faults]]\non = "robot"\nfault = "motors-off"\nphase = "retract"\n'
    config.write_text(PROGRAM.replace("\n[run]\nseed = 5\n", OFTEN) + fault, encoding="utf-8")
    assert ran(config, "--robot", "egm", "--record", record)[0] == 3
    cut = read(record)
    assert cut.cycles[-1].step == RETRACT
    point = resuming.resume_config(cut, {}).task.resume
    assert point is not None
    assert (point.leg, point.way_mm) == (RETRACT, 0.0), "legs count from 0: it is the one after the retract"


def resumed_with_fault(record: Path, target: Path) -> tuple[int, str]:
    """Resume, and press the emergency stop during the move to the position."""
    original = resuming.resume_config

    def with_fault(*arguments: Any) -> Any:
        fault = FaultConfig(on="robot", fault="emergency-stop", phase="move", after_s=1.0)
        return original(*arguments).model_copy(update={"faults": (fault,)})

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(resuming, "resume_config", with_fault)
        return ran("--resume", record, "--record", target)


def test_completed_run_is_not_resumed(tmp_path: Path) -> None:
    config, record = tmp_path / "whole.toml", tmp_path / "whole.mcap"
    config.write_text(PROGRAM, encoding="utf-8")
    assert ran(config, "--record", record)[0] == 0
    code, output = ran("--resume", record, "--record", tmp_path / "x.mcap")
    assert code == 2
    assert "completed: there is nothing to resume" in output


def test_run_without_program_is_not_resumed(tmp_path: Path) -> None:
    record = tmp_path / "plain.mcap"
    assert ran("--duration", "1", "--record", record)[0] == 0
    code, output = ran("--resume", record, "--record", tmp_path / "x.mcap")
    assert code == 2
    assert "no program" in output


def test_resume_with_other_orientation_is_refused(tmp_path: Path) -> None:
    record, _ = cut_by("s3", tmp_path)
    original = resuming.resume_config

    def turned(*arguments: Any) -> Any:
        config = original(*arguments)
        cell = dataclasses.replace(config.cell, start_quaternion=(0.0, 0.99619, 0.08716, 0.0))
        return config.model_copy(update={"cell": cell})

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(resuming, "resume_config", turned)
        code, output = ran("--resume", record, "--record", tmp_path / "x.mcap")
    assert code == 2
    assert "turned by 10.0° from the start of the recorded run" in output
    assert ROWS[Cause.START_TURNED].exit_code == code


def test_resumed_recording_is_not_overwritten(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    record, _ = cut_by("s3", tmp_path)
    before = record.read_bytes()
    code, output = ran("--resume", record, "--record", record)
    assert code == 2
    assert "would overwrite the recording that is resumed" in output
    assert record.read_bytes() == before
    folder = tmp_path / "runs" / "2026-11-22-1415-03-polish"
    folder.mkdir(parents=True)
    kept = record.rename(folder / "run.mcap")
    assert ran("--resume", kept)[0] == 0
    (new,) = (path for path in (tmp_path / "runs").iterdir() if path != folder)
    assert new.name.endswith("-polish")
    assert new.name.count("-") == folder.name.count("-")
