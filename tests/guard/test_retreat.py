"""Retractions with a surface that follows, an obstacle behind the tool, or an unknown force."""

import math
from collections.abc import Callable
from typing import Any

import pytest

from hil_bridge.control.course import retreat
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.verdict import Observation, Retreat, Stage
from hil_bridge.errors import Cause, Reason
from hil_bridge.settings.configuration import Config, read_config
from tests.near_surface import STILL, awake_config
from tests.observed import observation

pytestmark = pytest.mark.sweep

Guarded = Any
Run = Callable[..., Guarded]
LIMITS = Limits()
HARD = 5e4
"""N/m."""


def cell(robot: str, stiffness: float, *faults: dict[str, Any], awake: bool = True) -> Config:
    """Three seconds of tracking on a surface of this stiffness, N/m; a stream decides every 20 ms."""
    values: dict[str, Any] = {
        "run": {"duration_s": 3.0},
        "cell": {"start_position_mm": (900.0, -100.0, 591.0), "surface": {"stiffness_n_m": stiffness}},
        "task": {"expected_stiffness_n_m": stiffness, "retract_mm": 60.0},
        "faults": list(faults),
    }
    if robot != "s3":
        values["run"]["period_ms"] = 20
        values |= {"controller": {"sample_ms": 20}, "robot": {"emulated": robot}}
        values["sensor"] = {"emulated": "netft"}
    if awake:
        return awake_config(values)
    values["cell"]["netft"] = (
        STILL  # with vibration the force reaches 108 … 123 N: see docs/explanation/fidelity.md
    )
    return read_config(values)


def rising(mm_s: float, for_s: float = 1.0) -> dict[str, Any]:
    how = {"phase": "track", "after_s": 1.0, "for_s": for_s, "with": {"mm_s": mm_s}}
    return {"on": "surface", "fault": "rises", **how}


def behind(height_mm: float) -> dict[str, Any]:
    """Hard plane at this distance above the tip when the retraction begins."""
    how = {"height_mm": height_mm, "stiffness_n_m": HARD}
    return {"on": "obstacle", "fault": "above", "phase": "retract", "for_s": 600.0, "with": how}


@pytest.mark.parametrize(
    ("robot", "stiffness", "mm_s", "largest"),
    [
        ("s3", 5e3, 20.0, 85.0),
        ("s3", 5e4, 5.0, 120.0),
        ("s3", 5e4, 10.0, 240.0),
        ("egm", 5e3, 50.0, 120.0),
        ("egm", 5e4, 20.0, 215.0),
        (
            "rtde",
            5e4,
            20.0,
            225.0,
        ),  # the joints oscillate by 0.1 mrad about their targets, as recorded: 0.2 mm, 10 N; 82 to 218 N with 14 seeds
        ("rsi", 5e4, 20.0, 230.0),
    ],
)
def test_retraction_escapes_rising_surface(
    guarded: Run, robot: str, stiffness: float, mm_s: float, largest: float
) -> None:
    run = guarded(
        cell(robot, stiffness, rising(mm_s), awake=False)
    )  # the figures are those of the usual power-up
    assert run.largest < largest
    assert run.last == 0.0
    assert run.result.left.startswith("retracted, ")


@pytest.mark.parametrize(("robot", "stiffness"), [("s3", 5e3), ("s3", 5e4), ("egm", 5e3), ("egm", 5e4)])
@pytest.mark.parametrize("height_mm", [0.2, 1.5])
def test_retraction_stops_at_obstacle_behind_tool(
    guarded: Run, robot: str, stiffness: float, height_mm: float
) -> None:
    run = guarded(cell(robot, stiffness, behind(height_mm)))
    assert run.largest < (90.0 if robot == "s3" else 32.0)
    assert "from behind met the tool" in run.cause
    assert run.result.left.startswith("NOT retracted")


@pytest.mark.parametrize("robot", ["s3", "egm"])
@pytest.mark.parametrize("stiffness", [5e3, 5e4])
def test_retraction_above_limit_has_force_ceiling(guarded: Run, robot: str, stiffness: float) -> None:
    """The surface presses with 80 N more, and something hangs 0.2 mm above the tool."""
    step = {"on": "surface", "fault": "step", "phase": "track", "after_s": 1.5, "for_s": 600.0}
    up = step | {"with": {"mm": 80.0 / stiffness * 1e3, "ramp_ms": 100.0}}
    run = guarded(cell(robot, stiffness, up, behind(0.2)))
    assert run.largest < 125.0


