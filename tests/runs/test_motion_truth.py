"""Time in the ground truth at which the motion of a cycle begins."""

import math
from pathlib import Path

import numpy as np
import pytest

from emulators.target_times import TargetTimes
from hil_bridge.devices.kinds import ROBOTS
from hil_bridge.record import read
from hil_bridge.runs.outputs import Outputs
from hil_bridge.runs.session import execute
from hil_bridge.settings.configuration import read_config
from hil_bridge.testing import RobotCase
from hil_bridge.testing.robot_emulators import LIMITS
from hil_bridge.testing.robot_rig import RobotRig, run_robot

DELAYS_MS = {"egm": 28.0, "rtde": 4.0, "rsi": 20.0}
"""Time from an order, given when a packet arrives, to its motion: to the next packet, and within the controller."""


@pytest.mark.full
@pytest.mark.parametrize(("kind", "delay_ms"), DELAYS_MS.items())
def test_motion_truth_of_stream_is_one_packet_later(tmp_path: Path, kind: str, delay_ms: float) -> None:
    """In any order of the callbacks; only the first cycle need not begin with a packet."""
    path = tmp_path / "run.mcap"
    sections = {
        "run": {"duration_s": 0.2},
        "robot": {"emulated": kind},
        "sensor": {"emulated": "netft"},
        "virtual": {"shuffled": "all", "seed": 3},
    }
    assert execute(read_config(sections), True, Outputs(record=path), view=False) == 0
    recorded = read(path)
    complete = list(zip(recorded.cycles, recorded.truths, strict=True))[1:-20]
    delays = [truth.motion_at - cycle.answered_at for cycle, truth in complete]
    assert len(delays) > 100
    assert delays == pytest.approx([delay_ms / 1e3] * len(delays), abs=1e-6)


@pytest.mark.parametrize(("kind", "delay_ms"), DELAYS_MS.items())
def test_arm_deviates_when_truth_says(kind: str, delay_ms: float) -> None:
    async def check(rig: RobotRig) -> None:
        async with rig.started() as link, link.motion(LIMITS) as motion:
            await rig.wait(1.0)
            report = await rig.within(link.report(), "report")
            await rig.within(link.report(), "report")
            ordered_at = rig.clock.now()
            assert ordered_at > report.received_at
            await rig.within(motion.to(rig.place(6.0, 0.0, 0.0)), "to")
            await rig.within(motion.settled(), "settled")
            times = np.arange(ordered_at, ordered_at + 0.1, 1e-5)
            positions, _ = rig.robot.path.trajectory(times)
            deviated = np.linalg.norm(positions - positions[0], axis=1) > 1e-8
            first = times[deviated.argmax()] - ordered_at
            assert delay_ms / 1e3 < first < delay_ms / 1e3 + 0.0015

    run_robot(RobotCase(ROBOTS.kind(kind)), check)


def test_target_times_number_arrivals_and_begins() -> None:
    targets = TargetTimes()
    for at in (1.0, 2.0, 2.0, 3.0):
        targets.accept(at)
    assert [targets.arrived_by(at) for at in (0.5, 1.0, 2.5, 9.0)] == [0, 1, 3, 4]
    targets.begin(1.5)
    targets.drop(1)
    assert targets.begun_at(1) == 1.5
    assert math.isnan(targets.begun_at(2) or 0.0)
    assert targets.begun_at(3) is None
    for at in range(2000):
        targets.accept(10.0 + at)
    assert targets.arrived_by(10.0 + 1999) == 2004
    assert targets.arrived_by(10.0 + 1998) == 2003
