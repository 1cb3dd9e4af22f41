"""Attacks by streamed robots and newer sensors that once broke the guard's promises."""

import math
from collections.abc import Callable
from typing import Any

import pytest

import hil_bridge
from hil_bridge.devices.facts import Devices, Sensor
from hil_bridge.record import Outcome
from hil_bridge.runs.force_bound import force_bound_n
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import Config
from protocol.wrench import SensorFacts
from tests.near_surface import awake_config

pytestmark = pytest.mark.sweep

Guarded = Any
Run = Callable[..., Guarded]
STIFFNESS = 5e4
"""Stiffness of a hard surface, N/m."""
QUICKLY: dict[str, Any] = {
    "run": {"duration_s": 1.0, "period_ms": 20},
    "controller": {"sample_ms": 20},
    "cell": {"start_position_mm": (900.0, -100.0, 592.0), "surface": {"stiffness_n_m": STIFFNESS}},
    "task": {"retract_speed_mm_s": 20.0, "retract_mm": 4.0, "expected_stiffness_n_m": STIFFNESS},
}


def streamed(emulated: str, /, **more: Any) -> Config:
    """A second of tracking with this robot and a Net F/T, both emulated; `more` are further settings of sections."""
    values: dict[str, Any] = {name: dict(section) for name, section in QUICKLY.items()}
    values |= {"robot": {"emulated": emulated}, "sensor": {"emulated": "netft"}}
    for name, section in more.items():
        values[name] = {**values.get(name, {}), **section} if isinstance(section, dict) else section
    return awake_config(values)


def bound(config: Config, stiffness: float = STIFFNESS) -> float:
    """Bound of the true force of a run whose robot and sensor match their facts, N."""
    sensor = SensorFacts("", (1.0,) * 6, None, None, 0.01, 0.0, "host")
    return force_bound_n(config, Devices(Setup(config).facts, Sensor(facts=sensor)), stiffness)


def fault(on: str, name: str, **how: Any) -> dict[str, Any]:
    """It begins with the approach and does not end."""
    return {"on": on, "fault": name, "phase": "approach", "for_s": 600.0, "with": how}


LATER = [
    fault("sensor-wire", "late", ms=150.0, way="from") | {"after_s": after_s}
    for after_s in (0.05, 0.35, 0.65, 0.95)
]


@pytest.mark.parametrize("sensor", ["netft", "ft300", "ft300-urcap", "jr3", "jr3-uart"])
def test_guard_detects_growing_force_delay(guarded: Run, sensor: str) -> None:
    """Each step of the delay is shorter than `limits.stale_after_ms`, and all together are three times as long."""
    config = streamed("egm", sensor={"emulated": sensor}, faults=LATER)
    run = guarded(config)
    assert run.largest <= bound(config)
    assert "the newest force is" in run.cause
    assert run.result.left.startswith("retracted")


@pytest.mark.parametrize("robot", ["egm", "rsi", "rtde", "s3"])
@pytest.mark.parametrize("stiffness", [5e3, 5e4])
def test_repeated_bytes_hide_no_later_forces(guarded: Run, robot: str, stiffness: float) -> None:
    """They once counted as messages, which hid the growing delay of a stream."""
    ramp = [
        fault("sensor-wire", "late", ms=50.0, way="from") | {"after_s": 0.05 + 0.3 * k} for k in range(12)
    ]
    period = 180 if robot == "s3" else 20
    config = streamed(
        robot,
        sensor={"emulated": "jr3-uart"},
        run={"duration_s": 4.0, "period_ms": period},
        controller={"sample_ms": period},
        cell={"surface": {"stiffness_n_m": stiffness}},
        task={"expected_stiffness_n_m": stiffness},
        faults=[fault("sensor-wire", "twice", probability=0.01, way="from"), *ramp],
    )
    run = guarded(config)
    assert "the newest force is" in run.cause
    assert run.largest <= 0.5 * bound(config, stiffness)
    assert run.result.left.startswith("retracted")
    assert run.last == 0.0


@pytest.mark.parametrize("robot", ["egm", "rsi", "rtde"])
def test_overdue_force_stops_inward_motion(guarded: Run, robot: str) -> None:
    """Found by a campaign of 10 000 seeds: consecutive frames were lost, and the tool continued at each.

    With six of ten lost it pressed with up to 77 N, on a surface that was expected to be soft.
    """
    lost = fault("sensor-wire", "lost", probability=0.6, way="from")
    task = {"approach_speed_mm_s": 9.5, "expected_stiffness_n_m": 2e3}
    run = guarded(streamed(robot, sensor={"emulated": "jr3"}, task=task, faults=[lost]))
    assert any("next force is late" in reason for cycle in run.cycles for reason in cycle.reasons)
    assert 10.0 <= run.largest <= 30.0
    assert run.result.left.startswith("retracted")


def test_silent_sensor_ends_approach_before_touch(guarded: Run) -> None:
    """It once let an S3 press with 79 N: the age of a force is judged once in a cycle of 180 ms."""
    start = (900.0, -100.0, 591.5)
    config = {
        "sensor": {"emulated": "ft300"},
        "cell": {"start_position_mm": start, "surface": {"stiffness_n_m": STIFFNESS}},
        "task": {"approach_speed_mm_s": 9.5, "expected_stiffness_n_m": 2e3},
        "faults": [fault("sensor-wire", "off")],
    }
    run = guarded(awake_config(config))
    assert "ms old" in run.cause
    assert run.largest <= 1.0


