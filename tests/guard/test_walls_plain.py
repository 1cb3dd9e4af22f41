"""A wall in the path of a plain run: detected before the limits, and left by moving back along the path."""

from collections.abc import Callable
from typing import Any

import pytest

from hil_bridge.record import Outcome
from hil_bridge.settings.configuration import Config
from tests.near_surface import awake_config

pytestmark = pytest.mark.sweep

Guarded = Any
Run = Callable[..., Guarded]


def run_along(robot: str, stiffness: float, **surface: Any) -> Config:
    """Five seconds of tracking at 5.5 mm/s; a stream decides every 20 ms."""
    values: dict[str, Any] = {
        "run": {"duration_s": 5.0},
        "cell": {
            "start_position_mm": (900.0, -100.0, 591.0),
            "surface": {"stiffness_n_m": stiffness, **surface},
        },
        "task": {"expected_stiffness_n_m": stiffness},
    }
    if robot != "s3":
        values["run"]["period_ms"] = 20
        values |= {"controller": {"sample_ms": 20}, "robot": {"emulated": robot}}
        values["sensor"] = {"emulated": "netft"}
    return awake_config(values)


@pytest.mark.parametrize(
    ("robot", "largest", "stiffness"),
    [
        ("s3", 100.0, 5e3),
        ("s3", 100.0, 5e4),
        ("egm", 42.0, 5e3),  # 36 … 41 N, by the moment of a cycle at which it meets the wall
        ("egm", 42.0, 5e4),
        ("rtde", 40.0, 5e4),
        ("rsi", 40.0, 5e4),
    ],
)
def test_tool_retracts_from_wall(guarded: Run, robot: str, stiffness: float, largest: float) -> None:
    run = guarded(run_along(robot, stiffness, wall_at_mm=-95.0))
    assert run.result.outcome is Outcome.STOPPED
    assert run.largest < largest
    assert run.last == 0.0
    assert run.result.left.startswith("retracted, ")
    if robot != "s3":
        assert "there is an obstacle" in run.cause


@pytest.mark.parametrize(
    "surface",
    [{"friction": 0.6}, {"kind": "sloped", "slope_deg": 20.0, "friction": 0.3, "origin_y_mm": -100.0}],
    ids=["friction", "slope"],
)
def test_friction_and_slopes_are_not_a_wall(guarded: Run, surface: dict[str, Any]) -> None:
    run = guarded(run_along("s3", 5e3, **surface))
    assert run.cause == ""
    assert run.result.outcome is Outcome.COMPLETED
