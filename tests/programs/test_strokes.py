"""Strokes whose force, side, speed and orientation change along the path."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from hil_bridge.cli import cli
from hil_bridge.errors import BridgeError

pytestmark = pytest.mark.sweep

Trial = Any
Play = Callable[..., Trial]
START = {
    "cell": {"start_position_mm": (900.0, -100.0, 591.0)},
    "task": {"retract_mm": 4.0, "retract_speed_mm_s": 11.0},
}
APPROACH, RETRACT = {"do": "approach"}, {"do": "retract", "back_mm": 8.0}
LINE = {"kind": "line", "length_mm": 24}
ROBOTS = pytest.mark.parametrize("robot", ["s3", "egm"])


def stroke(**more: Any) -> list[dict[str, Any]]:
    return [APPROACH, {"do": "track", "path": LINE, "speed_mm_s": 5.0, **more}, RETRACT]


def late(run: Trial, share: float) -> Any:
    """True forces (n, 3) of the last share of step 2, base frame, N."""
    records = run.of(2)
    since = records[int(len(records) * (1.0 - share))].started_at
    return run.forces[(run.times > since) & (run.times < records[-1].started_at)]


@pytest.mark.parametrize(("robot", "speed", "off"), [("s3", 2.0, 1.5), ("egm", 5.0, 0.6)])
def test_force_profile_is_followed(play: Play, robot: str, speed: float, off: float) -> None:
    profile = [[0, 5], [8, 5], [16, 13], [20, 13], [24, 9]]
    run = play(
        robot,
        stroke(force_n=profile, speed_mm_s=speed, criterion={"within_n": off, "for_percent": 80}),
        START,
    )
    assert run.result.outcome == "completed"
    distances, newtons = zip(*profile, strict=True)
    for record in run.of(2):
        expected = np.interp((record.travel_commanded - 0.0) * 1e3, distances, newtons)
        assert record.force_reference == pytest.approx(expected, abs=0.5 + speed * 0.18)
    errors = [record.force - record.force_reference for record in run.of(2) if record.travel_commanded > 5e-3]
    assert max(map(abs, errors)) < 2 * off
    (step,) = [step for step in run.steps if step.step == 2]
    assert step.passed
    assert step.within >= 0.8
    assert step.text.startswith(f"force within ±{off:g} N: ")
    assert run.differs() == []


WALL = {"cell": {"surface": {"wall_at_mm": 3.0, "path_deg": 0.0, "wall_height_mm": 3.0}}}
"""3 mm to the right of the path, with a face of 50 kN/m."""


@ROBOTS
def test_compliant_axis_yields_to_wall(play: Play, robot: str) -> None:
    """The path leads 1.2 mm into the wall: on the path the tool would push with 60 N."""
    path = {**LINE, "direction_deg": -10.0}
    run = play(robot, stroke(path=path, across="compliant", across_n_mm=5.0), START, WALL)
    assert (run.result.outcome, run.result.left) == ("completed", "retracted, 0.0 N")
    aside = late(run, 0.2)[:, 0]
    assert -12.0 < aside.mean() < -1.0
    assert np.abs(run.forces[:, 0]).max() < 30.0
    assert max(state.position[0] for _, state in run.states) < 0.903 + 0.6e-3
    assert run.differs() == []


@pytest.mark.parametrize(("robot", "off"), [("s3", 3.1), ("egm", 0.3)])
def test_across_force_is_held_at_wall(play: Play, robot: str, off: float) -> None:
    """5 N to the right, in addition to 10 N into the surface. One step of the S3's position is 3.1 N on the wall."""
    run = play(robot, stroke(across="force", across_n=-5.0), START, WALL)
    assert (run.result.outcome, run.result.left) == ("completed", "retracted, 0.0 N")
    forces = late(run, 0.3)
    assert forces[:, 0].mean() == pytest.approx(-5.0, abs=off)
    assert forces[:, 2].mean() == pytest.approx(10.0, abs=0.6)
    assert run.differs() == []


@ROBOTS
def test_tool_at_wall_retracts_after_hold(play: Play, robot: str) -> None:
    """The hold controls no lateral force, but the tool still presses against the wall that the track met."""
    leaning = stroke(across="force", across_n=-15.0)
    run = play(robot, [*leaning[:-1], {"do": "hold", "for_s": 1.0}, RETRACT], START, WALL)
    assert (run.result.outcome, run.result.left) == ("completed", "retracted, 0.0 N")
    holding, lifted = run.of(3)[-1].across_commanded, run.of(4)[-1].across_commanded
    assert abs(holding) > 2e-3, "it has reached the wall"
    assert lifted > holding + 0.5e-3
    assert run.differs() == []


def test_across_force_without_wall_is_limited(play: Play) -> None:
    run = play("s3", stroke(across="force", across_n=-5.0, across_mm=2.0), START)
    assert run.result.outcome == "completed"
    assert min(record.across_commanded for record in run.cycles) == pytest.approx(-2e-3, abs=1e-6)