@pytest.mark.parametrize("ms", [60.0, 90.0, 190.0])
@pytest.mark.parametrize("phase", ["approach", "track"])
def test_single_delay_keeps_force_within_bound(guarded: Run, ms: float, phase: str) -> None:
    """Shorter than `limits.stale_after_ms`, so that the run continues, with the forces paired by their true age."""
    late = fault("sensor-wire", "late", ms=ms, way="from") | {"phase": phase, "after_s": 0.05}
    config = streamed("egm", sensor={"emulated": "ft300"}, faults=[late])
    assert guarded(config).largest <= bound(config)


@pytest.mark.parametrize("holdon", ["by mode", "keep"])
def test_cumulative_corrections_are_stopped(guarded: Run, holdon: str) -> None:
    """The client is set to absolute corrections, the robot's program to relative ones."""
    config = streamed(
        "rsi",
        robot={"rsi": {"mode": "absolute"}},
        cell={"rsi": {"mode": "relative", "holdon": holdon}},
    )
    run = guarded(config)
    assert "does not follow" in run.cause
    assert run.largest == 0.0
    end = run.truths[-1][0]
    assert run.cell.true_state(end).position[2] - 0.592 < 0.02
    assert run.cell.true_state(end).velocity == pytest.approx((0.0, 0.0, 0.0), abs=1e-4)


@pytest.mark.full
def test_blocked_axis_keeps_force_within_bound(guarded: Run) -> None:
    """Axes 2 and 3 move the tool outwards: limiting axis 3 alone presses it in. A limited pose would stay in place."""
    limits = (90.0, 90.0, 0.3, 90.0, 90.0, 90.0)
    config = streamed(
        "rsi",
        robot={"rsi": {"correction": "axes", "mode": "absolute"}},
        cell={
            "start_position_mm": (-100.0, 900.0, 592.0),
            "rsi": {"mode": "absolute", "correction_tag": "None", "lim_axis_deg": limits},
        },
        task={"speed_mm_s": 20.0},
    )
    run = guarded(config)
    assert "ahead of all that was ordered" in run.cause
    assert 30.0 < run.largest <= bound(config)
    assert run.last < 1.0


OFTEN = {"run": {"duration_s": 2.0, "period_ms": 4}, "controller": {"sample_ms": 4}}
SOFT = {"task": {"expected_stiffness_n_m": 5e3}}
DOUBLED = fault("wire", "twice", probability=1.0, way="to")
STRAYS: dict[str, tuple[Config, str]] = {
    "EGM queues each answer that comes twice": (streamed("egm", **OFTEN, **SOFT, faults=[DOUBLED]), "behind"),
    "from the first contact on": (
        streamed("egm", **OFTEN, **SOFT, faults=[DOUBLED | {"phase": "track"}]),
        "ahead of",
    ),
    "HOLDON = 1 repeats a step of relative mode": (
        streamed(
            "rsi",
            cell={"rsi": {"mode": "relative", "holdon": "keep"}},
            faults=[fault("wire", "reordered")],
        ),
        "ahead of",
    ),
}


@pytest.mark.parametrize(("config", "side"), STRAYS.values(), ids=STRAYS)
def test_drifting_robot_is_stopped(guarded: Run, config: Config, side: str) -> None:
    run = guarded(config)
    assert f"mm {side} all that was ordered in the last" in run.cause
    assert run.largest <= bound(config)


def test_stuck_sensor_with_jitter_is_detected() -> None:
    """Found by a campaign of 10 000 seeds: the jitter changed a dead force by 3e-5 N. The tool pressed with 101 N.

    With this seed the force gets stuck well below the desired one, so the tool continues to press.
    """
    result = hil_bridge.simulate(
        {
            "run": {"seed": 7836, "period_ms": 20, "duration_s": 2.5},
            "robot": {"emulated": "rtde"},
            "sensor": {"emulated": "ft300"},
            "controller": {"sample_ms": 20},
            "task": {"retract_mm": 3.0},
            "limits": {"witness_n": 0.0},  # the robot's own force would reveal it earlier
            "cell": {"start_position_mm": [900.0, -100.0, 592.0]},
        },
        faults=[{"on": "signal", "fault": "stuck", "phase": "track", "after_s": 0.1}],
    )
    assert "the force stayed at" in result.recording.end["text"]
    assert max(math.hypot(*truth.force) for truth in result.recording.truths) < 20.0


@pytest.mark.parametrize("by", [-1000, -3, 50, 1000])
def test_single_wrong_egm_number_is_tolerated(guarded: Run, by: int) -> None:
    """It once ended the movement, and the tool stayed pressed with 11 N."""
    stray = {"on": "wire", "fault": "wrong-seqno", "phase": "track", "after_s": 0.5, "with": {"by": by}}
    run = guarded(streamed("egm", faults=[stray]))
    assert run.result.outcome is Outcome.COMPLETED
    assert run.last == 0.0


@pytest.mark.parametrize(
    ("robot", "jump"),
    [
        ("egm", {"on": "wire", "fault": "wrong-seqno", "with": {"count": 50, "by": -1000}}),
        ("rsi", {"on": "robot", "fault": "clock-jump", "with": {"ms": -5000}}),
        ("rsi", {"on": "robot", "fault": "clock-jump", "with": {"ms": -500}}),
        ("rsi", {"on": "robot", "fault": "clock-jump", "with": {"ms": 5000}}),
    ],
)
def test_restarted_numbering_leaves_no_tool_pressed(guarded: Run, robot: str, jump: dict[str, Any]) -> None:
    run = guarded(streamed(robot, faults=[jump | {"phase": "track", "after_s": 0.5}]))
    assert run.result.outcome is Outcome.STOPPED
    assert run.result.left.startswith("retracted")
    assert run.last == 0.0
