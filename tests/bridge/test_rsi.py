"""A KUKA robot with RSI in whole runs: the loop closes, runs repeat, and each refusal ends a run in words."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from hil_bridge.cli import cli

BASE = '[run]\nperiod_ms = 20\n[controller]\nsample_ms = 20\n[robot]\nemulated = "rsi"\n'
MODES = {
    "relative": "",
    "absolute": '[robot.rsi]\nmode = "absolute"\n[cell.rsi]\nmode = "absolute"\n',
    "12 ms": "[robot.rsi]\ncycle_ms = 12\n[cell.rsi]\ncycle_ms = 12\n",
}


def invoke(place: Path, more: str = "", *arguments: str) -> tuple[int, str]:
    config = place / "rsi.toml"
    config.write_text(BASE + more)
    result = CliRunner().invoke(
        cli, ["run", str(config), "--virtual", "--no-view", *arguments], catch_exceptions=False
    )
    return result.exit_code, result.output


@pytest.mark.parametrize("mode", MODES)
def test_the_loop_closes_at_ten_newtons(mode: str, tmp_path: Path) -> None:
    summary = tmp_path / "s.json"
    period = BASE.replace("= 20", "= 24") if mode == "12 ms" else BASE
    config = tmp_path / "rsi.toml"
    config.write_text(period + MODES[mode])
    arguments = ["run", str(config), "--virtual", "--no-view", "--duration", "2", "--no-record"]
    result = CliRunner().invoke(cli, [*arguments, "--summary", str(summary)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    told = json.loads(summary.read_text())
    assert told["outcome"] == "completed"
    assert told["force_mean_steady_n"] == pytest.approx(10.0, abs=0.5)
    assert told["figures"]["contact_losses"] == 0
