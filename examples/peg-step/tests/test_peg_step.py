"""Suites for steps and surfaces, and tests of the additional promises of this step."""

import math
from typing import Any

import numpy as np
import pytest
from peg_step.insert import Insert, Memory
from peg_step.plate import SURFACE, PlateWithHole

import hil_bridge
from hil_bridge.control.steps.led import StepSample
from hil_bridge.testing import SurfaceCase
from hil_bridge.testing.steps import *  # noqa: F403
from hil_bridge.testing.surfaces import *  # noqa: F403

STEPS = (
    {"do": "approach", "at_most_mm": 12.0},
    {"do": "insert", "depth_mm": 6.0, "name": "hole"},
    {"do": "retract"},
)
CELL = {
    "surface_kind": "plate-with-hole",
    "start_position_mm": [900.0, 0.0, 593.0],
    "plate_with_hole": {"hole_mm": [2.0, 1.5]},
}


@pytest.fixture
def step() -> Insert:
    return Insert(depth_mm=6.0)


@pytest.fixture
def surface() -> SurfaceCase:
    return SurfaceCase(SURFACE, above_m=(0.9, -0.1, 0.7), inside_m=(0.9, -0.1, 0.588), friction=0.2)


def run(robot: str = "egm", **settings: Any) -> Any:
    approach, insert, retract = STEPS
    steps = [approach, {**insert, **settings}, retract]
    config = {"robot": {"emulated": robot}, "task": {"step": steps}, "cell": CELL}
    return hil_bridge.simulate(config, controller="pi", seed=7)


@pytest.mark.parametrize("robot", ["s3", "egm"])
def test_it_finds_the_hole_and_goes_in_on_a_slow_robot_and_on_a_quick_one(robot: str) -> None:
    result = run(robot)
    assert result.outcome == "completed", result.text
    reported = result.steps[1]
    assert reported.text.startswith("in the hole, 6.")
    x, y, z = (part * 1e3 for part in reported.found)
    assert math.hypot(x - 898.5, y - 2.0) < 1.1  # the clearance, and what 3 N press into its wall
    assert 583.0 < z < 584.2
    assert max(result.arrays.truths.force[:, 2]) < 12.0


def test_a_plate_without_a_hole_near_is_told() -> None:
    result = run(radius_mm=1.0)
    assert result.outcome == "stopped"
    assert result.text == "no hole within 1 mm, in step 2 (insert)"
    assert result.left.startswith("retracted")


def test_time_that_is_up_is_told() -> None:
    assert run(for_s=1.0).text.endswith("mm after 1 s, in step 2 (insert)")


def test_in_the_hole_it_yields_to_both_directions_and_not_to_friction() -> None:
    step, memory = Insert(depth_mm=6.0), Memory(inside=True)

    def yields(x: float, y: float) -> tuple[float, float]:
        sample = StepSample(1.0, 0.1, (2.0, x, y), (0.0, 0.0, 0.0), (0.0, 0.0), 3e-3, True, 10.0)
        after, lead = step.steer(memory, sample)
        assert lead.to == after.middle
        return lead.to

    assert yields(0.3, -0.3) == (0.0, 0.0)
    x, y = yields(3.0, -4.0)
    assert x < 0.0 < y
    assert y / x == pytest.approx(-4.0 / 3.0)


def test_the_plate_pushes_up_beside_the_hole_aside_at_its_wall_and_not_in_it() -> None:
    plate = PlateWithHole(0.59, (0.0, 0.0), 0.5e-3, 10e-3)
    along = np.array([5e-3, 0.0, 0.8e-3, 0.0])
    height = np.array([0.589, 0.585, 0.585, 0.579])
    depth, (u, v, up) = plate.depth_and_normal(along, np.zeros(4), height)
    np.testing.assert_allclose(depth, [1e-3, -0.5e-3, 0.3e-3, 1e-3], atol=1e-12)
    np.testing.assert_allclose(up[[0, 2, 3]], [1.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(u[[0, 2, 3]], [0.0, -1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(u**2 + v**2 + up**2, 1.0)
