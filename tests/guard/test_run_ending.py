"""Table of the stimuli that end a run, state by state."""

import asyncio
from itertools import product

import pytest

from hil_bridge import api
from hil_bridge.errors import BridgeError, Cause, Reason
from hil_bridge.record import CycleRecord, EventKind, EventRecord, Outcome
from hil_bridge.runs.ending import (
    FOLLOWED_MAX,
    TRANSITIONS,
    Act,
    Ending,
    RunState,
    Stimulus,
    result_after,
)
from hil_bridge.runs.result import RunResult
from hil_bridge.runs.watchers import Listener

ASKING = Stimulus.ASKED, Stimulus.ASKED_AGAIN, Stimulus.HUNG_UP_AGAIN
MOVING = RunState.MOVING, RunState.LEAVING, RunState.STOPPING
FORCE, WALL = Reason(Cause.FORCE, "60 N"), Reason(Cause.WALL, "30 N")


def ending_in(state: RunState) -> Ending:
    """An ending that has come to this state as a run does."""
    ending = Ending()
    if state is RunState.CLOSING:
        ending.ask(Cause.SIGNAL)
    elif state is not RunState.OPENING:
        ending.begin_movement()
    if state is RunState.LEAVING:
        ending.ask(Cause.SIGNAL)
    elif state is RunState.STOPPING:
        ending.fail(FORCE)
    elif state is RunState.ENDED:
        ending.end_movement()
    assert ending.state is state
    return ending


def test_table_has_every_stimulus_in_every_state() -> None:
    assert set(TRANSITIONS) == set(product(RunState, Stimulus))


@pytest.mark.parametrize("state", MOVING)
@pytest.mark.parametrize("stimulus", Stimulus)
def test_no_stimulus_ends_a_movement_without_retraction(state: RunState, stimulus: Stimulus) -> None:
    act, after, _ = TRANSITIONS[state, stimulus]
    assert act in (Act.RETRACT, Act.NOTE, Act.CONTINUE)
    assert after in MOVING
    if act is not Act.RETRACT:
        assert after is state, "the retraction continues"


@pytest.mark.parametrize("state", RunState)
@pytest.mark.parametrize("stimulus", ASKING)
def test_request_acts_as_the_table_says(state: RunState, stimulus: Stimulus) -> None:
    ending = ending_in(state)
    before, failed = ending.requested, ending.has_failed
    act, after, _ = TRANSITIONS[state, stimulus]
    assert ending.ask(Cause.KEY, stimulus) is act
    assert ending.state is after
    is_accepted = act in (Act.CLOSE, Act.RETRACT)
    assert ending.requested is (Cause.KEY if is_accepted and before is None else before)
    assert ending.has_failed is failed, "a request is not a failure"
    if is_accepted:
        ending.end_as_requested()
        assert ending.outcome is TRANSITIONS[state, stimulus].outcome


@pytest.mark.parametrize("state", RunState)
def test_failure_outside_cycles_waits_for_next_cycle(state: RunState) -> None:
    ending = ending_in(state)
    reason = ending.reason
    assert ending.fail_outside_cycles(WALL) is TRANSITIONS[state, Stimulus.FAILED].act
    assert (ending.state, ending.failed, ending.reason) == (state, WALL, reason)


@pytest.mark.parametrize("state", [RunState.MOVING, RunState.LEAVING, RunState.ENDED])
@pytest.mark.parametrize("stimulus", [Stimulus.FAILED, Stimulus.CANCELLED])
def test_first_failure_replaces_a_request(state: RunState, stimulus: Stimulus) -> None:
    if (state, stimulus) == (RunState.ENDED, Stimulus.CANCELLED):
        pytest.skip("a run that has ended keeps its result")
    ending = ending_in(state)
    if ending.requested is not None:
        ending.end_as_requested()
        assert ending.outcome is Outcome.INTERRUPTED
    ending.fail(FORCE, stimulus)
    assert (ending.outcome, ending.reason) == (Outcome.STOPPED, FORCE)
    assert ending.state is TRANSITIONS[state, stimulus].state


