"""`hil-bridge tune` with some tens of short runs."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from hil_bridge.cli import cli
from hil_bridge.errors import ConfigError
from hil_bridge.settings.configuration import load_config

NEAR = """
[run]
duration_s = 0.4
[task]
retract_speed_mm_s = 20.0
retract_mm = 5.0
[cell]
start_position_mm = [900.0, -100.0, 593.0]
"""  # just above the surface
ARGUMENTS = (
    "--controller",
    "pi",
    "--vary",
    "integral",
    "--minimise",
    "rms_error_n",
    "--budget",
    "30",
    "--seeds",
    "2",
)


def tune(*arguments: str) -> "tuple[int, str]":
    result = CliRunner().invoke(cli, ["tune", *arguments], catch_exceptions=True)
    if isinstance(result.exception, ConfigError):
        raise result.exception
    return result.exit_code, result.output


@pytest.mark.full
def test_search_writes_runnable_file(tmp_path: Path) -> None:
    cell, out, result = tmp_path / "cell.toml", tmp_path / "tuned.toml", tmp_path / "all.json"
    cell.write_text(NEAR, encoding="utf-8")
    arguments = (str(cell), *ARGUMENTS, "--workers", "1", "--trade", "rms_error_n:largest_force_n")
    outputs = ("--output", str(out), "--json", str(result), "--plot", str(tmp_path / "front.png"))
    code, output = tune(*arguments, *outputs)
    assert code == 0, output
    assert "the same cell, fresh seeds, 4 seeds: " in output
    assert (tmp_path / "front.png").read_bytes().startswith(b"\x89PNG")
    report = json.loads(result.read_text(encoding="utf-8"))
    assert load_config(out, {}).controller.parameters["integral"] == report["best"]["integral"]
    assert len(report["tried"]) >= 5
    text = out.read_text(encoding="utf-8")
    with pytest.raises(ConfigError, match="already exists"):
        tune(*arguments, *outputs)
    assert out.read_text(encoding="utf-8") == text


def test_campaign_with_real_robot_is_refused(tmp_path: Path) -> None:
    cell = tmp_path / "cell.toml"
    cell.write_text('[robot]\nurl = "s3+tcp://127.0.0.1:1"\n', encoding="utf-8")
    with pytest.raises(ConfigError, match="on the emulated cell only"):
        tune(str(cell), *ARGUMENTS)
