"""Attacks that once broke the guard's promises."""

from collections.abc import Callable
from typing import Any

import pytest

from hil_bridge.record import EventKind, Outcome
from hil_bridge.runs.cycle import UNKNOWN_SERVO
from hil_bridge.runs.small_steps import SmallSteps
from hil_bridge.settings.configuration import Config
from protocol.devices.s3.arap import Status

pytestmark = pytest.mark.sweep

Guarded = Any
Run = Callable[..., Guarded]
Configured = Callable[..., Config]
SURFACES = pytest.mark.parametrize("stiffness", [5e3, 5e4])


class Silent(Exception):
    """Exception that fails when converted to text."""

    def __str__(self) -> str:
        raise RuntimeError("nothing to say")


@pytest.mark.parametrize("error", [TimeoutError(), AssertionError(), RecursionError(), Silent()])
def test_exception_without_text_retracts(guarded: Run, configured: Configured, error: Exception) -> None:
    def break_down(run: Guarded, record: Any) -> None:
        if sum(cycle.phase == "track" for cycle in run.cycles) == 5:
            raise error

    run = guarded(configured(5e3), break_down)
    assert run.cause.startswith(f"a bug ended the run: {type(error).__name__}: ")
    assert run.last == 0.0
    assert run.result.left == "retracted, 0.0 N"


@pytest.mark.parametrize("kind", ["bug", "stop", "phase"])
def test_failing_log_does_not_prevent_retraction(
    guarded: Run, configured: Configured, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    def break_down(run: Guarded, record: Any) -> None:
        if sum(cycle.phase == "track" for cycle in run.cycles) == 5:
            reported = run.event

            def event(record: Any) -> None:
                if record.kind == kind:
                    raise OSError("the disk is gone")
                reported(record)

            run.event = event
            raise ZeroDivisionError("lost count")

    run = guarded(configured(5e3), break_down)
    assert run.cause == "a bug ended the run: ZeroDivisionError: lost count"
    assert run.last == 0.0
    assert run.result.left == "retracted, 0.0 N"


@SURFACES
def test_lateral_border_does_not_hold_retraction(
    guarded: Run, configured: Configured, stiffness: float
) -> None:
    rising = {"on": "surface", "fault": "rises", "phase": "track", "after_s": 2.0, "with": {"mm_s": 2.0}}
    config = configured(
        stiffness,
        {
            "run": {"duration_s": 12.0},
            "limits": {"workspace_max_m": (3.0, -0.085, 3.0)},
            "task": {"expected_stiffness_n_m": stiffness},
            "faults": [{**rising, "for_s": 4.0}],
        },
    )
    run = guarded(config)
    assert run.largest <= 50.0 + stiffness * 0.5e-3 * 3
    assert run.last == 0.0
    assert run.result.left == "retracted, 0.0 N"
    assert max(record.sample.position[1] for record in run.cycles) <= -0.085 + 0.2e-3


def test_stopped_tool_cancels_its_orders(guarded: Run, configured: Configured) -> None:
    """The robot is frozen while it is ordered back, and an obstacle waits there: it must not drive on into it."""
    config = configured(
        5e3,
        {
            "cell": {"obstacle": {"height_mm": 1.0, "stiffness_n_m": 5e4}},
            "faults": [{"on": "robot", "fault": "stands", "phase": "retract", "after_s": 2.6, "for_s": 2.0}],
        },
    )
    run = guarded(config)
    assert run.result.outcome is Outcome.STOPPED
    assert "while the tool retracted" in run.cause
    stopped = next(event.at for event in run.events if event.kind == EventKind.STOP)
    at_stop = max(force for at, force in run.truths if at <= stopped + 0.15)
    assert run.largest <= at_stop + 1.0, "it stopped within a transport delay"


@pytest.mark.parametrize("ending", ["refused", "bug", "silent sensor"])
def test_pressing_tool_above_start_is_retracted(guarded: Run, configured: Configured, ending: str) -> None:
    """The surface rises by 8°, so that the tool presses higher than it started."""
    faults = {
        "refused": [{"on": "robot", "fault": "refuses", "when": "depth_mm < -1", "with": {"function": 24}}],
        "silent sensor": [{"on": "sensor-wire", "fault": "off", "when": "depth_mm < -1", "for_s": 600.0}],
    }

    def break_down(run: Guarded, record: Any) -> None:
        if ending == "bug" and record.depth < -1e-3:
            raise ZeroDivisionError("lost count")

    config = configured(
        5e3,
        {
            "run": {"duration_s": 60.0},
            "cell": {
                "surface": {"kind": "sloped", "slope_deg": 8.0, "origin_y_mm": -100.0},
                "start_position_mm": (900.0, -100.0, 591.0),
            },
            "faults": faults.get(ending, []),
        },
    )
    run = guarded(config, break_down)
    assert run.result.outcome is Outcome.STOPPED
    assert run.last == 0.0


def test_interrupted_lift_takes_no_zero(
    guarded: Run, configured: Configured, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The tool is in the surface, the sensor is unchecked, and an operator interrupts during the first steps."""
    config = configured(
        5e3, {"cell": {"start_position_mm": (900.0, -100.0, 589.9)}, "sensor": {"unchecked": True}}
    )
    went = SmallSteps.to
    runs: list[Guarded] = []

    async def interrupted(self: SmallSteps, *arguments: Any) -> Any:
        runs[0].run.interrupt()
        return await went(self, *arguments)

    monkeypatch.setattr(SmallSteps, "to", interrupted)
    run = guarded(config, prepare=runs.append)
    assert run.cycles == []
    assert not any("zero taken" in text for text in run.texts("check"))
    assert run.result.left.startswith("NOT retracted: ")


def test_status_without_orientation_is_reported(
    guarded: Run, configured: Configured, monkeypatch: pytest.MonkeyPatch
) -> None:
    def strike(run: Guarded, record: Any) -> None:
        if sum(cycle.phase == "track" for cycle in run.cycles) == 5:
            monkeypatch.setattr(Status, "quaternion", (0.0, 0.0, 0.0, 0.0))

    run = guarded(configured(5e3), strike)
    assert "reports the orientation (0.0, 0.0, 0.0, 0.0), which is invalid" in run.cause
    assert run.last == 0.0


def test_unknown_servo_reports_missing_check(
    guarded: Run, configured: Configured, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = configured(5e3, {"run": {"duration_s": 0.5}})
    assert guarded(config).texts("motion") == []
    monkeypatch.setattr("hil_bridge.devices.robots.s3.facts._servo_facts", lambda servo: None)
    assert guarded(config).texts("motion") == [UNKNOWN_SERVO]