def test_further_failures_are_kept_once() -> None:
    ending = ending_in(RunState.STOPPING)
    assert not ending.follow(FORCE)
    assert ending.follow(WALL)
    assert not ending.follow(WALL)
    assert (ending.reason, ending.followed) == (FORCE, [WALL])
    reported = [ending.follow(Reason(Cause.WALL, f"{k} N")) for k in range(10)]
    assert reported.count(True) == FOLLOWED_MAX - 1


def test_request_before_the_movement_retracts_when_one_begins() -> None:
    ending = ending_in(RunState.CLOSING)
    ending.begin_movement()
    assert ending.state is RunState.LEAVING
    assert ending.end_as_requested() == Reason(Cause.SIGNAL)


@pytest.mark.parametrize(
    ("outcome", "error", "after", "followed"),
    [
        (Outcome.COMPLETED, BridgeError("the disk is full"), Outcome.STOPPED, 0),
        (Outcome.INTERRUPTED, BridgeError("the disk is full"), Outcome.INTERRUPTED, 1),
        (Outcome.STOPPED, BridgeError("the disk is full"), Outcome.STOPPED, 1),
        (Outcome.COMPLETED, asyncio.CancelledError(), Outcome.COMPLETED, 0),
    ],
)
def test_error_after_the_end_keeps_what_is_known(
    outcome: Outcome, error: BaseException, after: Outcome, followed: int
) -> None:
    result = result_after(RunResult(outcome, left="retracted, 0.0 N"), error)
    assert (result.outcome, len(result.followed), result.left) == (after, followed, "retracted, 0.0 N")


@pytest.mark.parametrize("phase", ["approach", "track", "retract"])
def test_cancelled_task_keeps_final_state(phase: str) -> None:
    kept: list[api.Simulation] = []

    async def main() -> None:
        async with api.simulation({"run": {"duration_s": 1.0}}, seed=7) as running:
            kept.append(running)
            task = running.start()
            await running.reached(phase)
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await running.finished()

    api.run_virtual(main)
    result = kept[0].result
    assert (result.outcome, result.cause) == (Outcome.STOPPED, Cause.CANCELLED)
    assert result.left.startswith("retracted")


def test_interrupt_before_start_prevents_run() -> None:
    kept: list[api.Simulation] = []

    async def main() -> None:
        async with api.simulation(None, seed=7) as running:
            kept.append(running)
            running.interrupt()
            await running.finished()

    api.run_virtual(main)
    assert (kept[0].result.outcome, kept[0].result.left) == (Outcome.INTERRUPTED, "")


def test_failure_after_last_cycle_is_reported() -> None:
    kept: list[api.Simulation] = []

    async def main() -> None:
        async with api.simulation({"run": {"duration_s": 1.0}}, seed=7) as running:
            kept.append(running)

            def hear(record: EventRecord) -> None:
                if (record.kind, record.text) == (EventKind.PHASE, "end"):
                    running._run.fail(Reason(Cause.CELL_FAILED, "it broke"))

            running._running.log.join(Listener({EventRecord: hear}))
            await running.finished()

    api.run_virtual(main)
    result = kept[0].result
    assert (result.outcome, result.cause) == (Outcome.STOPPED, Cause.CELL_FAILED)
    assert result.left.startswith("retracted")


def test_request_after_last_cycle_interrupts_run() -> None:
    completed = result_with_request(cycle=None)
    assert completed.outcome is Outcome.COMPLETED
    cycles = len(completed.cycles)
    result = result_with_request(cycle=cycles - 1)
    assert (result.outcome, result.cause, len(result.cycles)) == (
        Outcome.INTERRUPTED,
        Cause.INTERRUPTED,
        cycles,
    )
    assert result.left.startswith("retracted")


def result_with_request(cycle: int | None) -> api.Result:
    """Return the result of a short run that is requested to end after this cycle; None for no request."""
    kept: list[api.Simulation] = []

    async def main() -> None:
        async with api.simulation({"run": {"duration_s": 1.0}}, seed=7) as running:
            kept.append(running)

            def hear(record: CycleRecord) -> None:
                if record.cycle == cycle:
                    running.interrupt()

            running._running.log.join(Listener({CycleRecord: hear}))
            await running.finished()

    api.run_virtual(main)
    return kept[0].result
