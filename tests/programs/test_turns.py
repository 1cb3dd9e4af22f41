"""The guard's rotation limits hold against wrong estimates and faulty robots."""

import math
from collections.abc import Callable
from typing import Any

import pytest

pytestmark = pytest.mark.sweep

Trial = Any
Play = Callable[..., Trial]
DOWN = (0.0, 1.0, 0.0, 0.0)
HALF = math.radians(5.0) / 2
ASKEW = (0.0, math.cos(HALF), 0.0, -math.sin(HALF))
APPROACH, RETRACT = {"do": "approach"}, {"do": "retract"}
QUICKLY = {"task": {"retract_mm": 4.0, "retract_speed_mm_s": 11.0}}
SPHERE = {"cell": {"start_position_mm": (900.0, -20.0, 590.0), "surface": {"kind": "sphere"}}}
FLAT = {
    "cell": {
        "start_quaternion": ASKEW,
        "start_position_mm": (900.0, 0.0, 592.0),
        "tool": {"face_radius_mm": 15.0},
    }
}
HOLD = {"do": "hold", "for_s": 2.5, "orientation": "normal"}
ROBOTS = pytest.mark.parametrize("robot", ["s3", "egm"])
SPEED = {"s3": 5.0, "egm": 20.0}


def axis(quaternion: tuple[float, ...]) -> tuple[float, float, float]:
    """The tool's z axis in the base frame."""
    w, x, y, z = quaternion
    return 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)


def apart_deg(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    cosine = sum(p * q for p, q in zip(axis(a), axis(b), strict=True))
    return math.degrees(math.acos(min(max(cosine, -1.0), 1.0)))


def tilt_deg(run: Trial, home: tuple[float, ...]) -> float:
    """Return the largest true tilt of the tool from its start."""
    return max(apart_deg(state.quaternion, home) for _, state in run.states)


def in_step(number: int, target: str, fault: str, **how: object) -> Callable[[Trial, Any], None]:
    """A fault from the first cycle of a step on."""

    def meddle(run: Trial, record: Any) -> None:
        if record.step == number and not run.cell.faults:
            run.inject(target, fault, **how)

    return meddle


WRONG: dict[str, tuple[str, dict[str, object]]] = {
    "Fx too much": ("offset", {"axis": "fx", "amount": 8.0}),
    "Fx far too large": ("scale", {"axis": "fx", "factor": -8.0}),
    "Fy too little": ("offset", {"axis": "fy", "amount": -9.0}),
    "turned by a quarter": ("turned", {"degrees": 90.0}),
    "Fx and Fy exchanged": ("swapped", {"axis": "fx", "other": "fy"}),
    "noise": ("noise", {"factor": 300.0}),
}


@pytest.mark.parametrize(
    ("robot", "name"), [*(("s3", name) for name in WRONG), *(("egm", name) for name in list(WRONG)[::2])]
)
def test_wrong_force_tilt_is_limited(play: Play, robot: str, name: str) -> None:
    fault, how = WRONG[name]
    path = {"kind": "line", "length_mm": 30}
    track = {"do": "track", "path": path, "speed_mm_s": SPEED[robot], "orientation": "normal"}

    def meddle(run: Trial, record: Any) -> None:
        if record.travel_commanded > 5e-3 and not run.cell.faults:
            run.inject("signal", fault, **how)

    limits = {"limits": {"turn_total_deg": 12.0}}
    run = play(robot, [APPROACH, track, RETRACT], SPHERE, QUICKLY, limits, meddle=meddle)
    assert run.cell.faults[0].struck > 0
    assert tilt_deg(run, DOWN) <= 12.0 + 0.2
    assert run.largest < run.config.limits.force_limit_n
    assert run.last == 0.0
    assert run.differs() == []


@ROBOTS
def test_wrong_moment_tilt_is_limited(play: Play, robot: str) -> None:
    run = play(
        robot,
        [APPROACH, HOLD, RETRACT],
        FLAT,
        QUICKLY,
        {"limits": {"turn_total_deg": 8.0}},
        meddle=in_step(2, "signal", "offset", axis="my", amount=1.0),
    )
    assert "tilted by more than 8°" in run.clamps()
    assert tilt_deg(run, ASKEW) == pytest.approx(8.0, abs=1.9)
    assert tilt_deg(run, ASKEW) <= 8.0 + 0.2
    assert run.last == 0.0


@ROBOTS
def test_total_tilt_is_limited(play: Play, robot: str) -> None:
    run = play(robot, [APPROACH, HOLD, RETRACT], FLAT, QUICKLY, {"limits": {"turn_total_deg": 3.0}})
    assert "tilted by more than 3°" in run.clamps()
    assert 1.0 < tilt_deg(run, ASKEW) <= 3.0 + 0.2
    assert run.result.outcome == "completed"


@pytest.mark.parametrize("where", ["run", "step"])
@ROBOTS
def test_turn_rate_is_limited(play: Play, robot: str, where: str) -> None:
    """Over half a second and more: within a cycle the S3 turns at its own speed."""
    limit = {"limits": {"turn_deg_s": 2.0}}
    hold, run_wide = ({**HOLD, **limit}, {}) if where == "step" else (HOLD, limit)
    run = play(robot, [APPROACH, hold, RETRACT], FLAT, QUICKLY, run_wide)
    states = run.states
    rates = []
    for k in range(0, len(states), 5):
        later = next((j for j in range(k, len(states)) if states[j][0] >= states[k][0] + 0.7), None)
        if later is not None:
            (a, before), (b, after) = states[k], states[later]
            rates.append(apart_deg(before.quaternion, after.quaternion) / (b - a))
    slack = 1.4 if robot == "s3" else 1.05
    assert 1.0 < max(rates) <= 2.0 * slack
    assert not any("turned faster" in reason for reason in run.clamps())


@pytest.mark.full
def test_robot_without_reported_turn_is_stopped(play: Play) -> None:
    """Its reported pose does not change while it is ordered to turn and to press."""
    run = play("egm", [APPROACH, HOLD, RETRACT], FLAT, QUICKLY, meddle=in_step(2, "pose", "frozen"))
    assert run.stopped
    assert "behind all that was ordered" in run.cause
    assert "in step 2 (hold)" in run.cause
    assert tilt_deg(run, ASKEW) < 2.0 + 10.0 * 0.5 + 0.5
    assert run.last < 1.0


@pytest.mark.parametrize("robot", ["s3", "rsi"])
def test_robot_with_wrong_turn_is_stopped(play: Play, robot: str) -> None:
    """It reports an orientation different from the ordered one."""
    meddle = in_step(2, "pose", "turned", degrees=12.0, axis="x")
    run = play(robot, [APPROACH, HOLD, RETRACT], FLAT, QUICKLY, meddle=meddle)
    assert run.stopped
    assert "the robot reports a tool turned by " in run.cause
    assert run.cause.endswith("in step 2 (hold)")
    assert run.last == 0.0
    assert run.differs() == []
