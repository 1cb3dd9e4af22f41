"""A false zero while the tool presses: the depth tells the force that the sensor does not, and the tool comes off."""

import math
from collections.abc import Callable
from typing import Any

import pytest

from hil_bridge.errors import Cause

Guarded = Any
Run = Callable[..., Guarded]


def held(robot: str, *faults: dict[str, Any]) -> dict[str, Any]:
    """Settings of a tool that stays in one place while these faults strike."""
    values: dict[str, Any] = {
        "run": {"duration_s": 30.0},
        "robot": {"emulated": robot},
        "task": {"speed_mm_s": 0.0},
        "cell": {"start_position_mm": (900.0, -100.0, 591.0)},
        "faults": list(faults),
    }
    if robot == "s3":
        return values
    values["run"]["period_ms"] = 20.0
    return values | {"controller": {"sample_ms": 20.0}, "sensor": {"emulated": "netft"}}


@pytest.mark.parametrize("stiffness", [5e3, 5e4])
@pytest.mark.parametrize("robot", ["s3", "egm", "rtde", "rsi"])
def test_a_zero_that_drifts_ends_the_run_off_the_surface(
    guarded: Run, configured: Callable[..., Any], robot: str, stiffness: float
) -> None:
    how = {"axis": "fz", "per_s": 2.0}
    drift = {"on": "signal", "fault": "drift", "phase": "track", "after_s": 2.0, "with": how}
    run = guarded(configured(stiffness, held(robot, drift)))
    assert run.largest < 32.0
    assert run.last < 0.5
    causes = (Cause.WITNESS, Cause.UNANSWERED) if robot == "rtde" else (Cause.UNANSWERED,)
    assert run.result.cause in causes


def test_a_healthy_hold_goes_to_its_end(guarded: Run, configured: Callable[..., Any]) -> None:
    run = guarded(configured(5e4, held("s3")))
    assert run.result.left.startswith("retracted")
    assert math.isclose(run.last, 0.0)
