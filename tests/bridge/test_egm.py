"""Runs with a robot that is guided by EGM, in virtual time."""

import json
from pathlib import Path
from typing import Any

import pytest

from hil_bridge.recording import Recording, read
from hil_bridge.recording.device_facts import devices_of
from hil_bridge.runs.outputs import Outputs
from hil_bridge.runs.replay import recorded_config, replay
from hil_bridge.runs.session import execute
from hil_bridge.settings.configuration import load_config

CONTOUR = {"cell": {"surface": {"shape": "sine"}}, "frame": {"follow_normal": True}}


def run(
    place: Path, faults: str = "", egm: str = "", client: str = "", **options: Any
) -> tuple[int, Recording, Any]:
    """Exit code, recording and summary of a virtual run."""
    file = place / "run.toml"
    file.write_text(
        '[robot]\nemulated = "egm"\n[run]\nperiod_ms = 20\nduration_s = 2.0\nseed = "7"\n[controller]\nsample_ms = 20\n'
        f"[cell.egm]\n{egm}\n[robot.egm]\n{client}\n{faults}"
    )
    record, summary = place / "run.mcap", place / "run.json"
    for made in (record, summary):
        made.unlink(missing_ok=True)
    config = load_config(file, options)
    code = execute(config, virtual=True, outputs=Outputs(record=record, summary=summary), view=False)
    return code, read(record), json.loads(summary.read_text()) if summary.exists() else None


@pytest.fixture(scope="module")
def usual(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Recording, Any]:
    place = tmp_path_factory.mktemp("egm")
    code, record, summary = run(place)
    assert code == 0
    return place, record, summary


def test_the_loop_closes_to_ten_newtons(usual: tuple[Path, Recording, Any]) -> None:
    _, record, summary = usual
    assert summary["outcome"] == "completed"
    assert summary["left"] == "retracted, 0.0 N"
    assert summary["force_mean_steady_n"] == pytest.approx(10.0, abs=0.5)
    assert summary["figures"]["contact_losses"] == 0
    facts = devices_of(record).robot
    assert (facts.kind, facts.pacing, facts.cycle_s) == ("egm", "streamed", 0.004)
    assert facts.servo is not None


def test_a_run_is_decided_again_to_the_bit(usual: tuple[Path, Recording, Any]) -> None:
    _, record, _ = usual
    cycles = list(replay(record, recorded_config(record, {}), False))
    assert len(cycles) > 100
    assert not any(cycle.differences for cycle in cycles)


def test_two_runs_of_one_seed_are_the_same_bytes(usual: tuple[Path, Recording, Any], tmp_path: Path) -> None:
    place, _, _ = usual
    run(tmp_path)
    assert (tmp_path / "run.mcap").read_bytes() == (place / "run.mcap").read_bytes()