@pytest.mark.parametrize("robot", ["s3", "egm"])
@pytest.mark.parametrize("stiffness", [5e3, 5e4])
def test_blind_retraction_is_short(guarded: Run, robot: str, stiffness: float) -> None:
    silent = {"on": "sensor-wire", "fault": "off", "phase": "track", "after_s": 1.5, "for_s": 600.0}
    run = guarded(cell(robot, stiffness, silent, behind(0.2)))
    longest = max(3.0, max(cycle.depth for cycle in run.cycles) * 1e3)
    assert run.largest <= HARD * (longest - 0.2) * 1e-3 + 2.0


def sample_at(now: float, force: float, depth_mm: float = 0.0, *, lateral: float = 0.0) -> Observation:
    resultant = math.hypot(force, lateral)
    return observation(force, now, resultant, 1, pressing=True, depth=depth_mm * 1e-3, dt=0.02)


def stages(course: list[Observation]) -> tuple[list[Stage], Reason | None]:
    """Return the stages of a retraction over these observations, each once, and the reason for a standstill."""
    state: Retreat | None = None
    passed: list[Stage] = []
    for one in course:
        state, reason = retreat.watch(LIMITS, state, one)
        if state.stage not in passed:
            passed.append(state.stage)
        if reason is not None:
            return passed, reason
    return passed, None


def retracting(force: Callable[[float], float], back: Callable[[float], float]) -> list[Observation]:
    return [sample_at(k * 0.02, force(k * 0.02), -back(k * 0.02)) for k in range(400)]


def test_retraction_continues_from_rising_force() -> None:
    """It rises by 40 N/s whether the tool moves or not."""
    passed, reason = stages(retracting(lambda t: 60.0 + 40.0 * t, lambda t: 5.0 * t))
    assert passed == [Stage.GOES, Stage.WAITS, Stage.TRUSTED]
    assert reason is None


def test_retraction_in_wrong_direction_stops() -> None:
    """The force rises only with the distance: 20 N/mm."""
    state: Retreat | None = None
    back, reasons = 0.0, []
    for k in range(400):
        state, reason = retreat.watch(LIMITS, state, sample_at(k * 0.02, 60.0 + 20.0 * back, -back))
        if reason is not None:
            reasons.append(reason)
            break
        back += min(5.0 * 0.02, retreat.longest_step_back(state, 0.02) * 1e3)
    assert back < 4.1
    assert reasons[0].cause is Cause.RETRACT_RISE
    assert "retracted slowly" in reasons[0].text


def test_retraction_retries_after_falling_force() -> None:
    def force(at: float) -> float:
        return 80.0 if at < 2.5 else max(80.0 - 60.0 * (at - 2.5), 0.0)

    passed, reason = stages(retracting(force, lambda t: 5.0 * min(t, 1.5)))
    assert passed == [Stage.GOES, Stage.WAITS, Stage.SLOW, Stage.TRUSTED]
    assert reason is None


def test_retraction_side_force_keeps_ceiling() -> None:
    passed, reason = stages([sample_at(0.0, 10.0), sample_at(1.0, 2.0), sample_at(1.1, 2.0, lateral=9.0)])
    assert passed == [Stage.GOES]
    assert reason is not None
    assert reason.cause is Cause.RETRACT_RISE
    assert reason.text.startswith("the force rose from 2.0 N to 9.2 N")
    _, reason = stages([sample_at(0.0, 10.0), sample_at(1.0, 2.0), sample_at(1.1, 2.0, lateral=50.1)])
    assert reason is not None
    assert reason.cause is Cause.RETRACT_OVER


@pytest.mark.parametrize(("initial", "most"), [(30.0, 10.0), (0.0, 10.0), (-8.0, 18.0)])
def test_retraction_pull_limit_applies_only_to_pull(initial: float, most: float) -> None:
    """A pull present at the start of the retraction does not count; a press at the start does not raise the limit."""
    assert stages([sample_at(0.0, initial), sample_at(0.5, -most)])[1] is None
    _, reason = stages([sample_at(0.0, initial), sample_at(0.5, -most - 0.1)])
    assert reason is not None
    assert reason.cause is Cause.BEHIND
