"""Cases in which a credulous guard would cause damage, each on a soft and on a hard surface.

The bound of the true force: the limit, plus the effect of orders already sent. A command may be ahead
of the newest force by the steps of so many cycles as a force takes to be seen, so

    bound = limit + stiffness · step · cycles
"""

from collections.abc import Callable
from typing import Any

import pytest

from hil_bridge.errors import Cause
from hil_bridge.record import Outcome
from hil_bridge.settings.configuration import Config

pytestmark = pytest.mark.sweep

LIMIT_N = 50.0
LATENCY_CYCLES = 3
"""Cycles from an order to the force that shows its effect: answer, motion, filter, and the cycle that sees it."""
STEP_M = 0.5e-3
"""Approach step, which is that of a retraction where the tool has not been."""
SURFACES = pytest.mark.parametrize("stiffness", [5e3, 5e4])
Guarded = Any
Run = Callable[..., Guarded]
Configured = Callable[..., Config]


def bound(stiffness: float, step: float = STEP_M) -> float:
    """The largest true force that may occur, N."""
    return LIMIT_N + stiffness * step * LATENCY_CYCLES


def interrupt_after(seconds: float, phase: str) -> Callable[[Guarded, Any], None]:
    """Press Ctrl-C this time after the first cycle of a phase."""
    starts: list[float] = []

    def meddle(run: Guarded, record: Any) -> None:
        if record.phase == phase:
            starts.append(record.started_at)
            if record.started_at - starts[0] >= seconds:
                run.run.interrupt()

    return meddle


@SURFACES
def test_approach_in_wrong_direction_stops(guarded: Run, configured: Configured, stiffness: float) -> None:
    """3 mm off the surface, Ctrl-C after a second: the retraction goes into the surface."""
    config = configured(
        stiffness,
        {"frame": {"approach": (0.0, 0.0, 1.0)}, "cell": {"start_position_mm": (900.0, -100.0, 593.0)}},
    )
    run = guarded(config, interrupt_after(1.0, "approach"))
    assert run.largest <= bound(stiffness)
    assert run.result.outcome is Outcome.STOPPED
    assert "while the tool retracted" in run.cause
    assert run.result.left.startswith("NOT retracted")


@SURFACES
def test_obstacle_above_start_fails_run(guarded: Run, configured: Configured, stiffness: float) -> None:
    config = configured(stiffness, {"cell": {"obstacle": {"height_mm": 5.0, "stiffness_n_m": stiffness}}})
    run = guarded(config)
    assert run.largest <= bound(stiffness)
    assert run.result.outcome is Outcome.STOPPED
    assert "while the tool retracted" in run.cause
    assert run.result.left.startswith("NOT retracted")


@SURFACES
def test_runs_after_killed_run_are_refused(
    in_one_cell: Callable[..., Any], configured: Configured, stiffness: float
) -> None:
    def kill(run: Guarded, record: Any) -> None:
        if sum(cycle.phase == "track" for cycle in run.cycles) == 8:
            run.kill()

    first, *others = in_one_cell([configured(stiffness)] * 8, kill)
    assert first.last > 5.0, "the killed run left the tool pressing"
    assert len(others) == 7
    for run in others:
        assert run.cycles == []
        assert "Fz reads" in str(run.error)
        assert "the tool touches something" in str(run.error)
        assert run.largest <= 12.0


def fault(on: str, name: str, **more: Any) -> dict[str, Any]:
    """One fault of a configuration; parameters go into `with`."""
    where = {key: more.pop(key) for key in ("phase", "after_s", "when", "for_s") if key in more}
    return {"faults": [{"on": on, "fault": name, "with": more, **where}]}


@SURFACES
def test_start_in_contact_is_refused_before_motion(
    guarded: Run, configured: Configured, stiffness: float
) -> None:
    """The contact force is 80 N at the start."""
    z = 590.0 - 80.0 / stiffness * 1e3
    start = {"start_position_mm": (900.0, -100.0, z), "arm": {"compliance": "rigid"}}
    run = guarded(configured(stiffness, {"cell": start}))
    assert run.cycles == []
    assert "the tool touches something" in str(run.error)
    assert run.largest == pytest.approx(80.0, abs=0.1)


