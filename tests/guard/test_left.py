"""Last line of a run that ends during the motion to the zero: it reports the force of that moment."""

import re
from collections.abc import Callable
from typing import Any

import pytest

from hil_bridge.record import EventKind
from hil_bridge.settings.configuration import Config, read_config

pytestmark = pytest.mark.sweep

Guarded = Any
Run = Callable[..., Guarded]

ROBOTS = pytest.mark.parametrize("robot", ["s3", "egm"])
SURFACES = pytest.mark.parametrize("stiffness", [5e3, 5e4])
CLOSE: dict[str, dict[str, Any]] = {
    "s3": {},
    "egm": {
        "run": {"period_ms": 20},
        "controller": {"sample_ms": 20},
        "robot": {"emulated": "egm"},
        "sensor": {"emulated": "netft"},
    },
}
"""Settings of each robot."""
RISES_AT_S = {"s3": 0.5, "egm": 0.3}
"""Time at which the surface starts to rise, after the start of the checks, s: about the first step to the zero."""


def close(robot: str, stiffness: float, faults: list[dict[str, Any]]) -> Config:
    """Return the settings of a tool 0.2 mm above the surface."""
    values = {**CLOSE[robot], "faults": faults}
    surface = {"stiffness_n_m": stiffness}
    values["run"] = {**values.get("run", {}), "duration_s": 1.0}
    values["cell"] = {"start_position_mm": (900.0, -100.0, 590.2), "surface": surface}
    return read_config(values)


def rises(at_s: float, for_s: float = 0.4) -> dict[str, Any]:
    """The surface rises, by 1.6 mm by default."""
    how = {"on": "surface", "fault": "rises", "phase": "tare", "with": {"mm_s": 4.0}}
    return {**how, "after_s": at_s, "for_s": for_s}


def newtons(left: str) -> float:
    """Return the force in the last line, N."""
    match = re.search(r"([\d.]+) N,", left)
    assert match is not None, left
    return float(match[1])


@ROBOTS
@SURFACES
def test_final_state_reports_rising_surface(guarded: Run, robot: str, stiffness: float) -> None:
    run = guarded(close(robot, stiffness, [rises(RISES_AT_S[robot])]))
    assert not run.cycles, "the run ended during the motion to the zero"
    assert run.last > 2.0
    assert run.result.left.startswith("NOT retracted: ")
    assert newtons(run.result.left) == pytest.approx(run.last, rel=0.1, abs=0.3)


@ROBOTS
@SURFACES
@pytest.mark.parametrize("more_s", [0.2, 0.6, 1.0])
def test_final_state_after_any_cut_reports_pressing_tool(
    guarded: Run, robot: str, stiffness: float, more_s: float
) -> None:
    """A zero during the rise of the surface hides the force; the tool is still not reported as free."""
    run = guarded(close(robot, stiffness, [rises(RISES_AT_S[robot] + more_s)]))
    if run.last > 1.5:
        assert run.result.left.startswith("NOT retracted: ")


@ROBOTS
@SURFACES
def test_final_state_without_force_is_unknown(guarded: Run, robot: str, stiffness: float) -> None:
    """The sensor becomes silent during the motion to the zero while the surface rises."""
    at_s = RISES_AT_S[robot]
    silent = {"on": "sensor-wire", "fault": "off", "phase": "tare", "after_s": at_s + 0.05, "for_s": 600.0}
    run = guarded(close(robot, stiffness, [rises(at_s, 1.0), silent]))
    assert run.last > 2.0
    assert "force unknown" in run.result.left
    assert run.result.left.startswith("NOT retracted: ")


@ROBOTS
@pytest.mark.parametrize("pressed", [False, True])
def test_final_state_has_force_after_interruption(guarded: Run, robot: str, pressed: bool) -> None:
    """An operator ends the run at the report of the first step; the surface rises or does not."""
    config = close(robot, 5e4, [rises(RISES_AT_S[robot])] if pressed else [])

    def interrupt(run: Guarded) -> None:
        record_event = run.event

        def event(record: Any) -> None:
            record_event(record)
            if record.kind == EventKind.PHASE and record.text == "tare":
                run.clock.call_at(run.clock.now() + RISES_AT_S[robot] + 0.15, run.run.interrupt)

        run.event = event

    run = guarded(config, prepare=interrupt)
    assert not run.cycles
    assert run.result.left.startswith("NOT retracted: " if run.last > 1.0 else "retracted, 0.")


def test_final_state_is_at_standstill_position(guarded: Run) -> None:
    """EGM ends with its RAPID program: the robot passes the last order by its momentum."""
    config = close("egm", 5e3, [])
    values = {
        "limits": {"correction_total_mm": 20.0},
        "task": {"retract_mm": 8.0, "retract_speed_mm_s": 50.0},
        "faults": [
            {"on": "robot", "fault": "program-stopped", "phase": "retract", "after_s": 0.1, "for_s": 0.1}
        ],
    }
    config = read_config({**config.model_dump(exclude_unset=True), **values})
    run = guarded(config)
    assert run.result.rest is not None
    reported = run.result.rest.depth
    true = run.cycles[0].start[2] - run.cell.true_state(run.truths[-1][0]).position[2]
    assert reported == pytest.approx(true, abs=2e-4)


@pytest.mark.full
@pytest.mark.parametrize("after_s", [0.02, 0.1, 0.2])
def test_final_state_waits_for_silent_robot(guarded: Run, after_s: float) -> None:
    """The connection closes during the retraction: the robot stops unobserved, and the sensor continues to report."""
    dropped = {"on": "wire", "fault": "dropped", "phase": "retract", "after_s": after_s}
    values = {
        "robot": {"emulated": "rtde"},
        "sensor": {"emulated": "netft"},
        "task": {"retract_mm": 3.0},
        "run": {"period_ms": 20, "duration_s": 1.0},
        "controller": {"sample_ms": 20},
        "cell": {"start_position_mm": (900.0, -100.0, 592.0)},
        "faults": [dropped],
    }
    run = guarded(read_config(values))
    assert run.result.left.startswith("NOT retracted: ")
    assert newtons(run.result.left) == pytest.approx(run.last, abs=0.3)
