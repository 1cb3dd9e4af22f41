"""A program interrupted in each kind of step: the tool is retracted, or stops, and the text reports the position."""

import re
from collections.abc import Callable
from typing import Any

import pytest

pytestmark = pytest.mark.sweep

Trial = Any
Play = Callable[..., Trial]
APPROACH, RETRACT = {"do": "approach"}, {"do": "retract"}
LINE = {"kind": "line", "length_mm": 6}
TRACK = {"do": "track", "path": LINE, "speed_mm_s": 5.0, "orientation": "normal"}
MOVE = {"do": "move", "to_mm": [8.0, 0.0], "speed_mm_s": 5.0}
ZERO = {"do": "zero", "settle_ms": 600.0, "for_ms": 400.0}
STEPS: dict[str, tuple[int, list[dict[str, Any]]]] = {
    "approach": (1, [APPROACH, RETRACT]),
    "track": (2, [APPROACH, TRACK, RETRACT]),
    "hold": (2, [APPROACH, {"do": "hold", "for_s": 2.0}, RETRACT]),
    "seek": (1, [{"do": "seek", "direction_deg": 90.0, "at_most_mm": 8.0}, RETRACT]),
    "move": (1, [MOVE, RETRACT]),
    "zero": (1, [ZERO, APPROACH, RETRACT]),
    "retract": (2, [APPROACH, RETRACT, MOVE, RETRACT]),
}
"""By word: the step that is interrupted, and the program around it."""
PRESSING = {"track", "hold"}
CELL = {
    "cell": {"start_position_mm": (900.0, -100.0, 591.5)},
    "task": {"retract_mm": 4.0, "retract_speed_mm_s": 5.5, "safe_height_mm": 1.0},
    "limits": {"retract_patience_s": 0.5},
}
EMERGENCY = {"s3": "emergency-stop", "egm": "motors-off"}
EACH = pytest.mark.parametrize("word", STEPS)
ROBOTS = pytest.mark.parametrize("robot", ["s3", "egm"])


def cut(play: Play, robot: str, word: str, how: Callable[[Trial], object]) -> Trial:
    """Run that is interrupted 0.4 s after the start of the step; it never pressed hard, and its replay is the same."""
    number, steps = STEPS[word]
    starts: list[float] = []

    def meddle(run: Trial, record: Any) -> None:
        if record.step == number and not (starts and starts[-1] < 0.0):
            starts.append(record.started_at)
            if record.started_at - starts[0] >= 0.4:
                starts.append(-1.0)
                how(run)

    run = play(robot, steps, CELL, meddle=meddle)
    assert starts[-1] == -1.0, "the step was reached"
    assert run.largest < 16.0
    assert run.differs() == []
    (step,) = [step for step in run.steps if step.step == number]
    assert not step.passed
    assert step.label == f"{number} ({word})"
    return run


def check_left(run: Trial) -> None:
    """Check that the last line is true."""
    left = run.result.left
    if left.startswith("retracted"):
        assert run.last == 0.0
        assert left.removesuffix(" (Fx Fy not verified)") == "retracted, 0.0 N"
        return
    reported = re.match(
        r"NOT retracted: left at (?:an unknown depth|(-?[\d.]+) mm), (?:(-?[\d.]+) N|force unknown)", left
    )
    assert reported is not None, left
    if reported[2] is not None:
        assert float(reported[2]) == pytest.approx(run.last, abs=0.5)
    if reported[1] is not None:
        start = run.cycles[0].sample.position[2]
        z = run.states[-1][1].position[2]
        assert float(reported[1]) == pytest.approx((start - z) * 1e3, abs=1.2)


@EACH
@ROBOTS
def test_interruption_retracts(play: Play, robot: str, word: str) -> None:
    run = cut(play, robot, word, lambda run: run.run.interrupt())
    assert run.result.outcome == "interrupted"
    assert run.result.left.removesuffix(" (Fx Fy not verified)") == "retracted, 0.0 N"
    assert run.last == 0.0
    start = run.cycles[0].sample.position[2]
    assert run.states[-1][1].position[2] >= start - 0.3e-3


@EACH
@ROBOTS
def test_emergency_stop_leaves_tool_in_position(play: Play, robot: str, word: str) -> None:
    run = cut(play, robot, word, lambda run: run.inject("robot", EMERGENCY[robot]))
    assert run.stopped
    number, _ = STEPS[word]
    assert f"in step {number} ({word})" in run.cause
    assert ("emergency stop" if robot == "s3" else "the motors are off") in run.cause
    stands(run)
    check_left(run)
    assert (run.last > 5.0) == (word in PRESSING)


@EACH
@ROBOTS
def test_lost_link_leaves_tool_in_position(play: Play, robot: str, word: str) -> None:
    run = cut(play, robot, word, lambda run: run.inject("wire", "off", for_s=600.0))
    assert run.stopped
    assert ("nothing received after 3 bids" if robot == "s3" else "sent nothing for 0.5 s") in run.cause
    stands(run)
    check_left(run)
    assert (run.last > 5.0) == (word in PRESSING)


@EACH
@ROBOTS
def test_silent_sensor_retracts_a_little(play: Play, robot: str, word: str) -> None:
    """It goes back to the depth of the start, or a little behind the contact, and no farther."""
    run = cut(play, robot, word, lambda run: run.inject("sensor-wire", "off", for_s=600.0))
    assert run.stopped
    number, _ = STEPS[word]
    reported = (
        "the force needed to retract the tool is unknown" if word == "retract" else "the newest force is"
    )
    assert reported in run.cause
    assert run.cause.endswith(f"in step {number} ({word})")
    assert run.last == 0.0
    check_left(run)
    assert run.result.left.startswith("NOT retracted: left at ")
    assert "force unknown" in run.result.left
    start = run.cycles[0].sample.position[2]
    z = run.states[-1][1].position[2]
    assert start - 0.3e-3 <= z <= start + run.config.limits.blind_retract_mm * 1e-3


def stands(run: Trial) -> None:
    assert run.states[-1][1].velocity == pytest.approx((0.0, 0.0, 0.0), abs=5e-3)
