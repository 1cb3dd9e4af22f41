"""Checkers of the guard's promises: silent for a healthy run, and each detects its planted violation."""

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace as changed

import hil_bridge
from hil_bridge.devices.kinds import ROBOTS, SENSORS, EmulatedKinds
from hil_bridge.errors import Cause, GateStop
from hil_bridge.lab.invariants import (
    CHECKERS,
    VOIDS,
    Evidence,
    Promise,
    Trace,
    World,
    added_n,
    broken_promises,
    promises_broken,
    stated_bound_n,
    violation_text,
)
from hil_bridge.record import EventRecord, Recording
from hil_bridge.settings.faults import FaultConfig

Plant = Callable[[Evidence], Evidence]


@pytest.fixture(scope="module")
def healthy() -> Evidence:
    """A run without a fault, with its truth until a second after its end."""
    config = hil_bridge.load(
        {
            "run": {"duration_s": 1.0},
            "task": {"retract_mm": 2.0},
            "cell": {"start_position_mm": [900.0, -100.0, 591.0]},
        }
    )
    result = hil_bridge.simulate(config)
    truths = result.recording.truths
    times = np.array([truth.at for truth in truths] + [truths[-1].at + 1.0])
    forces = np.array([float(np.linalg.norm(truth.force)) for truth in truths] + [0.0])
    positions = np.array([truth.position for truth in truths] + [truths[-1].position])
    return Evidence(result.recording, config, Trace(times, forces, positions), 0)


def recorded(evidence: Evidence, **other: Any) -> Evidence:
    return replace(evidence, recording=replace(evidence.recording, **other))


def traced(evidence: Evidence, **other: Any) -> Evidence:
    assert evidence.trace is not None
    return replace(evidence, trace=replace(evidence.trace, **other))


def rest(evidence: Evidence, **values: Any) -> Evidence:
    data = json.loads(evidence.recording.end["rest"]) | values
    return recorded(evidence, end={**evidence.recording.end, "rest": json.dumps(data)})


def with_event(evidence: Evidence, kind: str, cause: Cause | None = None) -> Evidence:
    at = evidence.recording.cycles[-5].sent_at
    return recorded(evidence, events=(*evidence.recording.events, EventRecord(at, kind, "planted", cause)))


def gated(evidence: Evidence) -> Evidence:
    return with_event(evidence, "then", GateStop("stopped").reason(Cause.BUG).cause)


def last(array: Any, value: float) -> Any:
    return np.append(array[:-1], value)


def deeper_after_stop(evidence: Evidence) -> Evidence:
    cycles = evidence.recording.cycles
    deeper = changed(cycles[-1], depth_commanded=cycles[-2].depth_commanded + 2e-6)
    planted = with_event(evidence, "stop")
    return recorded(planted, cycles=(*cycles[:-1], deeper))


def hard(evidence: Evidence) -> Evidence:
    """A tenth of a second beyond the bound."""
    assert evidence.trace is not None
    forces = evidence.trace.forces.copy()
    forces[3] = 500.0
    return traced(evidence, forces=forces)


def jump(evidence: Evidence) -> Evidence:
    assert evidence.trace is not None
    assert evidence.trace.positions is not None
    positions = evidence.trace.positions.copy()
    positions[5:, 2] += 0.1
    data = json.loads(evidence.recording.end["rest"])["depth_m"]
    return rest(traced(evidence, positions=positions), depth_m=data - 0.1)


def decided_otherwise(evidence: Evidence) -> Evidence:
    cycles = evidence.recording.cycles
    other = changed(cycles[4], depth_commanded=cycles[4].depth_commanded - 1e-9)
    return recorded(evidence, cycles=(*cycles[:4], other, *cycles[5:]))


def tracks_again(evidence: Evidence) -> Evidence:
    """The last cycle tracks, behind the retraction."""
    cycles = [*evidence.recording.cycles]
    cycles[-1] = changed(cycles[-1], phase="track")
    return recorded(evidence, cycles=tuple(cycles))


def clamped_in_usual_order(evidence: Evidence) -> Evidence:
    cycles = evidence.recording.cycles
    other = changed(cycles[4], verdict="clamp")
    return replace(evidence, usual=replace(evidence.recording, cycles=(*cycles[:4], other, *cycles[5:])))


