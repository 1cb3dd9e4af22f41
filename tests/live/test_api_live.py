"""Tests of the Python interface in real time, over loopback."""

from typing import Any

import pytest

import hil_bridge
from hil_bridge.clock import Clock
from hil_bridge.runs.compose import emulated_cell
from hil_bridge.runs.setup import Listen, Setup
from hil_bridge.settings.configuration import read_config

pytestmark = pytest.mark.live

CELL: dict[str, Any] = {
    "robot": {"emulated": "egm"},
    "sensor": {"emulated": "ft300"},
    "limits": {"path_error_mm": 3.0},
    "run": {"period_ms": 20.0, "duration_s": 30.0},
    "controller": {"sample_ms": 20.0},
    "task": {"approach_speed_mm_s": 5.0, "retract_speed_mm_s": 20.0, "retract_mm": 5.0},
    "cell": {"start_position_mm": [900.0, -100.0, 593.0]},
}


def test_api_run_in_real_time() -> None:
    async def main() -> hil_bridge.Result:
        async with hil_bridge.simulation(CELL) as running:
            await running.reached("track")
            await running.clock.sleep_until(running.clock.now() + 0.5)
            assert running.truth().contact_force[2] > 1.0
            running.panel.inject("robot", "motors-off")
            ended = await running.finished()
            assert ended.outcome == "stopped"
        return running.result

    result = hil_bridge.run_real(main)
    assert "motors are off" in result.text
    assert len(result.arrays.truths.force) == len(result.cycles)


def test_devices_without_run_in_real_time() -> None:
    async def main() -> None:
        async with hil_bridge.open_devices(CELL) as cell:
            report = await cell.robot.ready()
            await cell.sensor.ready()
            frame = await cell.sensor.frame()
            assert len(cell.sensor.wrench(frame)) == 6
            assert report.pose.position == pytest.approx(cell.truth().position, abs=1e-3)

    hil_bridge.run_real(main)


def test_robot_without_sensor_is_opened() -> None:
    """The robot listens at a URL like a real one, and there is no emulated sensor."""
    here = read_config({"robot": {"emulated": "rtde"}})
    at = Listen("rtde+tcp-listen://127.0.0.1:0", None)

    async def main() -> None:
        async with emulated_cell(Setup(here, at), Clock.running(), lambda error: None) as served:
            assert served.robot is not None
            config = {"robot": {"url": f"rtde+{served.robot.url}"}}
            async with hil_bridge.open_devices(config) as cell:
                report = await cell.robot.ready()
                true = served.cell.true_state(served.cell.truth_available_from(cell.clock.now()))
                assert report.pose.position == pytest.approx(true.position, abs=1e-3)
                with pytest.raises(hil_bridge.ConfigError, match=r"set sensor\.url to read forces"):
                    _ = cell.sensor
                with pytest.raises(hil_bridge.ConfigError, match="only known for an emulated cell"):
                    cell.truth()

    hil_bridge.run_real(main)
