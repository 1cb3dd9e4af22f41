"""A raster over a sphere, perpendicular to it, compared with a straight run over an arc of the same radius."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.emulation.exact_arm import NO_ERROR

pytestmark = pytest.mark.sweep

Trial = Any
Play = Callable[..., Trial]
RUNS = {
    "s3, 5 kN/m": ("s3", 5.0, 5e3, 60, 1.5),
    "s3, 50 kN/m": ("s3", 5.0, 5e4, 30, 9.0),
    "egm, 5 kN/m": ("egm", 20.0, 5e3, 30, 0.8),
    "egm, 50 kN/m": ("egm", 20.0, 5e4, 30, 5.5),
    "rtde, 5 kN/m": ("rtde", 20.0, 5e3, 15, 0.8),
    "rsi, 5 kN/m": ("rsi", 20.0, 5e3, 15, 0.8),
}
"""Robot, speed along the surface in mm/s, stiffness in N/m, width of the raster in mm, and the largest error of the
true force in N. The raster's lines are 60 mm long. One step of the S3's position is 3 N on the hard surface.
"""


def cell(robot: str, kind: str, stiffness: float) -> dict[str, Any]:
    """The Universal Robot is exact, because the error of a real arm varies by more than the limits below."""
    return {
        "cell": {
            **({"rtde": NO_ERROR} if robot == "rtde" else {}),
            "start_position_mm": (870.0, -30.0, 590.0),
            "surface": {"kind": kind, "radius_mm": 300.0, "stiffness_n_m": stiffness},
            # one position step of the S3 is 3 N on the hard surface, so where the steps fall decides the figures
            **({"arm": {"compliance": "rigid"}} if (robot, stiffness) == ("s3", 5e4) else {}),
        },
        "task": {"expected_stiffness_n_m": stiffness, "retract_mm": 5.0},
    }


@pytest.fixture(scope="module", params=RUNS.values(), ids=list(RUNS))
def runs(request: pytest.FixtureRequest, play: Play) -> tuple[Trial, Trial, float]:
    """The raster, and the straight run of the same robot, which follows the contour without turning the tool. Both
    travel at once.

    The raster's far corner is 95 mm from the top of the sphere, where it falls away by 18°.
    """
    robot, speed, stiffness, width, band = request.param
    path = {"kind": "raster", "size_mm": [60, width], "spacing_mm": 15}
    stroke = {"do": "track", "path": path, "speed_mm_s": speed, "orientation": "normal"}
    steps = [{"do": "approach", "at_most_mm": 30}, stroke, {"do": "retract"}]
    straight = {
        "run": {"duration_s": 60.0},
        "frame": {"follow_normal": True},
        "task": {"speed_mm_s": speed, "travel_limit_mm": 60.0, "travel_rise_s": 0.0},
    }
    return (
        play(robot, steps, cell(robot, "sphere", stiffness)),
        play(robot, [], cell(robot, "circular_arc", stiffness), straight),
        band,
    )


@pytest.mark.full
def test_raster_tool_stays_perpendicular(runs: tuple[Trial, Trial, float]) -> None:
    raster, _, _ = runs
    skews = [skew for _, distance, skew in raster.skews(2) if distance > 0.02]
    assert len(skews) > 100
    assert math.sqrt(sum(skew**2 for skew in skews) / len(skews)) <= 2.0


@pytest.mark.full
def test_raster_force_is_held_like_on_a_contour(runs: tuple[Trial, Trial, float]) -> None:
    raster, straight, _ = runs
    tracked = [record.force - 10.0 for record in straight.cycles if record.phase == "track"]
    reference = math.sqrt(sum(error**2 for error in tracked) / len(tracked))
    assert raster.rms(2) <= reference


@pytest.mark.full
def test_raster_keeps_contact_and_limits(runs: tuple[Trial, Trial, float]) -> None:
    raster, _, band = runs
    assert raster.result.outcome == "completed"
    assert raster.result.left == "retracted, 0.0 N"
    assert all(record.in_contact for record in raster.of(2) if record.phase == "track")
    touch = raster.of(2)[0].started_at
    reasons = {
        (record.started_at - touch < 0.5, record.reasons) for record in raster.cycles if record.reasons
    }
    assert reasons <= {(True, ("deeper faster than 11 mm/s",))}
    assert raster.largest < raster.config.limits.force_limit_n
    steady_at = next(record.started_at for record in raster.of(2) if raster.distance(record) > 0.02)
    pressing = (raster.times > steady_at) & (raster.times < raster.of(2)[-1].started_at)
    forces = np.linalg.norm(raster.forces[pressing], axis=1)
    assert (forces.min(), forces.max()) == pytest.approx((10.0, 10.0), abs=band)


def test_raster_path_is_covered_completely(runs: tuple[Trial, Trial, float]) -> None:
    """Forth and back along base y, and each line farther towards the base than the one before."""
    raster, _, _ = runs
    width = raster.config.task.step[1].path.size_mm[1] * 1e-3
    lines = round(width / 0.015) + 1
    assert raster.steps[1].way == pytest.approx(lines * 0.06 + width, abs=1e-3)
    positions = [state.position[:2] for _, state in raster.states if state.contact_force[2] > 1.0]
    for k in range(lines):
        for y in (-0.03, 0.0, 0.03):
            assert min(math.dist((0.87 - 0.015 * k, y), position) for position in positions) < 2.5e-3


def test_raster_replays_identically(runs: tuple[Trial, Trial, float]) -> None:
    assert runs[0].differs() == []