CORNER = {"kind": "polyline", "points_mm": [[0, 0], [2, 0], [2, 10]]}


@ROBOTS
def test_tool_is_oriented_along_path(play: Play, robot: str) -> None:
    """Along an arc of 60°, whose straight pieces are 9° apart."""
    arc = {"kind": "arc", "centre_mm": [0, 15], "angle_deg": 60}
    run = play(robot, stroke(path=arc, speed_mm_s=2.2, orientation="along-path"), START)
    assert run.result.outcome == "completed"
    for at, state in run.states:
        if run.of(2)[5].started_at < at < run.of(2)[-1].started_at:
            x, y, _ = state.position
            goes = math.degrees(math.atan2(y + 0.1, x - 0.885))
            assert yaw(state.quaternion) == pytest.approx(goes, abs=11.0)
    assert yaw(run.states[-1][1].quaternion) == pytest.approx(60.0, abs=11.0)
    assert run.differs() == []


def test_tool_turn_rate_at_corner_is_limited(play: Play) -> None:
    """The path after the corner takes 5 s, and the turn 4.5 s."""
    run = play(
        "egm",
        stroke(path=CORNER, speed_mm_s=2.0, orientation="along-path"),
        START,
        {"limits": {"turn_deg_s": 20.0}},
    )
    assert run.result.outcome == "completed"
    assert yaw(run.of(2)[-1].sample.quaternion) == pytest.approx(90.0, abs=3.0)
    at = {record.cycle: (record.started_at, yaw(record.sample.quaternion)) for record in run.of(2)}
    for cycle, (time, angle) in at.items():
        if cycle + 20 in at:
            later, turned = at[cycle + 20]
            assert abs((turned - angle + 180) % 360 - 180) / (later - time) <= 20.0 * 1.05


def yaw(quaternion: tuple[float, ...]) -> float:
    """Turn about base z from a tool that points down, °."""
    _, x, y, _ = quaternion
    return math.degrees(2 * math.atan2(y, x))


WAVES = {
    "cell": {
        "start_position_mm": (900.0, -100.0, 593.0),
        "surface": {"kind": "sinusoidal", "amplitude_mm": 2.0, "period_mm": 20.0, "origin_y_mm": -100.0},
    }
}


@pytest.mark.full
def test_feed_falls_with_force_error(play: Play) -> None:
    """Waves of 32° at their steepest: with the override slower, and with less error."""
    plain = play("egm", stroke(speed_mm_s=20.0), START, WAVES)
    slower = play("egm", stroke(speed_mm_s=20.0, feed_error_n=4.0), START, WAVES)
    assert plain.result.outcome == slower.result.outcome == "completed"
    feeds = [record.explanation.get("feed", 1.0) for record in slower.of(2)]
    assert min(feeds) < 0.5
    assert slower.rms(2, 3.0) < 0.8 * plain.rms(2, 3.0)
    assert len(slower.of(2)) > 1.3 * len(plain.of(2))


@ROBOTS
def test_step_stops_at_its_own_limit(play: Play, robot: str) -> None:
    tight = {"limits": {"moment_limit_nm": 0.2}}
    run = play(robot, stroke(**tight), START)
    assert run.stopped
    assert run.cause.startswith("moment 0.2")
    assert run.cause.endswith("N·m is beyond 0.2 N·m, in step 2 (track)")
    assert run.result.left == "retracted, 0.0 N"


PROGRAM = """
[cell]
start_position_mm = [900.0, -100.0, 591.0]
[task]
retract_mm = 4.0
[[task.step]]
do = "approach"
[[task.step]]
do = "track"
path = {{ kind = "line", length_mm = 12 }}
criterion = {{ within_n = {within}, for_percent = 60 }}
[[task.step]]
do = "retract"
"""


@pytest.mark.parametrize(("within", "code"), [(2.0, 0), (0.01, 4)])
def test_criterion_determines_exit_code(tmp_path: Path, within: float, code: int) -> None:
    config, record = tmp_path / "c.toml", tmp_path / "r.mcap"
    summary = tmp_path / "s.json"
    config.write_text(PROGRAM.format(within=within))
    files = ["--record", str(record), "--summary", str(summary)]
    try:
        arguments = ["run", str(config), "--virtual", "--no-view", *files]
        result = CliRunner().invoke(cli, arguments, catch_exceptions=False)
        exit_code, reported = result.exit_code, result.output
    except BridgeError as error:
        exit_code, reported = error.exit_code, str(error)
    assert exit_code == code, reported
    if code:
        assert "2 (track)" in reported
    steps = json.loads(summary.read_text())["steps"]
    assert [bool(step["passed"]) for step in steps] == [True, code == 0, True]
    replayed = CliRunner().invoke(cli, ["replay", str(record)], catch_exceptions=False)
    assert (replayed.exit_code, "every command identical" in replayed.output) == (0, True)
