"""One cycle's decision: task, controller and supervisor in the task frame."""

import math
from dataclasses import replace

import pytest

from hil_bridge.control import (
    ControlLoop,
    Limits,
    LoopState,
    Phase,
    Sample,
    Stop,
    Supervisor,
    Task,
    TaskParameters,
    make_controller,
)

START = (0.9, -0.1, 0.6)
LOOP = ControlLoop(
    Task(TaskParameters(), make_controller("resolution-aware")),
    Supervisor(Limits()),
    approach=(0.0, 0.0, -1.0),
    travel=(0.0, 1.0, 0.0),
)


def sample(k: int, force: float = 0.0, depth: float = 0.0) -> Sample:
    return Sample(
        now=10.0 + k * 0.2,
        position=(START[0], START[1], START[2] - depth),
        force=force,
        resultant=abs(force),
        sensor_at=9.999 + k * 0.2,
        sensor_sequence=20 * k,
    )


def in_contact() -> LoopState:
    """After three steps of approach and two samples of tracking."""
    state = LOOP.initial(START)
    for k, force in enumerate((0.0, 0.0, 0.0, 3.0, 8.0)):
        state, _ = LOOP.step(state, sample(k, force, depth=0.0005 * k))
    assert state.task.phase is Phase.TRACK
    return state


def test_depth_is_measured_and_commanded_along_the_approach_direction() -> None:
    state, decision = LOOP.step(LOOP.initial(START), sample(0, depth=0.002))
    assert decision.depth == pytest.approx(0.002)
    assert decision.position == pytest.approx((0.9, -0.1, 0.6 - 0.0005))
    assert (decision.target.depth, decision.verdict.kind, decision.reasons) == (
        pytest.approx(0.0005),
        "allow",
        (),
    )
    assert state.supervisor.depth == pytest.approx(0.0005)


def test_travel_moves_along_the_surface_while_tracking() -> None:
    _, decision = LOOP.step(in_contact(), sample(5, 9.0, 0.0025))
    assert decision.target.travel == pytest.approx(0.003)
    assert decision.position[1] == pytest.approx(-0.1 + 0.003)


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        ({"force": 51.0}, "beyond 50 N"),
        ({"force": math.nan}, "no number"),
        ({"sensor_at": 1.0}, "ms old"),
        ({"saturated": True}, "end of its range"),
        ({"fault": "force sensor on can0 restarted"}, "force sensor on can0 restarted"),
        ({"repeated_frames": 500}, "repeated the same counts"),
    ],
)
def test_a_stop_pulls_back_in_the_same_cycle_and_stays(wrong: dict[str, object], text: str) -> None:
    before = in_contact()
    state, decision = LOOP.step(before, replace(sample(5, 9.0, 0.0025), **wrong))  # type: ignore[arg-type]
    assert isinstance(decision.verdict, Stop)
    assert text in decision.reasons[0]
    assert (decision.output.phase, decision.output.failed) == (Phase.RETRACT, True)
    assert decision.target.depth == pytest.approx(before.supervisor.depth - 0.001)
    cycles = 0
    while not decision.ended:
        state, decision = LOOP.step(state, sample(6 + cycles, 0.0))
        assert text in decision.output.cause
        cycles += 1
    assert decision.target.depth == pytest.approx(before.supervisor.depth - 0.020)
    assert state.supervisor.stopped is not None
    assert cycles == 20


def test_finishing_is_no_failure() -> None:
    state, decision = LOOP.step(LOOP.finish(in_contact(), "time is up"), sample(5, 9.0, 0.0025))
    assert (decision.output.phase, decision.output.cause, decision.output.failed) == (
        Phase.RETRACT,
        "time is up",
        False,
    )
    assert state.supervisor.stopped is None


def test_a_retraction_held_by_the_workspace_ends_there() -> None:
    loop = replace(LOOP, supervisor=Supervisor(Limits(workspace_max_m=(3.0, 3.0, 0.602))))
    state = loop.finish(loop.initial(START), "interrupted")
    decisions = []
    for k in range(10):
        state, decision = loop.step(state, sample(k))
        decisions.append(decision)
        if decision.ended:
            break
    assert decisions[-1].position[2] == pytest.approx(0.602)
    assert decisions[-1].reasons == ("leaves the workspace",)
    assert len(decisions) <= 4
