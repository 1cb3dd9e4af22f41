"""Small model of the guard: it keeps its rules, detects planted mistakes, and accepts guarded runs."""

import json
from dataclasses import replace
from typing import Any

import pytest
from msgspec.structs import replace as changed

from hil_bridge import api
from hil_bridge.control import Phase
from hil_bridge.control.course.intent import CONNECT, TARE
from hil_bridge.control.course.verdict import Stage
from hil_bridge.errors import Cause
from hil_bridge.errors.cause_row import Reaction, When
from hil_bridge.errors.cause_table import ROWS
from hil_bridge.lab.invariants.model import (
    ASKS,
    AT_REST,
    CYCLES,
    ENDS,
    FOLLOWS,
    LOOKS,
    STAGES,
    STRONGEST,
    GuardModel,
    Way,
)
from hil_bridge.lab.invariants.tracing import first_unaccepted
from hil_bridge.record import EventKind, EventRecord, Recording
from tests.guard.guard_search import GuardRule, search
from tests.recordings import Recordings

pytestmark = pytest.mark.sweep

MODEL = GuardModel()
NEAR: dict[str, Any] = {
    "run": {"duration_s": 0.5},
    "task": {"retract_mm": 2.0},
    "cell": {"start_position_mm": [900.0, -100.0, 591.0]},
}
PROGRAM: dict[str, Any] = {
    **NEAR,
    "robot": {"emulated": "egm"},
    "task": {
        "retract_mm": 2.0,
        "step": [
            {"do": "approach"},
            {"do": "hold", "for_s": 0.3},
            {"do": "retract", "back_mm": 1.0},
            {"do": "zero", "settle_ms": 100.0, "for_ms": 100.0},
            {"do": "move", "to_mm": [2.0, 0.0]},
            {"do": "approach"},
            {"do": "track", "path": {"kind": "line", "to_mm": [4.0, 0.0]}, "speed_mm_s": 8.0},
            {"do": "retract"},
        ],
    },
}


def with_row(cause: Cause, **changes: Any) -> GuardModel:
    return replace(MODEL, rows={**ROWS, cause: replace(ROWS[cause], **changes)})


def test_model_every_rule_holds_in_every_state() -> None:
    result = search(MODEL)
    assert result.broken == {}
    assert result.held == tuple(GuardRule)
    assert result.states > 50
    assert result.steps > 1_000_000


def test_model_contains_every_phase() -> None:
    assert set(Phase) | {CONNECT, TARE} <= set(LOOKS)
    assert set(STAGES) == set(Stage)
    assert set(STRONGEST) == set(Reaction)
    assert set().union(*LOOKS.values()) | {When.READING} == set(When)


WRONG_MODELS: dict[str, tuple[GuardRule, GuardModel]] = {
    "a retraction asks for deeper": (
        GuardRule.DEEPER,
        replace(MODEL, asks={**ASKS, Phase.RETRACT: frozenset(Way)}),
    ),
    "a run that ends continues to press": (
        GuardRule.FORWARD,
        replace(MODEL, ends={**ENDS, Phase.RETRACT: frozenset({Phase.RETRACT, Phase.TRACK})}),
    ),
    "the zero is taken again behind the cycles": (
        GuardRule.FORWARD,
        replace(MODEL, follows={**FOLLOWS, Phase.TRACK: CYCLES | {TARE}}),
    ),
    "the way to the zero goes deeper": (GuardRule.LIFT, replace(MODEL, asks={**ASKS, TARE: frozenset(Way)})),
    "orders are believed instead of what is found": (GuardRule.TOLD, replace(MODEL, trusts_orders=True)),
    "the weaker of two reactions is taken": (
        GuardRule.STILL,
        replace(MODEL, strongest=tuple(reversed(STRONGEST))),
    ),
    "nothing leads out of a retraction by orders": (
        GuardRule.WAY_OUT,
        replace(MODEL, ends={**ENDS, AT_REST: frozenset()}),
    ),
    "a retraction waits again and again": (
        GuardRule.STAGE,
        replace(MODEL, stages={**STAGES, Stage.SLOW: frozenset({Stage.SLOW, Stage.WAITS})}),
    ),
    "a clamp has the exit code of a stop": (GuardRule.CLAMP, with_row(Cause.BARRIER, exit_code=3)),
    "a run is refused while it moves": (
        GuardRule.REFUSED,
        with_row(Cause.FORCE, reaction=Reaction.REFUSED),
    ),
    "a retraction does not look behind the tool": (
        GuardRule.LOOKED,
        replace(MODEL, looks={phase: whens - {When.RETRACTION} for phase, whens in LOOKS.items()}),
    ),
}