def shorter_in_usual_order(evidence: Evidence) -> Evidence:
    return replace(evidence, usual=replace(evidence.recording, cycles=evidence.recording.cycles[:-1]))


PLANTS: dict[str, tuple[Promise, Plant]] = {
    "order deeper": (Promise.ORDERS, deeper_after_stop),
    "pressing end": (
        Promise.END,
        lambda run: traced(rest(run, force_n=None), forces=last(run.truth.forces, 30.0)),  # type: ignore[union-attr]
    ),
    "other force": (Promise.LAST_LINE, lambda run: rest(run, force_n=25.0)),
    "other depth": (Promise.LAST_LINE, lambda run: rest(run, depth_m=0.02)),
    "beyond": (Promise.BOUND, hard),
    "fast": (Promise.SPEED, jump),
    "gate": (Promise.GATE, gated),
    "bug": (Promise.BUG, lambda run: with_event(run, "bug")),
    "decided otherwise": (Promise.REPLAY, decided_otherwise),
    "cut": (Promise.WHOLE, lambda run: recorded(run, truncated=True)),
    "no end": (Promise.WHOLE, lambda run: recorded(run, end={})),
    "phase goes back": (Promise.MODEL, tracks_again),
    "decides by order": (Promise.ORDER, clamped_in_usual_order),
    "ends by order": (Promise.ORDER, shorter_in_usual_order),
    "exit code": (Promise.EXIT, lambda run: replace(run, exit_code=3)),
}


def test_healthy_run_keeps_every_promise(healthy: Evidence) -> None:
    assert json.loads(healthy.recording.end["rest"])["retracted"] is True
    assert broken_promises(healthy) == ()


@pytest.mark.parametrize("name", PLANTS)
def test_planted_violation_is_the_only_finding(healthy: Evidence, name: str) -> None:
    promise, plant = PLANTS[name]
    violations = broken_promises(plant(healthy))
    others = (
        {Promise.REPLAY} if name in ("order deeper", "phase goes back") else set()
    )  # it decides as it did
    if name in ("order deeper", "gate", "other depth"):  # the model sees them too
        others |= {Promise.MODEL}
    assert {violation.promise for violation in violations} == {promise} | others
    text = next(violation_text(one) for one in violations if one.promise is promise)
    assert text.startswith(f"{promise}: ")
    assert "{" not in text
    assert "\n" not in text


def model_text(evidence: Evidence) -> str:
    """Text of the promise of the model alone."""
    (text,) = (violation_text(one) for one in broken_promises(evidence) if one.promise is Promise.MODEL)
    return text


def test_unaccepted_cycle_is_named_with_time_phase_and_causes(healthy: Evidence) -> None:
    cycle = healthy.recording.cycles[-1]
    assert model_text(tracks_again(healthy)) == (
        f"model-accepts: the model of the guard does not accept cycle {cycle.cycle} "
        f"(phase: track; causes: none; order: same) at {cycle.started_at:.2f} s of the run's clock"
    )
    assert "(phase: retract; causes: weight; order: " in model_text(with_event(healthy, "stop", Cause.WEIGHT))


def test_unaccepted_end_is_named_with_outcome_and_cause(healthy: Evidence) -> None:
    assert (
        f"does not accept the end of the run after {len(healthy.recording.cycles)} cycles "
        "(outcome: completed; cause: time-is-up) at "
    ) in model_text(rest(healthy, depth_m=0.02))


def test_every_promise_has_checker_and_violation() -> None:
    assert set(CHECKERS) == set(Promise) == {promise for promise, _ in PLANTS.values()}


def test_unknown_force_is_not_a_violation(healthy: Evidence) -> None:
    assert healthy.trace is not None
    forces = last(healthy.trace.forces, 30.0)
    unknown = rest(traced(healthy, forces=forces), force_n=None, retracted=False)
    end = {**unknown.recording.end, "outcome": "stopped", "cause": Cause.CELL_FAILED}
    stopped = recorded(unknown, end=end)
    assert broken_promises(replace(stopped, exit_code=3)) == ()


def faulted(evidence: Evidence, *faults: dict[str, Any]) -> Evidence:
    """The same run as one with these faults."""
    rows = tuple(FaultConfig.model_validate(fault) for fault in faults)
    return replace(evidence, config=evidence.config.model_copy(update={"faults": rows}))


