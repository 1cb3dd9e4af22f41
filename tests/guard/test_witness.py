"""Second witness: a robot with its own force estimate, together with a wrong force sensor."""

import math
from collections.abc import Callable
from typing import Any

import pytest

import hil_bridge
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.verdict import Observation
from hil_bridge.control.course.witness import Witness, witness_of
from hil_bridge.errors import Cause
from hil_bridge.record import Outcome
from hil_bridge.runs.replay import recorded_config, replay
from hil_bridge.settings.configuration import Config
from tests.near_surface import awake_config
from tests.observed import observation

pytestmark = pytest.mark.sweep

Guarded = Any
Run = Callable[..., Guarded]
FOR_GOOD_S = 600.0
ROBOTS = pytest.mark.parametrize("robot", ["rtde", "egm"])
AXES = ("fx", "fy", "fz", "mx", "my", "mz")


def with_witness(robot: str, stiffness: float, *faults: dict[str, Any], **more: Any) -> Config:
    """Three seconds at 10 N with a robot that measures a force itself, and a Net F/T; `more` are further settings."""
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
    return awake_config(values)


def fault(on: str, name: str, phase: str = "approach", **how: Any) -> dict[str, Any]:
    """A fault that begins with a phase, in track half a second later, and does not end."""
    after_s = 0.5 if phase == "track" else 0.0
    return {"on": on, "fault": name, "phase": phase, "after_s": after_s, "for_s": FOR_GOOD_S, "with": how}


CELLS = pytest.mark.parametrize(("robot", "stiffness"), [("rtde", 5e4), ("egm", 5e3)])
"""Hard and soft surface, each with a robot that reports its own force differently."""
LIES: dict[str, tuple[dict[str, Any], ...]] = {
    "dead Fz": (fault("signal", "dead", "track"),),
    "a tenth": (fault("signal", "scale", "track"),),
    "drift the wrong way": (fault("signal", "drift", "track", per_s=6.0),),
}
EARLY_LIES: dict[str, tuple[dict[str, Any], ...]] = {
    "stuck": (fault("signal", "stuck"),),
    "free space replayed": (fault("signal", "replayed", length_s=0.3),),
    "noise on all axes": tuple(fault("signal", "dead", axis=axis) for axis in AXES),
    "dead Fz": (fault("signal", "dead"),),
    "a tenth": (fault("signal", "scale"),),
}
"""From the start of the approach: the rules for free space or for a doubtful touch may apply first."""
OFF = {"limits": {"witness_n": 0.0}}


@CELLS
@pytest.mark.parametrize("lie", LIES)
def test_witness_contradicts_wrong_sensor(guarded: Run, robot: str, stiffness: float, lie: str) -> None:
    run = guarded(
        with_witness(robot, stiffness, *LIES[lie], run={"duration_s": 4.0 if "drift" in lie else 2.0})
    )
    assert run.result.outcome is Outcome.STOPPED
    assert "the robot itself measures" in run.cause
    assert run.largest <= (45.0 if stiffness > 1e4 else 30.0)
    assert run.last == 0.0


@pytest.mark.parametrize("lie", EARLY_LIES)
def test_witness_bounds_wrong_force_in_approach(guarded: Run, lie: str) -> None:
    """By the first rule that detects it. The tests of the approach cover other robots, surfaces and start times."""
    run = guarded(with_witness("rtde", 5e4, *EARLY_LIES[lie], run={"duration_s": 1.0}))
    assert run.result.outcome is Outcome.STOPPED
    assert run.largest <= 40.0
    assert run.last == 0.0


@pytest.mark.full
def test_wrong_force_without_witness_presses_harder(guarded: Run) -> None:
    """A tenth of the force: the guard's other rules see a sensor that lives, and a surface that answers."""
    forces = [guarded(with_witness("egm", 5e4, *LIES["a tenth"], **more)).largest for more in ({}, OFF)]
    assert forces[1] > 1.5 * forces[0]


