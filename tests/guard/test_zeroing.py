"""Zero of a run: the first reading must still match at the end of the lift."""

import re
from collections.abc import Callable
from typing import Any

import pytest

from hil_bridge.control.course.touch import Doubt
from hil_bridge.errors import Cause
from hil_bridge.record.ending import Check
from hil_bridge.settings.configuration import Config
from tests.near_surface import awake_config

Guarded = Any
Run = Callable[..., Guarded]
ROBOTS = pytest.mark.parametrize("robot", ["s3", "egm"])
SLANTED = {"approach": (0.0, 0.8, -0.6), "travel": (1.0, 0.0, 0.0)}
"""A downward tool approaches along two axes of its sensor: its weight verifies Fz, but not Fy."""


def config(robot: str, **sections: Any) -> Config:
    """Return the settings of a short run that starts 1 mm above the surface; `sections` override them."""
    values: dict[str, Any] = {
        "run": {"duration_s": 0.5},
        "cell": {"start_position_mm": (900.0, -100.0, 591.0)},
        "task": {"retract_speed_mm_s": 20.0, "retract_mm": 3.0},
    }
    if robot == "egm":
        values["run"]["period_ms"] = 20
        values |= {
            "controller": {"sample_ms": 20},
            "robot": {"emulated": "egm"},
            "sensor": {"emulated": "netft"},
        }
    for name, section in sections.items():
        values[name] = {**values.get(name, {}), **section}
    return awake_config(values)


@ROBOTS
def test_lift_off_a_soft_surface_counts_from_the_first_reading(guarded: Run, robot: str) -> None:
    """0.9 N press on 1.6 kN/m: each of the four steps removes 0.2 N, together 0.8 N; allowed: at most 0.5 N."""
    pressed_mm = 0.9 / 1600.0 * 1e3
    cell = {"start_position_mm": (900.0, -100.0, 590.0 - pressed_mm), "surface": {"stiffness_n_m": 1600.0}}
    run = guarded(config(robot, cell=cell))
    assert run.result.cause is Cause.TOUCHING, run.cause
    assert not run.cycles


@ROBOTS
def test_weight_lost_on_one_main_axis_is_refused(guarded: Run, robot: str) -> None:
    run = guarded(config(robot, frame=SLANTED))
    assert run.error is not None, run.cause
    assert run.error.cause is Cause.UNVERIFIED_AXIS
    assert "Fy" in str(run.error)
    assert not run.cycles


@ROBOTS
def test_touch_on_one_unverified_main_axis_is_in_doubt(guarded: Run, robot: str) -> None:
    """The operator waives Fy: every touch must be proven all the same."""
    run = guarded(config(robot, frame=SLANTED, sensor={"unverified": ["fy"]}))
    assert run.error is None, run.cause
    assert {cycle.sample.doubt for cycle in run.cycles} == {Doubt.AXIS}


@ROBOTS
def test_zeroing_reports_the_zero_and_its_unexplained_force(guarded: Run, robot: str) -> None:
    """The tool of 0.5 kg explains 4.90 N of it."""
    run = guarded(config(robot))
    (text,) = [event.text for event in run.events if event.check is Check.ZERO]
    match = re.fullmatch(r"zero taken: (\d\.\d\d) N, (\d\.\d\d) N·m; (\d\.\d\d) N unexplained", text)
    assert match is not None, text
    assert [float(value) for value in match.groups()] == pytest.approx([4.9, 0.0, 0.0], abs=0.1)


@ROBOTS
def test_lift_of_a_single_step_moves_the_tool_away(guarded: Run, robot: str) -> None:
    run = guarded(config(robot, task={"zero_lift_mm": 0.5, "zero_step_mm": 0.5}))
    assert run.error is None, run.cause
    assert run.cycles[0].start[2] == pytest.approx(0.5915, abs=0.1e-3)
