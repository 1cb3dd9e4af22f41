"""A flat tool that is set down at an angle, and a stationary point tool that cannot learn the normal."""

import math
from collections.abc import Callable
from typing import Any

import pytest

pytestmark = pytest.mark.sweep

Trial = Any
Play = Callable[..., Trial]
HALF = math.radians(5.0) / 2
ASKEW = (0.0, math.cos(HALF), 0.0, -math.sin(HALF))
STEPS: list[dict[str, Any]] = [
    {"do": "approach"},
    {"do": "hold", "for_s": 3.6, "orientation": "normal"},
    {"do": "retract"},
]
RUNS = {
    "s3, 5 kN/m": ("s3", 5e3),
    "s3, 50 kN/m": ("s3", 5e4),
    "egm, 5 kN/m": ("egm", 5e3),
    "egm, 50 kN/m": ("egm", 5e4),
}


def cell(stiffness: float, radius_mm: float) -> dict[str, Any]:
    return {
        "cell": {
            "start_quaternion": ASKEW,
            "start_position_mm": (900.0, 0.0, 592.5),
            "tool": {"face_radius_mm": radius_mm},
            "surface": {"stiffness_n_m": stiffness},
        },
        "task": {"expected_stiffness_n_m": stiffness, "retract_mm": 4.0},
    }


@pytest.fixture(scope="module", params=RUNS.values(), ids=list(RUNS))
def flat(request: pytest.FixtureRequest, play: Play) -> Trial:
    robot, stiffness = request.param
    return play(robot, STEPS, cell(stiffness, 15.0))


def test_flat_tool_aligns_within_3_s(flat: Trial) -> None:
    skews = flat.skews(2)
    began = skews[0][0]
    assert skews[0][2] == pytest.approx(5.0, abs=0.3)
    late = [skew for at, _, skew in skews if at > began + 3.0]
    assert len(late) >= 10
    assert max(late) < 0.5


def test_flat_tool_presses_within_limits(flat: Trial) -> None:
    assert (flat.result.outcome, flat.result.left) == ("completed", "retracted, 0.0 N")
    assert flat.clamps() <= {"deeper faster than 11 mm/s"}
    assert flat.largest < flat.config.limits.force_limit_n
    holding = flat.of(2)
    assert all(record.in_contact for record in holding if record.started_at > holding[-1].started_at - 2.0)


def test_flat_tool_run_replays_identically(flat: Trial) -> None:
    assert flat.differs() == []


@pytest.mark.parametrize("robot", ["s3", "egm"])
def test_stationary_point_tool_does_not_turn(play: Play, robot: str) -> None:
    """It neither slides nor has moments, so the normal is unknown."""
    short = [STEPS[0], {**STEPS[1], "for_s": 1.5}, STEPS[2]]
    point = play(robot, short, cell(5e3, 0.0))
    assert point.result.outcome == "completed"
    assert {record.quaternion_commanded for record in point.cycles} == {()}
    (skew,) = {round(skew, 2) for _, _, skew in point.skews(2)}
    assert skew == pytest.approx(5.0, abs=0.05)
    sigmas = [record.explanation.get("normal_sigma_deg", math.inf) for record in point.of(2)]
    assert min(sigmas) > point.config.frame.facing.uncertain_deg
