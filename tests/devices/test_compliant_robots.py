"""Built-in robots pressing with a compliant arm: reported position and true position of the tool."""

from pathlib import Path

import numpy as np
import pytest

from hil_bridge.record import read
from tests.command_line import Command

STREAMED = ("egm", "rtde", "rsi")
STIFFNESS = 15e3
WEIGHT_N = 0.5 * 9.80665


@pytest.mark.parametrize("robot", ["s3", *(pytest.param(kind, marks=pytest.mark.full) for kind in STREAMED)])
def test_reported_position_lacks_the_deflection(hil: Command, tmp_path: Path, robot: str) -> None:
    stiffness = f"[{STIFFNESS:g}, {STIFFNESS:g}, {STIFFNESS:g}, 0, 0, 0]"
    code, _, errors = hil(
        *("run", "--virtual", "--robot", robot, "--duration", "6", "--record", tmp_path / "run.mcap"),
        *("--set", "cell.arm.compliance=cartesian", "--set", f"cell.arm.stiffness_n_m={stiffness}"),
    )
    assert (code, errors) == (0, "")
    recording = read(tmp_path / "run.mcap")
    truths = {truth.cycle: truth for truth in recording.truths}
    rows = [
        (cycle.sample.position[2], truths[cycle.cycle].position[2], truths[cycle.cycle].force[2])
        for cycle in recording.cycles
        if cycle.phase == "track" and cycle.cycle in truths
    ][-20:]
    reported, true, force = np.array(rows).T
    assert np.mean(force) == pytest.approx(10.0, abs=1.5)
    # the S3 reports steps of 0.125 mm
    assert np.mean(true - reported) == pytest.approx((np.mean(force) - WEIGHT_N) / STIFFNESS, abs=0.1e-3)


@pytest.mark.parametrize(
    "robot", [*(pytest.param(kind, marks=pytest.mark.full) for kind in ("s3", "egm", "rsi")), "rtde"]
)
def test_true_force_is_that_of_true_depth(hil: Command, tmp_path: Path, robot: str) -> None:
    """In each cycle from approach to retraction, on a spring without damping at a height of 590 mm."""
    settings = ("arm.compliance=joints", "surface.damping_ns_m=0", "surface.friction=0")
    code, _, errors = hil(
        *("run", "--virtual", "--robot", robot, "--duration", "3", "--record", tmp_path / "run.mcap"),
        *(part for setting in settings for part in ("--set", f"cell.{setting}")),
    )
    assert (code, errors) == (0, "")
    heights, forces = np.array(
        [(truth.position[2], truth.force[2]) for truth in read(tmp_path / "run.mcap").truths]
    ).T
    assert forces.max() > 9.0
    np.testing.assert_allclose(forces, 5e3 * np.maximum(0.59 - heights, 0.0), atol=0.05)
