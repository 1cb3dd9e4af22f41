"""Every robot that streams with every sensor, in one emulated cell: the loop closes to 10 N on a contour."""

import statistics
from pathlib import Path

import pytest
from click.testing import CliRunner

from hil_bridge.api import simulate
from hil_bridge.cli import cli
from hil_bridge.devices.kinds import ROBOTS, SENSORS
from hil_bridge.record import Outcome
from hil_bridge.settings.configuration import read_config
from tests.near_surface import AWAKE_TOML, CLOSE, CLOSE_TOML, merged

CONTOUR = {
    "kind": "sinusoidal",
    "amplitude_mm": 3.0,
    "period_mm": 150.0,
    "origin_y_mm": -100.0,
    "stiffness_n_m": 5e3,
}
"""Curved, so that the set point has to follow a surface that rises and falls."""
STREAMED = [name for name in ROBOTS.own if name != "s3"]


@pytest.mark.sweep
@pytest.mark.parametrize("sensor", SENSORS.own)
@pytest.mark.parametrize("robot", STREAMED)
def test_any_robot_holds_ten_newtons_with_any_sensor(robot: str, sensor: str) -> None:
    values = merged(
        CLOSE,
        {
            "run": {"duration_s": 1.0, "seed": 7},
            "robot": {"emulated": robot},
            "sensor": {"emulated": sensor},
            # these runs are not about the rate of its records
            "cell": {"surface": CONTOUR, "netft": {"rate_hz": 1000}},
        },
    )
    config = read_config(values)
    run = simulate(config)
    assert (run.outcome, run.text) == (Outcome.COMPLETED, "")
    tracked = [record for record in run.cycles if record.phase == "track"]
    steady = [
        record.force for record in tracked if record.sample.sensor_at > tracked[0].sample.sensor_at + 0.5
    ]
    # a Universal Robot leaves its targets by 0.1 mm in half a second, which is 0.5 N here
    assert statistics.fmean(steady) == pytest.approx(10.0, abs=1.0 if robot == "rtde" else 0.5)
    assert max(abs(force - 10.0) for force in steady) < 2.0
    assert all(record.in_contact for record in tracked)
    assert run.left.startswith("retracted")


@pytest.mark.sweep
@pytest.mark.parametrize("robot", STREAMED)
def test_the_record_tells_how_soon_a_robot_was_answered(robot: str, tmp_path: Path) -> None:
    """A replay decides as another controller would, and `latency` knows the answers.

    That two runs are the same to the byte, and a replay identical, is held for each robot in its own tests.
    """
    near = tmp_path / "near.toml"
    near.write_text(f"{AWAKE_TOML}{CLOSE_TOML}cell.netft.rate_hz = 1000\n")
    record = str(tmp_path / "run.mcap")
    arguments = ["run", str(near), "--robot", robot, "--sensor", "netft", "--virtual", "--seed", "3"]
    arguments += ["--duration", "0.3", "--no-view", "--record", record]
    done = CliRunner().invoke(cli, arguments, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    for other in ("pi", "fuzzy"):
        asked = CliRunner().invoke(cli, ["replay", record, "--controller", other], catch_exceptions=False)
        assert f"commands of {other} with these limits" in asked.output
    told = CliRunner().invoke(cli, ["latency", record], catch_exceptions=False).output
    assert "answers: " in told
    assert "0 of " in told
    assert "of a late answer: " in told
