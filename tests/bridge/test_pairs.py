"""Every robot that streams with every sensor, in one emulated cell: the loop closes to 10 N on a contour."""

import statistics

import pytest

from hil_bridge.experiments.emulated_run import run_emulated
from hil_bridge.kinds import ROBOTS, SENSORS
from hil_bridge.recording import Outcome
from hil_bridge.settings.configuration import read_config

CONTOUR = {
    "kind": "sinusoidal",
    "amplitude_mm": 3.0,
    "period_mm": 150.0,
    "origin_y_mm": -100.0,
    "stiffness_n_m": 5e3,
}
"""Curved, so that the set point has to follow a surface that rises and falls."""
STREAMED = [name for name in ROBOTS.built_in if name not in ROBOTS.direct]


@pytest.mark.parametrize("sensor", SENSORS.built_in)
@pytest.mark.parametrize("robot", STREAMED)
def test_any_robot_holds_ten_newtons_with_any_sensor(robot: str, sensor: str) -> None:
    config = read_config(
        {
            "run": {"duration_s": 1.5, "seed": 7},
            "robot": {"emulated": robot},
            "sensor": {"emulated": sensor},
            "cell": {"surface": CONTOUR},
        }
    )
    run = run_emulated(config)
    assert (run.result.outcome, run.result.cause) == (Outcome.COMPLETED, "")
    tracked = [record for record in run.cycles if record.phase == "track"]
    steady = [record.force for record in tracked if record.sensor_at > tracked[0].sensor_at + 0.75]
    assert statistics.fmean(steady) == pytest.approx(10.0, abs=0.5)
    assert max(abs(force - 10.0) for force in steady) < 2.0
    assert all(record.in_contact for record in tracked)
    assert run.result.left.startswith("retracted")