@SURFACES
def test_start_in_contact_with_unknown_tool_is_detected(
    guarded: Run, configured: Configured, stiffness: float
) -> None:
    """The weight is not configured; the motion to the zero detects the contact."""
    z = 590.0 - 30.0 / stiffness * 1e3
    run = guarded(
        configured(
            stiffness,
            {"cell": {"start_position_mm": (900.0, -100.0, z)}, "sensor": {"unchecked": True}},
        )
    )
    assert run.cycles == []
    assert "the tool was touching, or frame.approach points the wrong way" in run.cause
    assert run.result.cause is Cause.TOUCHING
    assert run.largest <= 30.1
    assert run.result.left.startswith("NOT retracted")


@SURFACES
def test_wrong_approach_direction_is_detected_by_lift(
    guarded: Run, configured: Configured, stiffness: float
) -> None:
    """The approach has the wrong sign and the tool nearly touches: the first steps go into the surface."""
    config = configured(
        stiffness,
        {"frame": {"approach": (0.0, 0.0, 1.0)}, "cell": {"start_position_mm": (900.0, -100.0, 590.05)}},
    )
    run = guarded(config)
    assert run.cycles == []
    assert "away is not away: the contact force rose from" in run.cause
    assert run.largest <= stiffness * 0.5e-3


SENSOR_FAULTS = {
    "dead": fault("signal", "dead"),
    "swapped with Mx": fault("signal", "swapped", axis="fz", other="mx"),
    "swapped with Fx": fault("signal", "swapped", axis="fz", other="fx"),
    "gain 0.1": fault("signal", "scale", factor=0.1),
    "sign": fault("signal", "sign"),
    "offset": fault("signal", "offset", amount=20.0),
    "full scale halved": fault("sensor", "wrong-scales", factor=0.5),
    "full scale doubled": fault("sensor", "wrong-scales", factor=2.0),
}


@SURFACES
@pytest.mark.parametrize("name", SENSOR_FAULTS)
def test_wrong_sensor_is_detected_before_motion(
    guarded: Run, configured: Configured, name: str, stiffness: float
) -> None:
    run = guarded(configured(stiffness, SENSOR_FAULTS[name]))
    assert run.cycles == []
    assert "where the tool's weight is" in str(run.error)
    assert run.largest == 0.0
    positions = [run.cell.true_state(run.clock.now() - ago).position for ago in (0.0, 1.0)]
    assert positions[0] == positions[1] == pytest.approx((0.9, -0.1, 0.6), abs=1e-4)


@SURFACES
def test_force_peak_between_decisions_stops_run(
    guarded: Run, configured: Configured, stiffness: float
) -> None:
    """65 N against 10 N of contact for 30 ms, unfiltered: 3 of 18 frames, and mostly not the newest."""
    config = configured(
        stiffness,
        {"sensor": {"jr3": {"gateway": {"cutoff_hz": 0.0}}}, "task": {"expected_stiffness_n_m": stiffness}},
    )

    def strike(run: Guarded, record: Any) -> None:
        if sum(cycle.phase == "track" for cycle in run.cycles) == 6:
            at = record.answered_at + 0.02
            run.clock.call_at(at, lambda: run.cell.inject("signal", "spike", at, amount=65.0, for_s=0.03))

    run = guarded(config, strike)
    assert run.result.outcome is Outcome.STOPPED
    assert "is beyond 50 N" in run.cause
    stop = next(record for record in run.cycles if record.verdict == "stop")
    assert abs(stop.sample.force) < LIMIT_N < abs(stop.sample.peak_force)
    assert run.result.left.startswith("retracted")


@SURFACES
@pytest.mark.parametrize("amount", [30.0, 55.0])
def test_false_pull_does_not_restart_search(
    guarded: Run, configured: Configured, stiffness: float, amount: float
) -> None:
    """10 N of contact read as a pull of 20 or 45 N, which is within `force_limit_n`."""
    at = {"phase": "track", "after_s": 2.0}
    run = guarded(configured(stiffness, fault("signal", "offset", amount=amount, **at)))
    assert run.result.outcome is Outcome.STOPPED
    assert "a surface does not pull" in run.cause
    assert run.result.cause is Cause.PULL
    assert run.largest <= 30.0, "the first touch of the harder surface reaches 29.5 N"
    assert run.last <= 10.5


POSE_FAULTS = {
    "1000 mm off": (fault("pose", "offset", z_mm=1000.0), "where the robot is"),
    "frozen": (fault("pose", "frozen"), "does not follow"),
    "mirrored": (fault("pose", "mirrored"), "does not follow"),
    "standby": (fault("robot", "false-standby"), "in standby"),
    "turned": (fault("pose", "turned"), "where the tool's weight is"),
}


