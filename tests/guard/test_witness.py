"""The second witness: a robot that feels the contact itself, beside a force sensor that lies."""

from collections.abc import Callable
from typing import Any

import pytest

from hil_bridge.recording import Outcome
from hil_bridge.settings.configuration import Config, read_config

Guarded = Any
Run = Callable[..., Guarded]
FOR_GOOD_S = 600.0
ROBOTS = pytest.mark.parametrize("robot", ["rtde", "egm"])
SURFACES = pytest.mark.parametrize("stiffness", [5e3, 5e4])
AXES = ("fx", "fy", "fz", "mx", "my", "mz")


def feeling(robot: str, stiffness: float, *faults: dict[str, Any], **more: Any) -> Config:
    """Three seconds at 10 N with a robot that feels a force itself, and a Net F/T; `more` are further settings."""
    values: dict[str, Any] = {
        "run": {"duration_s": 3.0, "period_ms": 20},
        "controller": {"sample_ms": 20},
        "robot": {"emulated": robot},
        "sensor": {"emulated": "netft"},
        "cell": {"start_position_mm": (900.0, -100.0, 592.0), "surface": {"stiffness_n_m": stiffness}},
        "task": {"retract_speed_mm_s": 20.0, "retract_mm": 4.0, "expected_stiffness_n_m": stiffness},
        "faults": list(faults),
    }
    if robot == "egm":
        values["cell"]["egm"] = {"measured_force": True}
    for name, section in more.items():
        values[name] = {**values.get(name, {}), **section}
    return read_config(values)


def fault(on: str, name: str, phase: str = "approach", **how: Any) -> dict[str, Any]:
    """It begins with a phase, in track half a second later, and does not end."""
    after_s = 0.5 if phase == "track" else 0.0
    return {"on": on, "fault": name, "phase": phase, "after_s": after_s, "for_s": FOR_GOOD_S, "with": how}


LIES: dict[str, tuple[dict[str, Any], ...]] = {
    "stuck in approach": (fault("signal", "stuck"),),
    "noise on all axes in approach": tuple(fault("signal", "dead", axis=axis) for axis in AXES),
    "dead Fz in approach": (fault("signal", "dead"),),
    "dead Fz in track": (fault("signal", "dead", "track"),),
    "a tenth in approach": (fault("signal", "scale"),),
    "a tenth in track": (fault("signal", "scale", "track"),),
    "drift the wrong way": (fault("signal", "drift", "track", per_s=2.0),),
}
OFF = {"limits": {"witness_n": 0.0}}


@ROBOTS
@SURFACES
@pytest.mark.parametrize("lie", LIES)
def test_a_sensor_that_lies_is_contradicted(guarded: Run, robot: str, stiffness: float, lie: str) -> None:
    run = guarded(feeling(robot, stiffness, *LIES[lie], run={"duration_s": 8.0 if "drift" in lie else 2.0}))
    assert run.result.outcome is Outcome.STOPPED
    assert "the robot itself feels" in run.cause
    assert run.largest <= (95.0 if stiffness > 1e4 else 30.0)
    assert run.last == 0.0
