"""A program that is cut in each kind of step: the tool is retracted, or stands still, and the text says where."""

import re
from collections.abc import Callable
from typing import Any

import pytest

pytestmark = pytest.mark.sweep

Played = Any
Play = Callable[..., Played]
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
"""By its word: the step that is cut, and the program around it."""
PRESSING = {"track", "hold"}
CELL = {
    "cell": {"start_position_mm": (900.0, -100.0, 591.5)},
    "task": {"retract_mm": 4.0, "retract_speed_mm_s": 5.5, "safe_height_mm": 1.0},
    "limits": {"retract_patience_s": 0.5},
}
EMERGENCY = {"s3": "emergency-stop", "egm": "motors-off"}
EACH = pytest.mark.parametrize("word", STEPS)
ROBOTS = pytest.mark.parametrize("robot", ["s3", "egm"])


def cut(play: Play, robot: str, word: str, how: Callable[[Played], object]) -> Played:
    """The run that is cut 0.4 s after the begin of the step; it never pressed much, and its replay is the same."""
    number, steps = STEPS[word]
    begun: list[float] = []

    def meddle(run: Played, record: Any) -> None:
        if record.step == number and not (begun and begun[-1] < 0.0):
            begun.append(record.started_at)
            if record.started_at - begun[0] >= 0.4:
                begun.append(-1.0)
                how(run)

    run = play(robot, steps, CELL, meddle=meddle)
    assert begun[-1] == -1.0, "the step came"
    assert run.largest < 16.0
    assert run.differs() == []
    (step,) = [step for step in run.steps if step.step == number]
    assert not step.passed
    assert step.label == f"{number} ({word})"
    return run


def check_left(run: Played) -> None:
    """The last line tells the truth."""
    left = run.result.left
    if left.startswith("retracted"):
        assert run.last == 0.0
        assert left.removesuffix(" (Fx Fy not verified)") == "retracted, 0.0 N"
        return
    told = re.match(
        r"NOT retracted: left at (?:an unknown depth|(-?[\d.]+) mm), (?:(-?[\d.]+) N|force unknown)", left
    )
    assert told is not None, left
    if told[2] is not None:
        assert float(told[2]) == pytest.approx(run.last, abs=0.5)
    if told[1] is not None:
        start = run.cycles[0].sample.position[2]
        z = run.states[-1][1].position[2]
        assert float(told[1]) == pytest.approx((start - z) * 1e3, abs=1.2)


@EACH
@ROBOTS
def test_an_interruption_retracts(play: Play, robot: str, word: str) -> None:
    run = cut(play, robot, word, lambda run: run.run.interrupt())
    assert run.result.outcome == "interrupted"
    assert run.result.left.removesuffix(" (Fx Fy not verified)") == "retracted, 0.0 N"
    assert run.last == 0.0
    start = run.cycles[0].sample.position[2]
    assert run.states[-1][1].position[2] >= start - 0.1e-3


@EACH
@ROBOTS
def test_an_emergency_stop_leaves_the_tool_where_it_is(play: Play, robot: str, word: str) -> None:
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
def test_a_link_that_is_lost_leaves_the_tool_where_it_is(play: Play, robot: str, word: str) -> None:
    run = cut(play, robot, word, lambda run: run.inject("wire", "off", for_s=600.0))
    assert run.stopped
    assert ("nothing came after 3 bids" if robot == "s3" else "sent nothing for 0.5 s") in run.cause
    stands(run)
    check_left(run)
    assert (run.last > 5.0) == (word in PRESSING)


@EACH
@ROBOTS
def test_a_sensor_that_falls_silent_lets_the_tool_back_a_little(play: Play, robot: str, word: str) -> None:
    """It goes back to the depth of the start, or a little behind the contact, and no farther."""
    run = cut(play, robot, word, lambda run: run.inject("sensor-wire", "off", for_s=600.0))
    assert run.stopped
    number, _ = STEPS[word]
    told = "tells no force to retract the tool by" if word == "retract" else "the newest force is"
    assert told in run.cause
    assert run.cause.endswith(f"in step {number} ({word})")
    assert run.last == 0.0
    check_left(run)
    assert run.result.left.startswith("NOT retracted: left at ")
    assert "force unknown" in run.result.left
    start = run.cycles[0].sample.position[2]
    z = run.states[-1][1].position[2]
    assert start - 0.3e-3 <= z <= start + run.config.limits.blind_retract_mm * 1e-3


def stands(run: Played) -> None:
    assert run.states[-1][1].velocity == pytest.approx((0.0, 0.0, 0.0), abs=0.2e-3)
