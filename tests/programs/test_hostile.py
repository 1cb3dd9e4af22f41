"""Cells and computers that misbehave during a program."""

import re
from collections.abc import Callable
from typing import Any

import pytest

pytestmark = pytest.mark.sweep

Trial = Any
Play = Callable[..., Trial]
CELL = {
    "cell": {"start_position_mm": (900.0, -100.0, 591.0)},
    "task": {"retract_mm": 4.0, "retract_speed_mm_s": 11.0, "safe_height_mm": 2.0},
}
APPROACH, RETRACT = {"do": "approach"}, {"do": "retract"}
ROBOTS = pytest.mark.parametrize("robot", ["s3", "egm"])


def track(length_mm: float, **more: Any) -> dict[str, Any]:
    return {"do": "track", "path": {"kind": "line", "length_mm": length_mm}, "speed_mm_s": 5.0, **more}


def once(step: int, do: Callable[[Trial], object]) -> Callable[[Trial, Any], None]:
    """An event at the start of a step."""
    done: list[int] = []

    def meddle(run: Trial, record: Any) -> None:
        if record.step == step and not done:
            done.append(step)
            do(run)

    return meddle


@ROBOTS
def test_move_up_is_as_careful_as_approach(play: Play, robot: str) -> None:
    """An obstacle of 50 kN/m hangs 1 mm above the start, and the safe height is 2 mm above it."""
    move = {"do": "move", "to_mm": [5.0, 0.0]}
    obstacle = {"cell": {"obstacle": {"height_mm": 1.0, "stiffness_n_m": 5e4}}}
    run = play(robot, [move, APPROACH, RETRACT], CELL, obstacle)
    assert run.stopped
    assert run.cause.startswith("the tool touches something in free space, with ")
    assert run.largest <= run.config.limits.force_limit_n
    assert run.result.left.startswith("NOT retracted: left at -")
    message = re.search(
        r" mm, ([\d.]+) N, because (the force rose|a force of [\d.]+ N from behind met) ", run.result.left
    )
    assert message is not None
    assert float(message[1]) == pytest.approx(run.last, abs=1.0)
    assert run.differs() == []


@ROBOTS
def test_stroke_beyond_surface_ends(play: Play, robot: str) -> None:
    run = play(robot, [APPROACH, track(40.0), RETRACT], CELL, {"cell": {"surface": {"end_mm": -95.0}}})
    assert run.cause == "the surface ended: no contact within 5 mm, in step 2 (track)"
    assert (run.result.left, run.last) == ("retracted, 0.0 N", 0.0)
    lowest = min(state.position[2] for _, state in run.states)
    assert lowest > 0.588 - run.config.task.search_depth_limit_mm * 1e-3 - 1e-3
    assert run.differs() == []


@ROBOTS
def test_hold_on_receding_surface_does_not_dive(play: Play, robot: str) -> None:
    meddle = once(2, lambda run: run.inject("surface", "hole", depth_mm=20.0, for_s=600.0))
    run = play(robot, [APPROACH, {"do": "hold", "for_s": 9.0}, RETRACT], CELL, meddle=meddle)
    assert run.cause == "the surface ended: no contact within 5 mm, in step 2 (hold)"
    assert run.result.left == "retracted, 0.0 N"
    assert min(state.position[2] for _, state in run.states) > 0.590 - 8e-3


def test_approach_without_contact_fails(play: Play) -> None:
    run = play("s3", [{"do": "approach", "at_most_mm": 0.5}, RETRACT], CELL)
    assert run.cause.startswith("no contact found within 0.5 mm: ")
    assert run.cause.endswith(", in step 1 (approach)")
    assert run.largest == 0.0
    assert run.result.left == "retracted, 0.0 N"


@pytest.mark.parametrize(
    ("word", "step"),
    [("zero", {"do": "zero"}), ("seek", {"do": "seek", "direction_deg": 90.0, "at_most_mm": 10.0})],
)
@ROBOTS
def test_rising_surface_is_handled(play: Play, robot: str, word: str, step: dict[str, Any]) -> None:
    """It rises below a tool that is stationary or seeks along the surface."""
    rises = once(1, lambda run: run.inject("surface", "rises", mm_s=4.0, for_s=0.7))
    run = play(robot, [step, RETRACT], CELL, meddle=rises)
    assert run.largest < run.config.limits.force_limit_n
    assert run.last == 0.0
    if word == "zero":
        assert "would be used as the zero, allowed: at most 2 N" in run.cause
    assert run.differs() == []


@pytest.mark.parametrize(
    ("word", "steps"), [("track", [APPROACH, track(8.0)]), ("move", [APPROACH, RETRACT])]
)
def test_stalled_computer_ends_step(play: Play, word: str, steps: list[Any]) -> None:
    number = 2 if word == "track" else 3
    move = [{"do": "move", "to_mm": [8.0, 0.0], "speed_mm_s": 5.0}] if word == "move" else []
    run = play("s3", [*steps, *move, RETRACT], CELL, meddle=once(number, lambda run: run.run.stall(2.0)))
    assert "no decision for 2000 ms, allowed: at most 500 ms" in run.cause
    assert run.cause.endswith(f"in step {number} ({word})")
    assert run.last == 0.0


def test_limit_below_friction_never_blocks(play: Play) -> None:
    """2 N of friction, and limits of 1 N and 2.5 N."""
    trial = play("s3", [APPROACH, track(8.0, lateral_limit_n=0.2), RETRACT], CELL)
    assert trial.stopped
    assert "there is an obstacle, in step 2 (track)" in trial.cause
    slow = play("s3", [APPROACH, track(8.0, lateral_limit_n=2.5), RETRACT], CELL)
    assert slow.result.outcome == "completed"
    assert slow.cycles[-1].started_at - slow.cycles[0].started_at < 30.0


@pytest.mark.parametrize(
    "step",
    [
        {"do": "move", "to_mm": [20.0, 0.0]},
        {"do": "seek", "direction_deg": 0.0, "at_most_mm": 20.0},
    ],
)
def test_path_outside_workspace_is_refused(play: Play, step: dict[str, Any]) -> None:
    run = play("s3", [step, RETRACT], CELL, {"limits": {"workspace_max_m": (3.0, -0.095, 3.0)}})
    assert run.cycles == []
    assert run.cause.startswith("task.step 1 (")
    assert "outside the box of limits.workspace" in run.cause