ADDED: list[tuple[dict[str, Any], float]] = [
    ({"on": "surface", "fault": "step", "phase": "track"}, 5.0),  # 1 mm at 5 kN/m
    ({"on": "surface", "fault": "step", "phase": "track", "with": {"mm": -4.0}}, 20.0),
    ({"on": "surface", "fault": "swings", "phase": "track"}, 10.0),
    ({"on": "surface", "fault": "rises", "phase": "track", "for_s": 0.5, "with": {"mm_s": 20.0}}, 50.0),
    ({"on": "surface", "fault": "rises", "phase": "track", "for_s": 0.5, "with": {"mm_s": -20.0}}, 0.0),
    ({"on": "signal", "fault": "offset", "phase": "track"}, 20.0),
    (
        {"on": "signal", "fault": "offset", "phase": "connect"},
        1.0,
    ),  # the check before the run finds all but 1 N
    ({"on": "signal", "fault": "scale", "phase": "connect", "with": {"factor": 0.8}}, 0.0),
    (
        {"on": "signal", "fault": "scale", "phase": "connect", "with": {"factor": 0.9}},
        100.0 / 9.0,
    ),  # 0.6 N of weight
    ({"on": "signal", "fault": "offset", "phase": "track", "with": {"axis": "mx"}}, 0.0),
    ({"on": "signal", "fault": "drift", "phase": "track", "for_s": 2.0, "with": {"per_s": -0.5}}, 1.0),
    ({"on": "signal", "fault": "scale", "phase": "track", "with": {"factor": 0.8}}, 25.0),
    ({"on": "signal", "fault": "scale", "phase": "track", "with": {"factor": 2.0}}, 0.0),
    ({"on": "signal", "fault": "dead", "phase": "track", "with": {"axis": "fx"}}, 0.0),  # across the approach
    ({"on": "signal", "fault": "dead", "phase": "track"}, 75.0),  # 15 mm of approach
    ({"on": "signal", "fault": "dead", "phase": "tare", "after_s": 0.1}, 75.0),
    ({"on": "signal", "fault": "dead", "phase": "connect"}, 0.0),
    ({"on": "sensor-wire", "fault": "late", "phase": "track", "with": {"ms": 100.0}}, 5.5),
    ({"on": "sensor-wire", "fault": "late", "phase": "track", "with": {"ms": 5000.0}}, 11.0),
    ({"on": "sensor-wire", "fault": "late", "phase": "connect", "with": {"ms": 5000.0}}, 275.0),
    ({"on": "sensor-wire", "fault": "twice", "phase": "track"}, 0.0),
    ({"on": "pose", "fault": "offset", "phase": "track", "with": {"x_mm": 3.0, "z_mm": 4.0}}, 25.0),
    ({"on": "pose", "fault": "offset", "phase": "track", "with": {"z_mm": 400.0}}, 50.0),
    ({"on": "computer", "fault": "pause", "phase": "track", "with": {"seconds": 0.2}}, 11.0),
]
"""Faults, and what each adds to the bound at 5 kN/m and 11 mm/s, N."""


@pytest.mark.parametrize(("fault", "newtons"), ADDED, ids=lambda value: str(value)[:60])
def test_fault_adds_its_value_to_the_bound(fault: dict[str, Any], newtons: float) -> None:
    config = hil_bridge.load({"cell": {"tool": {"mass_kg": 0.6}}})
    world = World(config, 5e3, 11e-3, 0.3, 20.0, (0.0, 0.0, -1.0))
    assert added_n([FaultConfig.model_validate(fault)], world) == pytest.approx(newtons)


def test_rising_surface_adds_its_rise_to_the_bound(healthy: Evidence) -> None:
    """A rise by 10 mm adds 50 N: 40 N beyond the bound are those of the surface, of 60 N the guard has 10 N."""
    fault = {"on": "surface", "fault": "step", "phase": "track", "with": {"mm": 10.0}}
    assert healthy.trace is not None
    for beyond_n, broken in ((40.0, []), (60.0, [Promise.BOUND])):
        forces = healthy.trace.forces.copy()
        forces[3] = stated_bound_n(healthy) + beyond_n
        violations = broken_promises(faulted(traced(healthy, forces=forces), fault))
        assert [violation.promise for violation in violations] == broken