@SURFACES
@pytest.mark.parametrize("name", POSE_FAULTS)
def test_wrong_pose_from_start_causes_little_motion(
    guarded: Run, configured: Configured, name: str, stiffness: float
) -> None:
    settings, message = POSE_FAULTS[name]
    run = guarded(configured(stiffness, settings))
    assert run.cycles == []
    if name == "1000 mm off":
        message = "does not follow"
    assert message in run.cause
    assert run.largest == 0.0
    motion = run.cell.true_state(run.clock.now()).position[2] - 0.6
    assert abs(motion) <= 2e-3
    assert run.cell.true_state(run.clock.now()).quaternion == pytest.approx((0.0, 1.0, 0.0, 0.0), abs=1e-4)


TRACK_POSE_FAULTS = {
    "1000 mm off": (fault("pose", "offset", z_mm=1000.0, phase="track", after_s=1.0), "jumped by"),
    "30 mm off": (fault("pose", "offset", z_mm=-30.0, phase="track", after_s=1.0), "jumped by"),
    "frozen": (fault("pose", "frozen", phase="track", after_s=1.0), "from the commanded one"),
    "standby": (fault("robot", "false-standby", phase="track", after_s=1.0), "in standby"),
    "turned": (fault("pose", "turned", phase="track", after_s=1.0), "turned by 30.0°"),
    "drifts": (fault("pose", "drift", z_mm_s=20.0, phase="track", after_s=1.0), "all that was ordered"),
}


@SURFACES
@pytest.mark.parametrize("name", TRACK_POSE_FAULTS)
def test_wrong_pose_during_run_stops_and_retracts(
    guarded: Run, configured: Configured, name: str, stiffness: float
) -> None:
    settings, message = TRACK_POSE_FAULTS[name]
    run = guarded(configured(stiffness, settings, {"run": {"duration_s": 30.0}}))
    assert run.result.outcome is Outcome.STOPPED
    assert message in run.cause
    assert run.largest <= bound(stiffness)
    assert run.last == 0.0, "the retraction follows the commanded position"
    assert run.cell.true_state(run.clock.now()).quaternion == pytest.approx((0.0, 1.0, 0.0, 0.0), abs=1e-4)


@SURFACES
def test_refused_move_ends_run_retracted(guarded: Run, configured: Configured, stiffness: float) -> None:
    run = guarded(configured(stiffness, fault("robot", "refuses", function=24, phase="track", after_s=1.0)))
    assert run.result.outcome is Outcome.STOPPED
    assert "refused order 24: 31" in run.cause
    assert run.result.cause is Cause.REFUSED_ORDER
    assert run.last == 0.0
    assert run.result.left == "retracted, 0.0 N"


@SURFACES
def test_cut_line_leaves_tool_and_reports_it(guarded: Run, configured: Configured, stiffness: float) -> None:
    run = guarded(configured(stiffness, fault("wire", "off", phase="track", after_s=1.0, for_s=600.0)))
    assert run.result.outcome is Outcome.STOPPED
    assert "robot on memory:robot" in run.cause
    assert run.result.cause is Cause.DEAD_LINK
    assert run.last <= bound(stiffness)
    assert run.result.left.startswith("NOT retracted: left at ")
    assert f"{run.last:.1f} N" in run.result.left or abs(run.last - 10.0) < 6.0


@SURFACES
def test_bug_in_run_retracts_and_is_recorded(guarded: Run, configured: Configured, stiffness: float) -> None:
    def break_down(run: Guarded, record: Any) -> None:
        if sum(cycle.phase == "track" for cycle in run.cycles) == 5:
            raise ZeroDivisionError("lost count")

    run = guarded(configured(stiffness), break_down)
    assert run.result.outcome is Outcome.STOPPED
    assert run.cause == "a bug ended the run: ZeroDivisionError: lost count"
    assert run.result.cause is Cause.BUG
    (trace,) = run.texts("bug")
    assert "Traceback" in trace
    assert run.last == 0.0
    assert run.result.left == "retracted, 0.0 N"


@SURFACES
def test_stalled_computer_stops_run(guarded: Run, configured: Configured, stiffness: float) -> None:
    run = guarded(configured(stiffness, fault("computer", "pause", seconds=2.0, phase="track", after_s=1.0)))
    assert run.result.outcome is Outcome.STOPPED
    assert "no decision for 2000 ms, allowed: at most 500 ms" in run.cause
    assert run.result.cause is Cause.DEADLINE
    assert run.texts("gap") != []
    assert run.last == 0.0
    assert run.largest <= bound(stiffness)
