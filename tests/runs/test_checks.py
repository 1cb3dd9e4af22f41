"""Contradictory settings: a run is refused before any motion, in one line."""

import re
from pathlib import Path

import pytest

from hil_bridge.clock import VIRTUAL_EPOCH
from hil_bridge.errors import ConfigError
from hil_bridge.runs import compose
from hil_bridge.runs.checks import check
from hil_bridge.runs.outputs import Outputs
from hil_bridge.runs.session import execute
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import load_config, read_config
from tests.near_surface import NEAR


def refused(tmp_path: Path, text: str) -> str:
    """Return the line with which a configuration is refused."""
    file = tmp_path / "cell.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError) as error:
        check(Setup(load_config(file, {})), True, VIRTUAL_EPOCH)
    assert "\n" not in str(error.value)
    return str(error.value)


def test_task_speed_above_path_velocity_is_refused(tmp_path: Path) -> None:
    for name in ("speed_mm_s", "approach_speed_mm_s", "retract_speed_mm_s"):
        message = refused(tmp_path, f"[task]\n{name} = 60.0\n")
        assert f"task.{name} of 60 mm/s is faster than the robot's path velocity" in message
        assert "robot.velocity_mm_s, now 50, to 60" in message
    file = tmp_path / "fast.toml"
    file.write_text("[task]\nspeed_mm_s = 60.0\n[robot]\nvelocity_mm_s = 60.0\n", encoding="utf-8")
    assert load_config(file, {}).task.speed_mm_s == 60.0


def test_sample_time_below_the_line_of_the_robot_is_refused(tmp_path: Path) -> None:
    message = refused(tmp_path, "[controller]\nsample_ms = 2.0\n")
    assert (
        "sample_ms of 2 ms is shorter than the line of a s3 allows, where a decision takes 187 ms" in message
    )


def test_period_unsuitable_for_controller_is_refused(tmp_path: Path) -> None:
    message = refused(tmp_path, "[run]\nperiod_ms = 20.0\n")
    assert "controller predictive is tuned for a sample every 180 ms" in message
    assert "controller.sample_ms = 20" in message
    file = tmp_path / "tuned.toml"
    tuned = '[run]\nperiod_ms = 20.0\n[controller]\nsample_ms = 20.0\n[robot]\nemulated = "egm"\n'
    file.write_text(tuned, encoding="utf-8")
    setup = Setup(load_config(file, {}))
    check(setup, True, VIRTUAL_EPOCH)
    assert setup.loop.sample_time == 0.02


def test_too_short_oscillation_window_is_refused(tmp_path: Path) -> None:
    message = refused(tmp_path, "[oscillation]\nwindow_ms = 2000.0\n")
    assert re.search(
        r"oscillation\.window_ms of 2000 ms must hold at least 12 samples .* 2160 or more", message
    )


@pytest.mark.full
@pytest.mark.parametrize("robot", ["s3", "egm", "rtde", "rsi"])
def test_cell_pace_and_loop_are_made_once(
    robot: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    counts: dict[str, int] = {}

    def counted(module: str, name: str) -> None:
        made = getattr(__import__(module, fromlist=[name]), name)

        def count(*arguments: object) -> object:
            counts[name] = counts.get(name, 0) + 1
            return made(*arguments)

        monkeypatch.setattr(f"{module}.{name}", count)

    counted(compose.__name__, "make_cell")
    counted("hil_bridge.runs.setup", "set_pace")
    counted("hil_bridge.runs.setup", "control_loop")
    config = read_config({**NEAR, "run": {"duration_s": 0.2}, "robot": {"emulated": robot}})
    assert execute(config, True, Outputs(record=tmp_path / "run.mcap"), view=False) == 0
    assert counts == {"make_cell": 1, "set_pace": 1, "control_loop": 1}


def test_desired_force_at_limit_is_refused(tmp_path: Path) -> None:
    """Any overshoot would stop the run."""
    message = refused(tmp_path, "[task]\nforce_n = 50.0\n[limits]\nforce_limit_n = 50.0\n")
    assert message.startswith("task.force_n (--force-n) of 50 N must be below limits.force_limit_n of 50 N")
    file = tmp_path / "below.toml"
    file.write_text("[task]\nforce_n = 49.9\n[limits]\nforce_limit_n = 50.0\n", encoding="utf-8")
    check(Setup(load_config(file, {})), True, VIRTUAL_EPOCH)


@pytest.mark.parametrize(
    ("to_mm", "position"),
    [
        ((20.0, 0.0), "0.900 -0.080 "),
        ((-20.0, 0.0), "0.900 -0.120 "),
        ((0.0, 20.0), "0.880 -0.100 "),
        ((0.0, -20.0), "0.920 -0.100 "),
    ],
)
def test_point_outside_workspace_is_in_base_frame(
    tmp_path: Path, to_mm: tuple[float, float], position: str
) -> None:
    box = "[limits]\nworkspace_min_m = [0.89, -0.11, 0.0]\nworkspace_max_m = [0.91, -0.09, 2.0]\n"
    steps = f'[[task.step]]\ndo = "move"\nto_mm = {list(to_mm)}\n[[task.step]]\ndo = "retract"\n'
    assert f"it leads to {position}" in refused(tmp_path, box + steps)