def test_side_force_has_bound_of_resultant(healthy: Evidence) -> None:
    assert healthy.trace is not None
    vectors = np.zeros((len(healthy.trace.times), 3))
    for side_n, broken in ((90.0, []), (300.0, [Promise.BOUND])):
        vectors[3] = side_n, 0.0, 0.0
        violations = broken_promises(traced(healthy, forces=np.linalg.norm(vectors, axis=1), vectors=vectors))
        assert [violation.promise for violation in violations] == broken


@pytest.mark.parametrize("on", sorted({row.on for row in VOIDS}))
def test_fault_does_not_excuse_false_retraction_report(healthy: Evidence, on: str) -> None:
    """A drift left 85 N, and the run reported "retracted, 0.0 N"."""
    row = next(row for row in VOIDS if row.on == on)
    fault = {"on": on, "fault": min(row.faults, default="above"), "phase": "track"}
    assert healthy.trace is not None
    pressed = traced(healthy, forces=np.full(len(healthy.trace.forces), 85.0))
    violations = {violation.promise for violation in broken_promises(faulted(pressed, fault))}
    assert {Promise.END, Promise.LAST_LINE} <= violations


@pytest.mark.parametrize(("on", "name"), [("surface", "swings"), ("obstacle", "above")])
def test_touch_after_newest_frame_is_no_violation(healthy: Evidence, on: str, name: str) -> None:
    """A surface that swings, and a tool that bounces off an obstacle."""
    assert healthy.trace is not None
    vectors = np.zeros((len(healthy.trace.times), 3))
    vectors[-1, 2] = 12.9
    pressed = traced(healthy, forces=last(healthy.trace.forces, 12.9), vectors=vectors)
    touched = faulted(pressed, {"on": on, "fault": name, "phase": "track"})
    for evidence in (touched, rest(touched, unverified=["Fx"])):
        assert not {Promise.END, Promise.LAST_LINE} & {one.promise for one in broken_promises(evidence)}


def test_sag_of_arm_is_no_false_depth(healthy: Evidence) -> None:
    """The true tip lies off the reported one from the start."""
    assert healthy.trace is not None
    assert healthy.trace.positions is not None
    sagging = replace(healthy.trace, positions=healthy.trace.positions - [0.0, 0.0, 5e-3])
    assert Promise.LAST_LINE not in {one.promise for one in broken_promises(replace(healthy, trace=sagging))}


@pytest.mark.parametrize(("force_n", "is_violation"), [(60.0, False), (0.0, True)])
def test_deflection_under_contact_force_is_no_false_depth(
    healthy: Evidence, force_n: float, is_violation: bool
) -> None:
    """The encoders do not measure it."""
    trace, depth_m = healthy.trace, json.loads(healthy.recording.end["rest"])["depth_m"]
    assert trace is not None
    pressed = traced(healthy, forces=np.full(len(trace.forces), force_n))
    violations = broken_promises(rest(pressed, force_n=force_n, depth_m=depth_m - 4e-3, retracted=False))
    assert any(one.promise is Promise.LAST_LINE for one in violations) == is_violation


def test_surface_that_comes_to_resting_tool_is_no_false_end(healthy: Evidence) -> None:
    assert healthy.trace is not None
    end = {key: value for key, value in healthy.recording.end.items() if key != "rest"}
    forces = np.where(healthy.trace.times > healthy.trace.times[0], 60.0, 0.0)
    pressed = recorded(traced(healthy, forces=forces), end=end)
    assert Promise.END in {one.promise for one in broken_promises(pressed)}
    rises = faulted(pressed, {"on": "surface", "fault": "rises", "phase": "connect", "with": {"mm_s": 0.1}})
    assert Promise.END not in {one.promise for one in broken_promises(rises)}


def test_hardening_surface_does_not_excuse_end_force(healthy: Evidence) -> None:
    """The tool does not move, so the newest force counts."""
    assert healthy.trace is not None
    pressed = traced(healthy, forces=last(healthy.trace.forces, 12.9))
    hardens = faulted(pressed, {"on": "surface", "fault": "hard", "phase": "track"})
    assert {Promise.END, Promise.LAST_LINE} <= {one.promise for one in broken_promises(hardens)}