@pytest.mark.parametrize("name", WRONG_MODELS)
def test_mutated_model_breaks_a_rule(name: str) -> None:
    rule, wrong = WRONG_MODELS[name]
    assert rule in search(wrong).broken


def test_broken_rule_is_reported_with_its_trace() -> None:
    path = search(WRONG_MODELS["a retraction asks for deeper"][1]).broken[GuardRule.DEEPER]
    assert path[-1].way is Way.DEEPER
    assert [step.after.phase for step in path][-2:] == [Phase.RETRACT, Phase.RETRACT] or len(path) > 1


# --- recordings


@pytest.fixture
def plain(recordings: Recordings) -> Recording:
    return recordings(NEAR)


@pytest.fixture
def stopped(recordings: Recordings) -> Recording:
    """A run that a force beyond the limit ended."""
    step = {
        "on": "signal",
        "fault": "offset",
        "phase": "track",
        "after_s": 0.2,
        "with": {"amount": 60.0},
        "for_s": 0.3,
    }
    return recordings(NEAR, faults=[step])


@pytest.fixture
def program(recordings: Recordings) -> Recording:
    return recordings(PROGRAM)


def phase_of(recording: Recording, phase: str) -> int:
    """Number of the second cycle of a phase."""
    return next(cycle.cycle for cycle in recording.cycles if cycle.phase == phase) + 1


def altered(recording: Recording, number: int, **changes: Any) -> Recording:
    cycles = list(recording.cycles)
    cycles[number] = changed(cycles[number], **changes)
    return replace(recording, cycles=tuple(cycles))


def ended(recording: Recording, **changes: str) -> Recording:
    return replace(recording, end={**recording.end, **changes})


def rest_of(recording: Recording, **values: Any) -> Recording:
    return ended(recording, rest=json.dumps(json.loads(recording.end["rest"]) | values))


def refused_at(recording: Recording) -> int | None:
    result = first_unaccepted(recording, MODEL)
    return None if result is None else result.cycle


def test_model_accepts_guarded_runs(plain: Recording, stopped: Recording, program: Recording) -> None:
    assert stopped.end["cause"] == Cause.FORCE
    assert [refused_at(each) for each in (plain, stopped, program)] == [None, None, None]


def test_model_rejects_deeper_order_after_stop(stopped: Recording) -> None:
    number = len(stopped.cycles) - 3
    deeper = stopped.cycles[number - 1].depth_commanded + 2e-6
    assert refused_at(altered(stopped, number, depth_commanded=deeper)) == number


def test_model_rejects_deeper_order_in_stop_cycle(stopped: Recording) -> None:
    number = next(cycle.cycle for cycle in stopped.cycles if cycle.verdict == "stop")
    deeper = stopped.cycles[number - 1].depth_commanded + 2e-6
    assert refused_at(altered(stopped, number, depth_commanded=deeper)) == number


def test_model_rejects_backward_phase(plain: Recording, stopped: Recording) -> None:
    for recording in (plain, stopped):
        number = phase_of(recording, "retract")
        assert refused_at(altered(recording, number, phase="track")) == number


