"""A sensor without response during the approach: how deep the tool moves, and how the run ends."""

import re
from collections.abc import Callable
from typing import Any

import pytest

import hil_bridge
from hil_bridge.record import Outcome
from hil_bridge.settings.configuration import Config
from tests.near_surface import awake_config

pytestmark = pytest.mark.sweep

Guarded = Any
Run = Callable[..., Guarded]

ROBOTS = pytest.mark.parametrize("robot", ["s3", "egm"])
CELLS = pytest.mark.parametrize(("robot", "stiffness"), [("s3", 5e4), ("egm", 5e3)])
"""The slowest line over a hard surface, where a late stop presses hardest, and a quick one over a soft surface."""
QUICK: dict[str, dict[str, Any]] = {
    "run": {"period_ms": 20},
    "controller": {"sample_ms": 20},
    "robot": {"emulated": "egm"},
    "sensor": {"emulated": "netft"},
}
TOUCHES_S = 0.95
"""Approximate time of touch of a healthy approach from 2 mm, after its start, s."""


def approach(robot: str, stiffness: float, *faults: dict[str, Any], **more: Any) -> Config:
    """A second of tracking from 2 mm above a surface; `more` are settings of sections."""
    values: dict[str, Any] = {
        name: dict(section) for name, section in (QUICK if robot == "egm" else {}).items()
    }
    values["run"] = {**values.get("run", {}), "duration_s": 1.0}
    surface = {"stiffness_n_m": stiffness}
    values["cell"] = {"surface": surface, "start_position_mm": (900.0, -100.0, 592.0)}
    values["task"] = {"retract_speed_mm_s": 20.0, "retract_mm": 3.0}
    values["faults"] = list(faults)
    for name, section in more.items():
        values[name] = {**values.get(name, {}), **section}
    return awake_config(values)


def strikes(name: str, after_s: float, **how: Any) -> dict[str, Any]:
    """A fault of the sensor's signal that comes in the approach and does not end."""
    return {
        "on": "signal",
        "fault": name,
        "phase": "approach",
        "after_s": after_s,
        "for_s": 600.0,
        "with": how,
    }


@CELLS
@pytest.mark.parametrize("early_s", [0.6, 0.1])
def test_stuck_sensor_ends_approach_within_1_mm(
    guarded: Run, robot: str, stiffness: float, early_s: float
) -> None:
    config = approach(robot, stiffness, strikes("stuck", TOUCHES_S - early_s))
    run = guarded(config)
    assert run.result.outcome is Outcome.STOPPED
    slack_mm = 0.75  # a cycle of the slowest line, and the motion already ordered
    assert run.largest <= stiffness * (config.limits.unchanged_mm + slack_mm) * 1e-3
    assert "repeated the same counts" in run.cause
    assert "through free space" in run.cause


@CELLS
@pytest.mark.parametrize("axis", ["fz", "all"])
@pytest.mark.parametrize("early_s", [0.5, 0.1, -0.05])
def test_dying_axis_is_not_a_touch(
    guarded: Run, robot: str, stiffness: float, axis: str, early_s: float
) -> None:
    """The axis reports the missing weight as a contact force, which does not rise with depth."""
    run = guarded(approach(robot, stiffness, strikes("dead", TOUCHES_S - early_s, axis=axis)))
    assert run.result.outcome is Outcome.STOPPED
    assert run.largest <= max(10.0, stiffness * 1.7e-3)
    assert run.last == 0.0
    assert "the force does not respond" in run.cause or "after the retraction" in run.cause


@CELLS
def test_dying_axis_is_not_a_touch_in_program(guarded: Run, robot: str, stiffness: float) -> None:
    """Its first moments of tracking are watched as those of a run without steps."""
    path = {"kind": "line", "length_mm": 50.0}
    steps = [{"do": "approach"}, {"do": "track", "path": path, "for_s": 1.0}, {"do": "retract"}]
    dies = strikes("dead", TOUCHES_S + 0.05, axis="fz")
    run = guarded(approach(robot, stiffness, dies, task={"step": steps}))
    assert run.result.outcome is Outcome.STOPPED
    assert run.largest <= max(10.0, stiffness * 1.7e-3)
    assert run.last == 0.0
    assert "the force does not respond" in run.cause or "after the retraction" in run.cause


@CELLS
def test_pull_in_free_space_ends_approach(guarded: Run, robot: str, stiffness: float) -> None:
    """The zero is off by less than `limits.pull_limit_n`: the tool would press on in search of the force it has."""
    run = guarded(approach(robot, stiffness, strikes("offset", 0.3, axis="fz", amount=3.0)))
    assert re.search(r"a pull of 3\.[01] N", run.cause)  # 3 N, the arm's vibration and the noise
    assert "it lost the tool's weight" in run.cause
    assert run.largest <= stiffness * 0.5e-3


@ROBOTS
def test_approach_without_surface_is_short(guarded: Run, robot: str) -> None:
    config = approach(
        robot, 5e3, cell={"surface": {"height_mm": 400.0}, "start_position_mm": (900.0, -100.0, 592.0)}
    )
    run = guarded(config)
    assert run.cause.startswith(
        "no contact found within 15 mm: start nearer, set task.approach_depth_limit_mm"
    )
    assert max(record.depth for record in run.cycles) <= 15.2e-3


@ROBOTS
@pytest.mark.parametrize("stiffness", [8e2, 5e3, 5e4])
def test_healthy_touch_is_accepted(guarded: Run, robot: str, stiffness: float) -> None:
    """Also if the desired force equals the weight of the tool."""
    for force_n in (10.0, 4.9):
        task = {"force_n": force_n, "expected_stiffness_n_m": max(stiffness, 5e3)}
        run = guarded(approach(robot, stiffness, task=task))
        assert run.result.outcome is Outcome.COMPLETED, run.cause


@pytest.mark.parametrize(
    "sensor", ["jr3", "jr3-uart", "jr3-board", "netft", "ati-can", "ft300", "ft300-urcap"]
)
@pytest.mark.parametrize("speed_mm_s", [0.9, 11.0])
def test_quiet_sensor_is_not_reported_as_stuck(sensor: str, speed_mm_s: float) -> None:
    result = hil_bridge.simulate(
        {
            **QUICK,
            "run": {"period_ms": 20, "duration_s": 0.2},
            "sensor": {"emulated": sensor},
            "cell": {"start_position_mm": [900.0, -100.0, 592.0], "surface": {"stiffness_n_m": 1e3}},
            "task": {
                "approach_speed_mm_s": speed_mm_s,
                "expected_stiffness_n_m": 500.0,
                "retract_mm": 3.0,
            },
        }
    )
    assert result.recording.end["outcome"] == "completed", result.recording.end["text"]


def test_replayed_second_is_an_old_force(guarded: Run) -> None:
    """The replayed force is noisy, but old. The distance limits how deep the tool can go."""
    task = {"approach_depth_limit_mm": 4.0}
    run = guarded(approach("egm", 5e3, strikes("replayed", 0.0, length_s=0.5), task=task))
    assert run.cause.startswith("the newest force is ")
    assert run.largest < 5e3 * 1.5e-3
