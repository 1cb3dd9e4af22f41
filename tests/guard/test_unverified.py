"""An axis that the tool's weight does not verify: named, refused, or accepted by the user and tested at each touch."""

from collections.abc import Callable
from typing import Any

import pytest

from hil_bridge.control.course.zero import AXES, unverified_axes
from hil_bridge.control.geometry.wrist import Wrist
from hil_bridge.record import Outcome
from hil_bridge.settings.configuration import Config
from tests.near_surface import awake_config

pytestmark = pytest.mark.sweep

Guarded = Any
Run = Callable[..., Guarded]

ROBOTS = pytest.mark.parametrize("robot", ["s3", "egm"])
SURFACES = pytest.mark.parametrize("stiffness", [5e3, 5e4])
QUICK: dict[str, dict[str, Any]] = {
    "run": {"period_ms": 20},
    "controller": {"sample_ms": 20},
    "robot": {"emulated": "egm"},
    "sensor": {"emulated": "netft"},
}


def light(robot: str, stiffness: float, faults: list[dict[str, Any]], is_waived: bool) -> Config:
    """A tool of 80 g, which weighs 0.8 N, 1 mm above a surface."""
    values: dict[str, Any] = {
        key: dict(section) for key, section in (QUICK if robot == "egm" else {}).items()
    }
    values["run"] = {**values.get("run", {}), "duration_s": 1.0}
    values["sensor"] = {**values.get("sensor", {}), "unverified": ["fz"] if is_waived else []}
    values["cell"] = {
        "surface": {"stiffness_n_m": stiffness},
        "start_position_mm": (900.0, -100.0, 591.0),
        "tool": {"mass_kg": 0.08},
    }
    values["task"] = {"retract_speed_mm_s": 20.0, "retract_mm": 3.0, "approach_depth_limit_mm": 4.0}
    return awake_config({**values, "faults": faults})


def from_power_up(name: str, **how: Any) -> dict[str, Any]:
    """A fault of Fz that exists before the run checks the sensor."""
    return {"on": "signal", "fault": name, "phase": "connect", "for_s": 600.0, "with": {"axis": "fz", **how}}


@ROBOTS
def test_light_tool_is_refused_before_motion(guarded: Run, robot: str) -> None:
    run = guarded(light(robot, 5e3, [from_power_up("dead")], is_waived=False))
    assert not run.cycles
    assert run.result.left == ""
    for part in ("presses on Fz (0.78 N of weight)", "tool.mass_kg", 'sensor.unverified = ["fz"]'):
        assert part in run.cause
    assert any("not verified by the tool's weight: Fx Fy Fz" in text for text in run.texts("check"))


def test_upright_tool_names_unverified_axes(guarded: Run) -> None:
    values = {"run": {"duration_s": 0.2}, "cell": {"start_position_mm": (900.0, -100.0, 591.0)}}
    run = guarded(awake_config({**values, "task": {"retract_mm": 1.0}}))
    assert "not verified by the tool's weight: Fx Fy Mx My Mz" in run.texts("check")


@pytest.mark.parametrize(
    ("quaternion", "verified"),
    [((1.0, 0.0, 0.0, 0.0), {"Fz"}), ((0.7071068, 0.7071068, 0.0, 0.0), {"Fy", "Mx"})],
    ids=["upright", "level"],
)
def test_orientation_determines_verified_axes(
    quaternion: tuple[float, float, float, float], verified: set[str]
) -> None:
    wrist = Wrist(mass=0.5, centre_of_gravity=(0.0, 0.0, 0.08))
    unverified = unverified_axes(wrist, quaternion, 1.0, 0.2)
    assert {AXES[k] for k in range(6)} - {AXES[k] for k in unverified} == verified
    assert unverified_axes(None, quaternion, 1.0, 0.2) == tuple(range(6))


@ROBOTS
@SURFACES
def test_axis_with_wrong_scale_is_not_a_touch(guarded: Run, robot: str, stiffness: float) -> None:
    """The contact shows late, at 50 N; the touch is not answered as a surface would, and the run ends there."""
    run = guarded(light(robot, stiffness, [from_power_up("scale", factor=0.02)], is_waived=True))
    assert run.result.outcome is Outcome.STOPPED
    assert run.largest <= 50.0 + stiffness * 1e-3
    assert not any(record.phase == "track" for record in run.cycles)


@ROBOTS
@SURFACES
def test_waived_healthy_axis_tracks(guarded: Run, robot: str, stiffness: float) -> None:
    run = guarded(light(robot, stiffness, [], is_waived=True))
    assert run.result.outcome is Outcome.COMPLETED, run.cause
    assert any(record.phase == "track" for record in run.cycles)


@ROBOTS
@SURFACES
def test_waived_dead_axis_presses_no_farther_than_its_depth(
    guarded: Run, robot: str, stiffness: float
) -> None:
    """From 1 mm above the surface 3 mm go 2 mm deep."""
    run = guarded(light(robot, stiffness, [from_power_up("dead")], is_waived=True))
    assert run.result.outcome is Outcome.STOPPED
    assert "no contact found within 3 mm" in run.cause
    assert "task.unverified_depth_mm" in run.cause
    assert run.largest <= 2.05e-3 * stiffness
    assert run.result.left.endswith("(Fz not verified)")
