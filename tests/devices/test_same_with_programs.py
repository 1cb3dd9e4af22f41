"""Runs over RTDE whose robot also executes a user's program: identical recordings and replays."""

from functools import partial
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

import hil_bridge
from hil_bridge.cli import cli
from protocol.devices.rtde.states import Runtime
from protocol.devices.rtde.wires import Port
from tests.near_surface import AWAKE

pytestmark = pytest.mark.full

PRESSES = """thread noise():
  while True:
    write_output_float_register(30, random())
    sync()
  end
end
run noise()
zero_ftsensor()
force_mode(p[0,0,0,0,0,0], [0,0,1,0,0,0], [0,0,-4,0,0,0], 2, [0.1,0.1,0.01,0.2,0.2,0.2])
sleep(0.4)
end_force_mode()
movel(pose_add(get_actual_tcp_pose(), p[0.002 * random(), 0, 0.001, 0, 0, 0]), a=1, v=0.01)
sleep(60)
"""
SECONDARY_PROGRAM = "sec beside():\n  set_standard_digital_out(1, random() > 0.5)\n  textmsg(random())\nend\n"


def config_of(folder: Path, seed: int) -> dict[str, Any]:
    return {
        "run": {"duration_s": 0.5, "seed": seed},
        "robot": {"emulated": "rtde"},
        "sensor": {"emulated": "netft"},
        "task": {"retract_mm": 2.0},
        "cell": {
            **AWAKE,
            "start_position_mm": [900.0, -100.0, 592.0],
            "rtde": {"program_folder": str(folder)},
        },
    }


async def run_with_secondary_program(
    folder: Path, seed: int, record: Path, takes_over: bool
) -> hil_bridge.Result:
    """Run secondary programs in addition to the bridge's; then a stored program may control the arm in force mode."""
    async with hil_bridge.simulation(config_of(folder, seed)) as run:
        assert run.cell is not None
        robot, clock = run.cell.robot, run.clock
        dashboard, script = (robot.connect(port, clock.now()) for port in (Port.DASHBOARD, Port.SCRIPT))
        for phase in ("approach", "track"):
            await run.reached(phase)
            script.receive(SECONDARY_PROGRAM.encode(), clock.now())
        if takes_over:
            dashboard.receive(b"stop\nload presses.urp\nplay\n", clock.now())
        await run.finished()
        await clock.sleep_until(clock.now() + 1.0)
        robot.controller.advance(clock.now())
        controller = robot.controller
        assert controller.counts["secondary programs"] == 2
        assert controller.player.runtime == Runtime.PLAYING
        assert ("output_double_register_30" in controller.io.outputs) is takes_over
    run.result.save(record)
    return run.result


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    programs = tmp_path / "programs"
    programs.mkdir()
    (programs / "presses.script").write_text(PRESSES)
    return programs


@pytest.mark.parametrize("takes_over", [False, True])
def test_runs_with_program_are_reproducible(folder: Path, tmp_path: Path, takes_over: bool) -> None:
    records = []
    for number, seed in enumerate((3, 3, 4)):
        record = tmp_path / f"{number}.mcap"
        run = partial(run_with_secondary_program, folder, seed, record, takes_over)
        result = hil_bridge.run_virtual(run)
        assert result.outcome == ("stopped" if takes_over else "completed")
        records.append(record)
    first, again, other = (record.read_bytes() for record in records)
    assert first == again
    assert first != other
    replayed = CliRunner().invoke(cli, ["replay", str(records[0])], catch_exceptions=False)
    assert replayed.exit_code == 0, replayed.output
