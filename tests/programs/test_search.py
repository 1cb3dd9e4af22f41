"""Steps that search for something, and moves with an unexpected touch."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hil_bridge.errors import Cause

pytestmark = pytest.mark.sweep

Trial = Any
Play = Callable[..., Trial]
WALL_N_M = 5e4
START = {"cell": {"start_position_mm": (900.0, -100.0, 591.0)}}
QUICKLY = {"task": {"retract_mm": 4.0, "retract_speed_mm_s": 11.0, "safe_height_mm": 1.0}}
APPROACH, RETRACT = {"do": "approach"}, {"do": "retract"}
ROBOTS = {"s3": (5.0, 0.18), "egm": (14.0, 0.012)}
"""Speed of a move, mm/s, and the cycle, s."""
EACH = pytest.mark.parametrize("robot", ROBOTS)


def surface(**more: Any) -> dict[str, Any]:
    return {"cell": {"surface": more}}


@EACH
def test_seek_finds_wall_by_force(play: Play, robot: str) -> None:
    """The wall is 5 mm away, and the tool is in free space, 1 mm above the surface."""
    seek = {"do": "seek", "direction_deg": 0.0, "name": "wall", "at_most_mm": 20.0, "back_off_mm": 1.0}
    run = play(robot, [seek, RETRACT], START, QUICKLY, surface(wall_at_mm=-95.0))
    assert (run.result.outcome, run.result.left) == ("completed", "retracted, 0.0 N")
    (position,) = [step for step in run.steps if step.name == "wall"]
    assert position.found[1] * 1e3 == pytest.approx(-95.0, abs=0.5)
    assert run.of(1)[-1].sample.position[1] * 1e3 == pytest.approx(-96.0, abs=0.7)
    assert run.largest < 30.0
    assert run.differs() == []


@EACH
def test_seek_finds_edge_by_contact_loss(play: Play, robot: str) -> None:
    seek = {
        "do": "seek", "until": "edge", "direction_deg": 0.0, "name": "edge", "at_most_mm": 30.0, "speed_mm_s": 5.0,
    }  # fmt: skip
    run = play(robot, [APPROACH, seek, RETRACT], START, QUICKLY, surface(end_mm=-90.0))
    assert (run.result.outcome, run.result.left) == ("completed", "retracted, 0.0 N")
    (position,) = [step for step in run.steps if step.name == "edge"]
    assert position.found[1] * 1e3 == pytest.approx(-90.0, abs=1.0)
    lowest = min(state.position[2] for _, state in run.states)
    assert lowest > 0.5875 - 5e-3, "the tool does not dive behind the edge"
    assert run.differs() == []


NOTHING: dict[str, tuple[list[dict[str, Any]], str]] = {
    "wall": (
        [{"do": "seek", "direction_deg": 0.0, "at_most_mm": 5.0}],
        "no obstacle within 5 mm, in step 1",
    ),
    "edge": (
        [APPROACH, {"do": "seek", "until": "edge", "direction_deg": 0.0, "at_most_mm": 5.0}],
        "no edge within 5 mm, in step 2",
    ),
}


@pytest.mark.parametrize("what", NOTHING)
def test_seek_without_result_fails_step(play: Play, what: str) -> None:
    steps, message = NOTHING[what]
    run = play("s3", [*steps, RETRACT], START, QUICKLY)
    assert run.stopped
    assert run.cause == f"{message} (seek)"
    assert run.result.cause in (Cause.NOT_FOUND, Cause.NO_EDGE)
    assert run.result.left.removesuffix(" (Fx Fy not verified)") == "retracted, 0.0 N"
    assert not run.steps[-1].passed


@EACH
def test_move_into_wall_stops_and_returns(play: Play, robot: str) -> None:
    """The safe height is below the top of the wall."""
    speed, cycle = ROBOTS[robot]
    move = {"do": "move", "to_mm": [30.0, 0.0], "speed_mm_s": speed}
    run = play(robot, [move, RETRACT], START, QUICKLY, surface(wall_at_mm=-95.0, wall_height_mm=10.0))
    assert run.stopped
    assert run.cause.startswith("the tool touches something in free space, with ")
    assert run.cause.endswith("in step 1 (move)")
    assert run.largest <= run.config.limits.resultant_limit_n + WALL_N_M * speed * 1e-3 * cycle * 3
    assert run.result.left == "retracted, 0.0 N"
    assert run.last == 0.0
    assert max(state.position[1] for _, state in run.states) < -0.095 + 2e-3
    assert run.differs() == []


@EACH
def test_move_passes_wall_below_safe_height(play: Play, robot: str) -> None:
    steps = [APPROACH, RETRACT, {"do": "move", "to_mm": [15.0, -5.0], "speed_mm_s": 20.0}]
    run = play(
        robot, steps, START, {"task": {"safe_height_mm": 3.0, "retract_speed_mm_s": 11.0, "retract_mm": 4.0}},
        surface(wall_at_mm=-92.0, wall_height_mm=2.0),
    )  # fmt: skip
    assert run.result.outcome == "completed"
    is_moving = run.times > run.of(3)[0].started_at
    assert np.abs(run.forces[is_moving]).max() == 0.0
    x, y, z = run.states[-1][1].position
    assert (x, y) == pytest.approx((0.905, -0.085), abs=0.6e-3)
    assert z >= 0.591 + 3e-3 - 1e-4
    assert "move" in run.phases()


def test_repeat_makes_all_passes(play: Play) -> None:
    path = {"kind": "line", "length_mm": 5}
    inner = [APPROACH, {"do": "track", "path": path}, RETRACT, {"do": "move", "to_mm": [0.0, 0.0]}]
    run = play("s3", [{"do": "repeat", "times": 3, "step": inner}], START, QUICKLY)
    assert run.result.outcome == "completed"
    tracks = [step for step in run.steps if "track" in step.label]
    assert [step.label for step in tracks] == [f"1.2 (track, pass {n})" for n in (1, 2, 3)]
    assert [step.step for step in tracks] == [2, 6, 10]
    assert all(step.way == pytest.approx(5e-3, abs=1e-3) for step in tracks)
    starts = [run.of(step.step)[0].sample.position[1] for step in tracks]
    assert starts == pytest.approx([-0.1] * 3, abs=0.6e-3)
    assert run.differs() == []