@ROBOTS
@pytest.mark.parametrize(
    ("name", "how"),
    [("dead", {}), ("stuck", {}), ("offset", {"z_n": -60.0}), ("scale", {"factor": 0.1}), ("nan", {})],
)
def test_wrong_witness_only_stops(guarded: Run, robot: str, name: str, how: dict[str, Any]) -> None:
    lying = fault("witness", name, "track", **how)
    run = guarded(with_witness(robot, 5e4, lying, run={"duration_s": 1.0}, task={"force_n": 8.0}))
    assert run.largest < 20.0
    assert run.last == 0.0
    stops = name == "offset"
    assert ("the robot itself measures" in run.cause) == stops
    assert run.result.left.startswith("NOT retracted" if stops else "retracted")


@pytest.mark.full
@ROBOTS
def test_silent_witness_has_no_effect(guarded: Run, robot: str) -> None:
    """The other rules detect stuck counts, no later than without a witness."""
    stuck = fault("signal", "stuck")
    both = with_witness(robot, 5e3, stuck, fault("witness", "dead"))
    without = with_witness(robot, 5e3, stuck, **OFF)
    forces = [guarded(config).largest for config in (both, without)]
    assert forces[0] == pytest.approx(forces[1], abs=0.5)


@pytest.mark.full
@CELLS
def test_witness_does_not_stop_healthy_run(guarded: Run, robot: str, stiffness: float) -> None:
    run = guarded(with_witness(robot, stiffness))
    assert run.result.left == "retracted, 0.0 N"
    differences = [abs(record.sample.witness - record.sample.force) for record in run.cycles]
    assert len(differences) > 100
    assert max(differences) < 9.0, "a difference of 12 N is normal"


def test_witness_denies_wrong_retraction_report(guarded: Run) -> None:
    """The witness counts at the end too, where its rule no longer stops anything."""
    late = {**fault("witness", "offset", "retract", z_n=93.0)}
    run = guarded(with_witness("rtde", 5e3, late, run={"duration_s": 0.5}))
    assert run.result.outcome is Outcome.STOPPED
    assert "after the retraction, the robot itself measures 93 N" in run.cause
    assert run.result.cause is Cause.LEFT_DISAGREEING
    assert run.result.left.startswith("NOT retracted: left at ")
    assert "(the robot itself measures 93 N)" in run.result.left
    assert run.result.rest is not None
    assert run.result.rest.values["force_n"] is None


def test_witness_stop_replays_identically() -> None:
    config = with_witness("rtde", 5e3, fault("signal", "dead", "track"), run={"duration_s": 1.0})
    recording = hil_bridge.simulate(config).recording
    assert "the robot itself measures" in recording.end["text"]
    again = list(replay(recording, recorded_config(recording, {}), forced=False))
    assert len(again) == len(recording.cycles)
    assert not any(cycle.differences for cycle in again)


RULE = Witness(12.0, 0.1)


def sample_of(force: float, witness: float | None, dt: float = 0.02) -> Observation:
    return observation(force, dt=dt, witness=witness)


@pytest.mark.parametrize(
    ("force", "witness", "cycles"),
    [
        (0.0, 93.0, 4),  # the first counts nothing, each other one twice: 0, 40, 80, 120 ms
        (93.0, 0.0, 4),
        (10.0, 21.9, None),
        (10.0, 22.1, 6),  # hardly more than is ordinary
        (40.0, 70.0, None),  # less than half is missing
        (40.0, None, None),
        (40.0, math.nan, None),
    ],
)
def test_witness_needs_large_lasting_difference(
    force: float, witness: float | None, cycles: int | None
) -> None:
    before, count = None, 0
    for _ in range(50):
        before = RULE.disagreed(before, sample_of(force, witness))
        count += 1
        if RULE.find_stop(before, sample_of(force, witness)) is not None:
            break
    assert (count if count < 50 else None) == cycles


def test_witness_restarts_after_agreement() -> None:
    before = RULE.disagreed(0.09, sample_of(10.0, 10.0))
    assert before is None
    assert RULE.disagreed(before, sample_of(0.0, 93.0)) == 0.0


@pytest.mark.parametrize(("setting_n", "ordinary_n"), [(None, 12.0), (5.0, 5.0), (0.0, None)])
def test_witness_setting_overrides_facts(setting_n: float | None, ordinary_n: float | None) -> None:
    rule = witness_of(Limits(witness_n=setting_n), 12.0, 0.01)
    assert (None if rule is None else rule.ordinary_n) == ordinary_n
    assert rule is None or rule.lasting_s == pytest.approx(0.12)
