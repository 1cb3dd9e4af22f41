"""Every streaming robot with every sensor in one emulated cell: 10 N on a contour."""

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
def test_pairs_of_robot_and_sensor_hold_ten_newtons(robot: str, sensor: str) -> None:
    values = merged(
        CLOSE,
        {
            "run": {"duration_s": 3.0, "seed": 7},
            "robot": {"emulated": robot},
            "sensor": {"emulated": sensor},
            "task": {"retract_mm": 6.0},  # the surface rises
            # these runs do not test the rate of its records
            "cell": {"surface": CONTOUR, "netft": {"rate_hz": 1000}},
        },
    )
    config = read_config(values)
    run = simulate(config)
    assert (run.outcome, run.text) == (Outcome.COMPLETED, "")
    tracked = [record for record in run.cycles if record.phase == "track"]
    steady = [record for record in tracked if record.sample.sensor_at > tracked[0].sample.sensor_at + 2.0]
    # a Universal Robot leaves its targets by 0.1 mm in half a second, which is 0.5 N here
    forces = [record.force for record in steady]
    assert statistics.fmean(forces) == pytest.approx(10.0, abs=1.0 if robot == "rtde" else 0.5)
    assert max(abs(force - 10.0) for force in forces) < (3.0 if robot == "rtde" else 2.0)
    assert all(record.in_contact for record in steady)
    assert run.left.startswith("retracted")


@pytest.mark.sweep
@pytest.mark.parametrize("robot", STREAMED)
def test_recording_of_stream_contains_answer_times(robot: str, tmp_path: Path) -> None:
    """A replay can use another controller, and `latency` includes the answers.

    The tests of each robot check that two runs are identical to the byte, and that a replay is identical.
    """
    near = tmp_path / "near.toml"
    near.write_text(f"{AWAKE_TOML}{CLOSE_TOML}cell.netft.rate_hz = 1000\n")
    record = str(tmp_path / "run.mcap")
    arguments = ["run", str(near), "--robot", robot, "--sensor", "netft", "--virtual", "--seed", "3"]
    arguments += ["--duration", "0.3", "--no-view", "--record", record]
    result = CliRunner().invoke(cli, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    for other in ("pi", "fuzzy"):
        replay = CliRunner().invoke(cli, ["replay", record, "--controller", other], catch_exceptions=False)
        assert f"commands of {other} with these limits" in replay.output
    latency = CliRunner().invoke(cli, ["latency", record], catch_exceptions=False).output
    assert "answers: " in latency
    assert "0 of " in latency
    assert "of a late answer: " in latency
