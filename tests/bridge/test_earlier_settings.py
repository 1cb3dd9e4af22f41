"""Settings that counted cycles: each is answered with its new name, and recordings that hold them still open."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from hil_bridge.errors import ConfigError
from hil_bridge.record import read
from hil_bridge.runs.checks import check
from hil_bridge.runs.pace import control_loop
from hil_bridge.runs.replay import recorded_config, replay
from hil_bridge.settings.configuration import Config, load_config
from hil_bridge.settings.earlier import RECORDED_CYCLE_S, RENAMED, is_counted, translated

RECORDING = Path(__file__).parent / "recordings" / "version_0_1_0.mcap"


def refused(tmp_path: Path, text: str) -> str:
    """The line with which a configuration is refused."""
    file = tmp_path / "cell.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError) as error:
        check(load_config(file, {}), virtual=True)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize(
    ("old", "before", "now"),
    [
        ("task.step_mm", 1.0, "a speed: task.speed_mm_s = 5.556"),
        ("task.approach_step_mm", 0.5, "a speed: task.approach_speed_mm_s = 2.778"),
        ("task.retract_step_mm", 1.0, "a speed: task.retract_speed_mm_s = 5.556"),
        ("task.loss_samples", 5, "a time: task.loss_ms = 810"),
        ("limits.correction_per_cycle_mm", 2.0, "a speed: limits.correction_mm_s = 11.11"),
        ("limits.travel_per_cycle_mm", 5.0, "a speed: limits.travel_mm_s = 27.78"),
        ("limits.frozen_after_frames", 400, "a time: limits.frozen_after_ms = 3995"),
        ("limits.still_after_cycles", 3, "a time: limits.still_after_ms = 450"),
        ("oscillation.window_samples", 40, "a time: oscillation.window_ms = 7200"),
    ],
)
def test_an_old_key_is_answered_with_its_new_name_and_value(
    tmp_path: Path, old: str, before: float, now: str
) -> None:
    section, _, name = old.partition(".")
    assert f"{old} is now {now} is the same with a" in refused(tmp_path, f"[{section}]\n{name} = {before}\n")


def test_an_old_key_with_a_wrong_value_is_answered_with_its_new_name(tmp_path: Path) -> None:
    told = refused(tmp_path, '[task]\nstep_mm = "far"\n')
    assert told.endswith("task.step_mm is now a speed: task.speed_mm_s")


def test_every_new_name_is_a_setting_and_no_old_one_is() -> None:
    for old, renamed in RENAMED.items():
        section, _, name = renamed.key.partition(".")
        table = getattr(Config(), section)
        assert hasattr(table, name), renamed.key
        assert not hasattr(table, old.partition(".")[2]), old


def test_speeds_of_the_task_beyond_the_path_velocity_are_refused(tmp_path: Path) -> None:
    for name in ("speed_mm_s", "approach_speed_mm_s", "retract_speed_mm_s"):
        told = refused(tmp_path, f"[task]\n{name} = 60.0\n")
        assert f"task.{name} of 60 mm/s is faster than the robot's path velocity" in told
        assert "robot.velocity_mm_s, now 50, to 60" in told
    file = tmp_path / "fast.toml"
    file.write_text("[task]\nspeed_mm_s = 60.0\n[robot]\nvelocity_mm_s = 60.0\n", encoding="utf-8")
    assert load_config(file, {}).task.speed_mm_s == 60.0


def test_a_period_that_the_controller_is_not_tuned_for_is_refused(tmp_path: Path) -> None:
    told = refused(tmp_path, "[run]\nperiod_ms = 20.0\n")
    assert "controller predictive is tuned for a sample every 180 ms" in told
    assert "controller.sample_ms = 20" in told
    file = tmp_path / "tuned.toml"
    file.write_text("[run]\nperiod_ms = 20.0\n[controller]\nsample_ms = 20.0\n", encoding="utf-8")
    config = load_config(file, {})
    check(config, virtual=True)
    assert control_loop(config).sample_time == 0.02


def test_a_window_that_holds_no_oscillation_is_refused(tmp_path: Path) -> None:
    told = refused(tmp_path, "[oscillation]\nwindow_ms = 2000.0\n")
    assert re.search(r"oscillation\.window_ms of 2000 ms must hold at least 12 samples .* 2160 or more", told)


def test_a_recording_that_counted_cycles_is_replayed_to_the_bit() -> None:
    record = read(RECORDING)
    recorded = json.loads(record.metadata["config"])
    assert is_counted(recorded)
    config = recorded_config(record, {})
    assert config.task.speed_mm_s * 1e-3 * RECORDED_CYCLE_S == recorded["task"]["step_mm"] * 1e-3
    cycles = list(replay(record, config, forced=False))
    assert len(cycles) == len(record.cycles) > 10
    assert [cycle.differences for cycle in cycles if cycle.differences] == []


@pytest.mark.parametrize("step_mm", [1.0, 0.1, 0.3, 0.7, 1e-3, 3.3])
def test_a_recorded_step_comes_back_to_the_last_bit(step_mm: float) -> None:
    now = translated({"task": {"step_mm": step_mm, "force_n": 3.0}})
    assert isinstance(now, dict)
    speed = now["task"]["speed_mm_s"]
    assert speed * 1e-3 * RECORDED_CYCLE_S == step_mm * 1e-3
    assert now["task"]["force_n"] == 3.0
    assert "step_mm" not in now["task"]


@pytest.mark.parametrize("odd", [None, [], 3, {"task": 3}, {"task": {"speed_mm_s": 2.0}}, {"limits": []}])
def test_what_counts_no_cycles_stays_as_it_is(odd: Any) -> None:
    assert not is_counted(odd)
    assert translated(odd) is odd


def test_a_run_without_a_limit_for_pulls_stopped_at_its_limit_of_force() -> None:
    assert translated({"limits": {"force_limit_n": 40.0}}) == {
        "limits": {"force_limit_n": 40.0, "pull_limit_n": 40.0}
    }
    both = {"limits": {"force_limit_n": 40.0, "pull_limit_n": 8.0}}
    assert translated(both) is both


def test_a_file_of_the_first_version_is_upgraded_with_its_comments(tmp_path: Path) -> None:
    from click.testing import CliRunner

    from hil_bridge.cli import cli

    old, new = tmp_path / "old.toml", tmp_path / "new.toml"
    old.write_text(
        "[run]\nseed = 3\n[task]\nstep_mm = 0.9  # slowly\n#loss_samples = 5\n[limits]\nstill_after_cycles = 4\n",
        encoding="utf-8",
    )
    done = CliRunner().invoke(cli, ["config", "upgrade", str(old), str(new)])
    assert done.exit_code == 0, done.output
    assert "task.step_mm = 0.9 is now task.speed_mm_s = 5" in done.output
    assert new.read_text(encoding="utf-8").splitlines() == [
        "[run]",
        "seed = 3",
        "[task]",
        "speed_mm_s = 5  # slowly",
        "#loss_ms = 810",
        "[limits]",
        "still_after_ms = 630",
    ]
    config = load_config(new, {})
    assert (config.task.speed_mm_s, config.limits.still_after_ms, config.run.seed) == (5.0, 630.0, 3)
    again = CliRunner().invoke(cli, ["config", "upgrade", str(old), str(new)])
    assert isinstance(again.exception, ConfigError)
