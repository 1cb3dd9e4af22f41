"""A sensor that repeats its last second, noise included, during the approach."""

from collections.abc import Callable
from typing import Any

import pytest

from hil_bridge.errors import Cause
from hil_bridge.record import Outcome
from hil_bridge.settings.configuration import Config
from tests.near_surface import awake_config, merged

pytestmark = pytest.mark.sweep

Guarded = Any
Run = Callable[..., Guarded]


def replayed(robot: str, stiffness: float, height_mm: float = 6.0, after_s: float = 1.2) -> Config:
    """Return a run from this height; after this time, the sensor only repeats a second of the approach."""
    values: dict[str, Any] = {
        "run": {"duration_s": 1.0},
        "cell": {
            "start_position_mm": (900.0, -100.0, 590.0 + height_mm),
            "surface": {"stiffness_n_m": stiffness},
        },
        "faults": [
            {"on": "signal", "fault": "replayed", "phase": "approach", "after_s": after_s, "for_s": 600.0}
        ],
    }
    if robot != "s3":
        stream = {"run": {"period_ms": 20}, "controller": {"sample_ms": 20}, "sensor": {"emulated": "netft"}}
        values = merged(values, {**stream, "robot": {"emulated": robot}})
    return awake_config(values)


@pytest.mark.parametrize("stiffness", [5e3, 5e4])
@pytest.mark.parametrize("robot", ["egm", "rtde", "rsi"])
def test_replayed_second_in_the_approach_ends_at_the_surface(
    guarded: Run, robot: str, stiffness: float
) -> None:
    run = guarded(replayed(robot, stiffness))
    assert run.result.outcome is Outcome.STOPPED
    assert run.result.cause is Cause.FORCE_TOO_OLD, run.cause
    assert run.largest < 0.4e-3 * stiffness
    assert run.last == 0.0
    assert not run.result.rest.retracted  # at the end, the sensor reports an earlier force


@pytest.mark.parametrize("robot", ["egm", "rsi"])
def test_replayed_touch_ends_the_run_off_the_surface(guarded: Run, robot: str) -> None:
    """The replayed second contains the touch, so the sensor alternates between contact and no contact."""
    run = guarded(replayed(robot, 5e4, height_mm=2.5, after_s=0.2))
    assert run.result.cause is Cause.FORCE_TOO_OLD, run.cause
    assert run.largest < 50.0
    assert run.last == 0.0