def test_model_rejects_phase_of_other_step(program: Recording) -> None:
    number = phase_of(program, "zero")
    assert refused_at(altered(program, number, phase="move")) == number


def test_model_rejects_inward_motion_in_zero(program: Recording) -> None:
    number = phase_of(program, "zero")
    depth = program.cycles[number].depth_commanded + 1e-4
    assert refused_at(altered(program, number, depth_commanded=depth)) == number


def test_model_rejects_unreported_end_in_contact(plain: Recording) -> None:
    assert refused_at(rest_of(plain, depth_m=3e-3)) == len(plain.cycles)


def test_model_rejects_end_without_retraction(plain: Recording) -> None:
    """The cycles end while the tool presses, and the end says that it was retracted."""
    number = phase_of(plain, "track")
    assert refused_at(replace(plain, cycles=plain.cycles[:number])) == number


def test_model_rejects_completed_stop(stopped: Recording) -> None:
    assert refused_at(ended(stopped, outcome="completed", cause="time-is-up")) == len(stopped.cycles)


def test_model_rejects_failure_without_stop(plain: Recording) -> None:
    assert refused_at(ended(plain, outcome="stopped")) == len(plain.cycles)


def test_model_rejects_condition_at_wrong_time(plain: Recording) -> None:
    number = phase_of(plain, "track")
    at = plain.cycles[number].controlled_at
    events = (*plain.events, EventRecord(at, EventKind.STOP, "planted", Cause.WEIGHT))
    assert refused_at(replace(plain, events=tuple(sorted(events, key=lambda event: event.at)))) == number


def test_model_rejects_motion_during_halt(stopped: Recording) -> None:
    number = len(stopped.cycles) - 3
    event = EventRecord(stopped.cycles[number].controlled_at, EventKind.THEN, "planted", Cause.BEHIND)
    events = tuple(sorted((*stopped.events, event), key=lambda event: event.at))
    assert refused_at(replace(stopped, events=events)) == number


def test_model_needs_final_state_after_motion(plain: Recording) -> None:
    assert refused_at(ended(plain, rest="")) == len(plain.cycles)


FAULTS: dict[str, dict[str, Any]] = {
    "an emergency stop": {"on": "robot", "fault": "emergency-stop", "phase": "track"},
    "a dead link": {"on": "wire", "fault": "off", "phase": "track", "for_s": 600.0},
    "a silent sensor": {"on": "sensor-wire", "fault": "off", "phase": "track", "for_s": 60.0},
    "a surface that rises": {"on": "surface", "fault": "step", "phase": "track", "with": {"mm": 5.0}},
    "a sensor without its tool": {"on": "signal", "fault": "dead", "phase": "connect"},
    "a refused point": {"on": "robot", "fault": "refuses", "phase": "approach", "after_s": 0.3},
    "a key turned on the way to the zero": {
        "on": "robot",
        "fault": "key-manual",
        "phase": "tare",
        "after_s": 0.5,
    },
}


@pytest.mark.parametrize("name", FAULTS)
def test_model_accepts_all_kinds_of_ends(name: str, recordings: Recordings) -> None:
    fault = FAULTS[name]
    recording = recordings(NEAR, faults=[fault], refused=True)
    assert recording.end["outcome"] == "stopped"
    assert refused_at(recording) is None


def test_model_accepts_operator_end_in_long_retraction() -> None:
    steps = [{"do": "approach"}, {"do": "retract", "back_mm": 12.0}, {"do": "approach"}, {"do": "retract"}]

    async def main() -> api.Simulation:
        config = {**PROGRAM, "task": {"retract_mm": 0.5, "step": steps}}
        async with api.simulation(config) as running:
            await running.reached("retract")
            await running.clock.sleep_until(running.clock.now() + 0.7)
            running.interrupt()
            await running.finished()
        return running

    recording = api.run_virtual(main).result.recording
    assert recording.cycles[-2].depth_commanded < -0.5e-3  # farther back than task.retract_mm
    assert refused_at(recording) is None
