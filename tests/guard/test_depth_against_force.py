"""A false zero while the tool presses: the depth reveals the force that the sensor misses, and the tool retracts."""

import math
from collections.abc import Callable
from typing import Any

import pytest

from hil_bridge.control.course.depth_watch import Contact, unexplained_depth, watch_contact
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.verdict import Observation
from hil_bridge.errors import Cause
from tests.observed import observation

pytestmark = pytest.mark.sweep

Guarded = Any
Run = Callable[..., Guarded]
LIMITS = Limits()
HARD = 5e4
"""N/m."""
DT = 0.02


def holding(robot: str, *faults: dict[str, Any]) -> dict[str, Any]:
    """Return the settings of a tool that stays in one position during these faults."""
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
def test_drifting_zero_ends_run_off_surface(
    guarded: Run, configured: Callable[..., Any], robot: str, stiffness: float
) -> None:
    how = {"axis": "fz", "per_s": 2.0}
    drift = {"on": "signal", "fault": "drift", "phase": "track", "after_s": 2.0, "with": how}
    run = guarded(configured(stiffness, holding(robot, drift)))
    assert run.largest < 32.0
    assert run.last < 0.5
    causes = (Cause.WITNESS, Cause.UNANSWERED) if robot == "rtde" else (Cause.UNANSWERED,)
    assert run.result.cause in causes


@pytest.mark.full
def test_healthy_hold_completes(guarded: Run, configured: Callable[..., Any]) -> None:
    run = guarded(configured(5e4, holding("s3")))
    assert run.result.left.startswith("retracted")
    assert math.isclose(run.last, 0.0)


# --- the watch alone


def press(
    contact: Contact | None, seconds: float, depth_mm: float, x_mm: float = 0.0, **force: float | None
) -> Contact:
    """Return the contact after pressing in one position for this time, on a hard surface of known stiffness."""
    position = (x_mm * 1e-3, 0.0, -depth_mm * 1e-3)
    facts: dict[str, Any] = {"force": 10.0, **force, "position": position}
    sample = observation(**facts).sample
    for _ in range(round(seconds / DT)):
        contact = watch_contact(contact, Observation(sample, depth_mm * 1e-3, DT, True), (HARD, HARD), LIMITS)
    assert contact is not None
    return contact


def test_watch_contact_back_at_touch_is_judged_by_touch() -> None:
    """The tool travels 20 mm and back while 40 N of drift press it deeper. During the travel it looks like a slope."""
    contact, count = press(None, 3.0, 1.0), 400
    for k in range(count):
        x_mm = 20.0 * (1.0 - abs(2.0 * k / count - 1.0))
        contact = press(contact, DT, 1.0 + 0.8 * k / count, x_mm)
        assert unexplained_depth(contact, LIMITS) == 0.0 or k > 0.8 * count
    contact = press(contact, 5.0, 1.8)
    assert unexplained_depth(contact, LIMITS) == pytest.approx(0.8e-3, rel=1e-3)
    assert contact.unreported_n == pytest.approx(0.8e-3 * HARD, rel=1e-3)


def test_watch_contact_after_travel_is_judged_by_position() -> None:
    """After 20 mm of travel the tool is stationary, and drift presses it deeper. The travel does not explain that."""
    contact = press(None, 3.0, 1.0)
    for k in range(200):
        contact = press(contact, DT, 1.0, 0.1 * k)
    contact = press(contact, 5.0, 1.0, 20.0)
    assert unexplained_depth(contact, LIMITS) == 0.0
    contact = press(contact, 5.0, 1.8, 20.0)
    assert 0.45e-3 < unexplained_depth(contact, LIMITS) < 0.8e-3, "less the distance from its newest place"


@pytest.mark.parametrize(("paired_force", "expected"), [(7.0, 7.0), (None, 12.0)])
def test_watch_contact_takes_the_force_paired_with_the_depth(
    paired_force: float | None, expected: float
) -> None:
    contact = press(None, 3.0, 1.0, force=12.0, paired_force=paired_force)
    assert contact.now is not None
    assert contact.now.force == pytest.approx(expected)
    deeper = press(contact, 5.0, 2.0, force=12.0 + 1e-3 * HARD, paired_force=paired_force)
    assert unexplained_depth(deeper, LIMITS) == pytest.approx(0.0 if paired_force is None else 1e-3, rel=1e-3)
