"""A wall in the path of a stroke, and a step of 2 mm, whose faces push back with 50 kN/m.

The bound of the true force is the same as in `tests/guard`: the limit, plus the effect of orders already sent,

    bound = limit + stiffness · step · cycles
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

pytestmark = pytest.mark.sweep

Trial = Any
Play = Callable[..., Trial]
FACE = 5e4
"""Stiffness of the faces, N/m."""
LATENCY_CYCLES = 3
"""Cycles from an order to the force that shows its effect."""
LATERAL_N = 20.0
"""The limit of a stroke that has one."""
WALL, STEP = 1000.0, 2.0
"""Heights, mm."""
ROBOTS = {"s3": (2.0, 5.0, 0.18), "egm": (5.0, 20.0, 0.012)}
"""Speed at which the face is noticed in time, the usual speed, mm/s, and the cycle, s."""


def against(
    play: Play, robot: str, stiffness: float, height: float, speed: float, **more: Any
) -> tuple[Trial, float]:
    """Return a stroke of 30 mm with an obstacle after 5 mm, and the largest true force along the surface, N."""
    path = {"kind": "line", "length_mm": 30}
    surface = {"stiffness_n_m": stiffness, "wall_at_mm": -95.0, "wall_height_mm": height}
    trial = play(
        robot,
        [{"do": "approach"}, {"do": "track", "path": path, "speed_mm_s": speed, **more}, {"do": "retract"}],
        {
            "cell": {"start_position_mm": (900.0, -100.0, 591.0), "surface": surface},
            "task": {"expected_stiffness_n_m": stiffness, "retract_mm": 4.0, "retract_speed_mm_s": 11.0},
        },
    )
    return trial, float(np.hypot(trial.forces[:, 0], trial.forces[:, 1]).max())


def bound(limit: float, robot: str, speed: float) -> float:
    """The largest true force that may occur, N."""
    return limit + FACE * speed * 1e-3 * ROBOTS[robot][2] * LATENCY_CYCLES


@pytest.mark.parametrize(("at_wall", "height"), [("slow", WALL), ("stop", STEP)])
@pytest.mark.parametrize("stiffness", [5e3, 5e4])
@pytest.mark.parametrize("robot", ROBOTS)
def test_lateral_limit_ends_stroke_with_reason(
    play: Play, robot: str, stiffness: float, at_wall: str, height: float
) -> None:
    speed = ROBOTS[robot][0]
    run, aside = against(play, robot, stiffness, height, speed, lateral_limit_n=LATERAL_N, at_wall=at_wall)
    assert run.stopped
    message = "stops the feed 5." if at_wall == "slow" else "is beyond 20 N, 5."
    assert message in run.cause
    assert run.cause.endswith("mm along the path: there is an obstacle, in step 2 (track)")
    assert run.result.left == "retracted, 0.0 N"
    assert run.last == 0.0
    assert aside <= LATERAL_N + 15.0
    assert run.largest <= bound(run.config.limits.force_limit_n, robot, speed)
    (step,) = [step for step in run.steps if step.step == 2]
    assert not step.passed
    assert step.text == run.cause
    assert run.differs() == []


def test_slow_stroke_approaches_limit_gradually(play: Play) -> None:
    """The feed falls from half of the limit on."""
    run, _ = against(play, "egm", 5e3, WALL, 5.0, lateral_limit_n=LATERAL_N)
    feeds = [record.explanation.get("feed", 1.0) for record in run.of(2) if record.phase == "track"]
    assert feeds[0] == 1.0
    assert any(0.1 < feed < 0.9 for feed in feeds)
    assert min(feeds) <= 0.05
    assert max(record.travel_commanded for record in run.of(2)) == pytest.approx(0.0055, abs=0.5e-3)


@pytest.mark.parametrize("height", [WALL, STEP], ids=["wall", "step"])
@pytest.mark.parametrize("robot", ROBOTS)
def test_guard_stops_stroke_without_lateral_limit(play: Play, robot: str, height: float) -> None:
    """The force against the travel reaches its limit first, as in a run without steps."""
    speed = ROBOTS[robot][1]
    run, _ = against(play, robot, 5e3, height, speed)
    assert run.stopped
    assert "N against the travel is" in run.cause
    assert run.cause.endswith("there is an obstacle, in step 2 (track)")
    assert run.largest <= bound(run.config.limits.resultant_limit_n, robot, speed)
    assert run.result.left == "retracted, 0.0 N"
    assert run.differs() == []


@pytest.mark.parametrize("robot", ROBOTS)
def test_contact_loss_is_not_a_wall(play: Play, robot: str) -> None:
    """The surface falls away by 8 mm, and the tool waits and searches; there is no obstacle."""

    def drop(run: Trial, record: Any) -> None:
        if record.phase == "track" and not run.cell.faults:
            run.inject("surface", "hole", depth_mm=8.0, for_s=600.0)

    path = {"kind": "line", "length_mm": 10}
    track = {"do": "track", "path": path, "lateral_limit_n": LATERAL_N, "speed_mm_s": 5.0}
    run = play(
        robot,
        [{"do": "approach"}, track, {"do": "retract"}],
        {
            "cell": {"start_position_mm": (900.0, -100.0, 591.0)},
            "task": {"retract_mm": 4.0, "retract_speed_mm_s": 11.0, "search_depth_limit_mm": 12.0},
        },
        meddle=drop,
    )
    assert any(not record.in_contact for record in run.of(2))
    assert "stands in the way" not in run.cause
    assert run.result.outcome == "completed"
