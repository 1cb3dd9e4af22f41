"""Runs with a robot over EGM, in virtual time."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from hil_bridge.errors import ConfigError, DeviceError
from hil_bridge.record import Recording, read
from hil_bridge.record.device_facts import devices_of
from hil_bridge.runs.outputs import Outputs
from hil_bridge.runs.replay import recorded_config, replay
from hil_bridge.runs.session import execute
from hil_bridge.settings.configuration import load_config

pytestmark = pytest.mark.sweep

CONTOUR = {"cell.surface.kind": "sinusoidal", "frame.follow_normal": True, "run.duration_s": 4.0}


QUICKLY: dict[str, Any] = {
    "cell.start_position_mm": [900.0, -100.0, 591.0],
    "task.approach_speed_mm_s": 4.0,
    "task.retract_speed_mm_s": 20.0,
    "task.retract_mm": 3.0,
    "limits.retract_patience_s": 0.5,
    "cell.jr3.gateway.boot_s": 0.2,
    "run.duration_s": 1.2,
    "run.seed": "7",
    "run.period_ms": 20,
    "controller.sample_ms": 20,
    "robot.emulated": "egm",
}
"""Settings that shorten phases that are irrelevant here."""


def go(
    folder: Path, faults: str = "", egm: str = "", client: str = "", options: Mapping[str, Any] | None = None
) -> int:
    """Run in virtual time, write `run.mcap` and `run.json`, and return the exit code."""
    file = folder / "run.toml"
    file.write_text(f"[cell.egm]\n{egm}\n[robot.egm]\n{client}\n{faults}")
    config = load_config(file, {**QUICKLY, **(options or {})})
    outputs = Outputs(record=folder / "run.mcap", summary=folder / "run.json")
    return execute(config, virtual=True, outputs=outputs, view=False)


def run(folder: Path, *arguments: Any, **more: Any) -> tuple[int, Recording, Any]:
    """Run in virtual time and return exit code, recording and summary."""
    code = go(folder, *arguments, **more)
    return code, read(folder / "run.mcap"), json.loads((folder / "run.json").read_text())


@pytest.fixture(scope="module")
def usual(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Recording, Any]:
    folder = tmp_path_factory.mktemp("egm")
    code, record, summary = run(folder)
    assert code == 0
    return folder, record, summary


def test_egm_run_holds_ten_newtons(usual: tuple[Path, Recording, Any]) -> None:
    _, record, summary = usual
    assert summary["outcome"] == "completed"
    assert summary["left"] == "retracted, 0.0 N"
    assert summary["force_mean_steady_n"] == pytest.approx(10.0, abs=0.5)
    assert summary["figures"]["contact_losses"] == 0
    facts = devices_of(record).robot
    assert (facts.kind, facts.pacing, facts.cycle_s) == ("egm", "streamed", 0.004)
    assert facts.servo is not None


def test_egm_replay_is_identical(usual: tuple[Path, Recording, Any]) -> None:
    _, record, _ = usual
    cycles = list(replay(record, recorded_config(record, {}), False))
    assert len(cycles) > 50
    assert not any(cycle.differences for cycle in cycles)


def test_egm_runs_with_same_seed_are_identical(usual: tuple[Path, Recording, Any], tmp_path: Path) -> None:
    folder, _, _ = usual
    run(tmp_path)
    assert (tmp_path / "run.mcap").read_bytes() == (folder / "run.mcap").read_bytes()


@pytest.mark.full
def test_egm_run_follows_contour_without_losing_contact(tmp_path: Path) -> None:
    code, _, summary = run(tmp_path, options=CONTOUR)
    assert code == 0
    assert summary["force_mean_steady_n"] == pytest.approx(10.0, abs=0.5)
    assert summary["figures"]["contact_losses"] == 0


def test_egm_run_controls_force_at_rate_of_robot(tmp_path: Path) -> None:
    at_4_ms = {"run.period_ms": 4, "controller.sample_ms": 4}
    code, _, summary = run(tmp_path, options=at_4_ms)
    assert code == 0
    assert summary["cycle_time"]["mean_s"] == pytest.approx(0.004)
    assert summary["force_mean_steady_n"] == pytest.approx(10.0, abs=0.5)


def fault(on: str, name: str, more: str = "") -> str:
    return f'[[faults]]\non = "{on}"\nfault = "{name}"\nphase = "track"\nafter_s = 0.5\n{more}'


NOT_GUIDED = (
    "it is not guided (mciState STOPPED): EGMRunPose has not started or has ended; start the RAPID program"
)
ERROR = "EGM has ended with an error (mciState ERROR); read the controller's event log"
SESSION = "the controller started another EGM session"
REFUSALS: dict[str, tuple[str, str, str]] = {
    "motors off": (
        fault("robot", "motors-off"),
        "",
        "the motors are off; release a pressed emergency stop, switch the motors on",
    ),
    "program stopped": (
        fault("robot", "program-stopped"),
        "",
        "the RAPID program is stopped; start the program",
    ),
    "program restarted": (fault("robot", "program-restarted"), "", SESSION),
    "EGMStop": (fault("robot", "guidance-ended"), "", NOT_GUIDED),
    "a CondTime that ends the run": ("", "cond_time_s = 1.0", NOT_GUIDED),
    "out of limits": (fault("robot", "out-of-limits"), "", ERROR),
    "out of the workspace": ("", "workspace_min_mm = [0.0, -1000.0, 595.0]", ERROR),
    "time-out": (fault("wire", "deaf"), "comm_timeout_s = 0.3", ERROR),
    "nothing comes": (
        fault("wire", "mute"),
        "",
        "sent nothing for 0.5 s; check that its program still runs",
    ),
    "other numbers": (
        fault("wire", "wrong-seqno", "with = {count = 50}"),
        "",
        "its datagrams restarted their numbering",
    ),
    "no number": (
        fault("pose", "nan", "with = {count = 1}"),
        "",
        "reports the position (nan, nan, nan), which is invalid",
    ),
    "no pose": (
        fault("pose", "missing", "with = {count = 1}"),
        "",
        "it reports no pose; guide it by EGMActPose",
    ),
    "a pose that jumps": (fault("pose", "offset", "with = {z_mm = 5.0}"), "", "the reported position jumped"),
    "another cycle": (
        "",
        "sample_ms = 8.0",
        "it sends every 8.0 ms instead of every 4 ms; set robot.egm.sample_ms",
    ),
}


@pytest.mark.parametrize(("faults", "egm", "reason"), REFUSALS.values(), ids=REFUSALS)
def test_egm_refusal_ends_run_with_one_line(
    faults: str, egm: str, reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert go(tmp_path, faults, egm) == 3
    message = capsys.readouterr().err
    assert reason in message
    assert message.count("\n") == 1


@pytest.mark.parametrize(
    "faults",
    [
        fault("wire", "lost", "with = {probability = 0.05}"),
        fault("wire", "twice", "with = {probability = 0.05, way = \"from\"}"),
        fault("wire", "late", "with = {ms = 8.0}"),
        fault("wire", "corrupted", "for_s = 0.3"),
        fault("wire", "mute", "for_s = 0.2"),
        fault("wire", "malformed", "with = {count = 3}"),
        fault("witness", "missing"),
    ],
)  # fmt: skip
def test_egm_run_on_bad_network_retracts_tool(faults: str, tmp_path: Path) -> None:
    code, record, summary = run(tmp_path, faults)
    assert code == 0
    assert summary["left"] == "retracted, 0.0 N"
    assert any("struck" in event.text and "struck 0" not in event.text for event in record.events)


@pytest.mark.full
def test_egm_run_without_feed_forward_holds_force(tmp_path: Path) -> None:
    code, _, summary = run(tmp_path, client="feed_forward = false", options={"run.duration_s": 3.0})
    assert code == 0
    assert summary["force_mean_steady_n"] == pytest.approx(10.0, abs=0.5)


def test_egm_run_reads_joints_in_configured_unit(usual: tuple[Path, Recording, Any], tmp_path: Path) -> None:
    with pytest.raises(DeviceError, match="they match it in radians"):
        go(tmp_path, egm='joints_in = "radians"')
    (tmp_path / "run.mcap").unlink()
    (tmp_path / "run.json").unlink()
    code, record, _ = run(tmp_path, egm='joints_in = "radians"', client='joints_in = "radians"')
    assert code == 0
    pairs = zip(record.cycles, usual[1].cycles, strict=True)
    for one, other in pairs:
        assert (one.sample.position, one.sample.wrench) == (other.sample.position, other.sample.wrench)


def test_egm_joint_mode_is_refused_before_motion(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r'cell\.egm\.mode = "joint": a run sends poses'):
        run(tmp_path, egm='mode = "joint"')