def test_end_with_unverified_axes_counts_as_reported(healthy: Evidence) -> None:
    assert healthy.trace is not None
    both = {Promise.END, Promise.LAST_LINE}
    pressed = traced(healthy, forces=last(healthy.trace.forces, 30.0))
    assert {one.promise for one in broken_promises(pressed)} == both
    assert broken_promises(rest(pressed, unverified=["fx"])) == ()
    vectors = np.zeros((len(healthy.trace.times), 3))
    vectors[-1, 0] = 30.0  # along the sensor's x axis
    pressed = traced(pressed, vectors=vectors)
    assert broken_promises(rest(pressed, unverified=["Fx"])) == ()
    violations = {one.promise for one in broken_promises(rest(pressed, unverified=["Fy"]))}
    assert violations == both, "a fault of a lateral axis is no excuse"


@pytest.mark.parametrize("name", ["offset", "noise"])
def test_faulty_sensor_may_report_too_much(healthy: Evidence, name: str) -> None:
    fault = {"on": "signal", "fault": name, "phase": "track"}
    assert broken_promises(faulted(rest(healthy, force_n=25.0), fault)) == ()
    assert [one.promise for one in broken_promises(rest(healthy, force_n=25.0))] == [Promise.LAST_LINE]


def test_faulty_robot_is_off_only_by_its_value(healthy: Evidence) -> None:
    depth_m = json.loads(healthy.recording.end["rest"])["depth_m"]
    for name, off_m, broken in (
        ("offset", 5e-3, []),
        ("offset", 8e-3, [Promise.LAST_LINE]),
        ("frozen", 0.08, []),
        ("mirrored", 0.16, []),
        ("turned", 0.08, [Promise.LAST_LINE]),
    ):
        fault = {
            "on": "pose",
            "fault": name,
            "phase": "track",
            "with": {"z_mm": 5.0} if name == "offset" else {},
        }
        reported = faulted(rest(healthy, depth_m=depth_m + off_m), fault)
        assert [one.promise for one in broken_promises(reported, without=(Promise.MODEL,))] == broken


def test_table_names_existing_faults() -> None:
    known: dict[str, set[str]] = {}
    for robot in ROBOTS.own:
        for sensor in SENSORS.own:
            for on, faults in EmulatedKinds.named(robot, sensor).faults.items():
                known.setdefault(on, set()).update(faults)
    for row in VOIDS:
        assert row.faults <= known[row.on], row
        assert not row.voids & {Promise.BOUND, Promise.END, Promise.LAST_LINE}, "these have numbers, or none"


def test_recording_is_judged_by_its_own_truth(healthy: Evidence) -> None:
    truths = healthy.recording.truths
    pressed = (*truths[:4], changed(truths[4], force=(0.0, 0.0, 500.0)), *truths[5:])
    alone = Evidence(replace(healthy.recording, truths=pressed), healthy.config)
    assert [violation.promise for violation in broken_promises(alone)] == [Promise.BOUND]
    assert (
        broken_promises(Evidence(Recording(healthy.recording.cycles), healthy.config))[0].promise
        is Promise.WHOLE
    )


def test_recording_reports_broken_promise(healthy: Evidence) -> None:

    truths = healthy.recording.truths
    pressed = (*truths[:4], changed(truths[4], force=(0.0, 0.0, 500.0)), *truths[5:])
    assert promises_broken(healthy.recording) == ()
    (text,) = promises_broken(replace(healthy.recording, truths=pressed))
    assert text.startswith("bound-kept: the true force reached 500.0 N; bound: ")


def test_bound_includes_wall_harder_than_surface(healthy: Evidence) -> None:
    def bound_n(**surface: float) -> float:
        return stated_bound_n(replace(healthy, config=hil_bridge.load({"cell": {"surface": surface}})))

    soft, hard = bound_n(stiffness_n_m=5e3), bound_n(stiffness_n_m=5e4)
    assert soft < hard
    assert bound_n(stiffness_n_m=5e3, wall_stiffness_n_m=5e4) == soft, "there is no wall"
    assert bound_n(stiffness_n_m=5e3, wall_at_mm=20.0, wall_stiffness_n_m=5e4) == hard
    assert bound_n(stiffness_n_m=5e4, wall_at_mm=20.0, wall_stiffness_n_m=5e3) == hard
