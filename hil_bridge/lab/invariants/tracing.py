"""Recording as a trace of the model: its cycles as steps, and the first cycle that the model does not accept.

A recording contains phase, order, verdict and causes of each cycle, but not the complete state of the model.
Therefore all possible states of the run are followed, and a cycle that fits none of these states is not accepted.
"""

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from itertools import groupby
from typing import NamedTuple

from hil_bridge.control.course.intent import Phase
from hil_bridge.control.course.verdict import Clamp
from hil_bridge.errors.cause_row import COMPLETED, INTERRUPTED, STOPPED, Reaction
from hil_bridge.errors.causes import Cause
from hil_bridge.lab.invariants.model import (
    AT_REST,
    CYCLES,
    WITHIN,
    GuardModel,
    GuardState,
    GuardStep,
    Told,
    Way,
)
from hil_bridge.record import CycleRecord, EventKind, EventRecord, Outcome, Recording
from hil_bridge.runs.retreat import ARRIVED_M

ROUNDING_M = 1e-6
"""Largest difference between two orders that count as the same depth, m. Chosen."""
_OUTCOMES = {
    Outcome.COMPLETED: (COMPLETED,),
    Outcome.STOPPED: (2, STOPPED),
    Outcome.INTERRUPTED: (INTERRUPTED,),
}
"""Exit codes of the model that are consistent with each outcome."""
States = frozenset[GuardState]


class CycleTrace(NamedTuple):
    """Cycle as it appears in a recording."""

    phase: str
    way: Way
    away: bool
    """Whether the order is at a depth no deeper than the start."""
    held: bool
    """Whether a clamp shortened the order."""
    causes: tuple[Cause, ...]
    phases: frozenset[str]
    """Phases that the program step allows for the sample."""


class Unaccepted(NamedTuple):
    """First cycle, or end of the run, at which a recording contradicts the model."""

    cycle: int
    """Index of the cycle; for the end of the run, the total number of cycles."""
    at: float
    """Time on the run's clock, s."""
    shown: CycleTrace | None
    """Cycle that is not accepted; None for the end of the run."""


def first_unaccepted(recording: Recording, model: GuardModel) -> Unaccepted | None:
    """Return the first cycle, or the end of the run, that the model does not accept; None if it accepts the
    recording.

    An event with the same time stamp as the end of the last cycle may belong to this cycle or follow it. Both cases
    are tried.
    """
    unaccepted = _first(recording, model, behind=False)
    if unaccepted is None or _first(recording, model, behind=True) is None:
        return None
    return unaccepted


def _first(recording: Recording, model: GuardModel, behind: bool) -> Unaccepted | None:
    cycles, events = recording.cycles, _causes(recording.events)
    states = _silent(model, frozenset({GuardState()}), ())
    known: dict[tuple[States, CycleTrace], States] = {}
    for cycle, step in zip(cycles, _trace_cycles(recording, behind), strict=True):
        after = known.get((states, step))
        if after is None:
            after = known[states, step] = _after_cycle(model, states, step)
        if not after:
            return Unaccepted(cycle.cycle, cycle.started_at, step)
        states = after
    if not recording.end:
        return None
    last = cycles[-1].answered_at if cycles else -1.0
    remaining = [(at, cause) for at, cause in events if at > last or (behind and at == last)]
    alone: list[tuple[Cause, ...]] = [(cause,) for _, cause in remaining]
    moments = [tuple(cause for _, cause in group) for _, group in groupby(remaining, lambda each: each[0])]
    if not any(_ends(model, states, causes, recording.end, bool(events)) for causes in (alone, moments)):
        at = recording.events[-1].at if recording.events else last
        return Unaccepted(len(cycles), at, None)
    return None


def _causes(events: Iterable[EventRecord]) -> list[tuple[float, Cause]]:
    """Return the times and the causes of the stop and of everything that followed the stop."""
    kinds = EventKind.STOP, EventKind.THEN
    return [(event.at, event.cause) for event in events if event.kind in kinds and event.cause is not None]


def _trace_cycles(recording: Recording, behind: bool) -> Iterator[CycleTrace]:
    causes, next_cause = _causes(recording.events), 0
    before, away = None, True
    for cycle in recording.cycles:
        reported = [] if cycle.asked is None else [cycle.asked.cause]
        until = cycle.answered_at
        if behind and cycle is recording.cycles[-1]:
            until = math.nextafter(until, -math.inf)
        while next_cause < len(causes) and causes[next_cause][0] <= until:
            reported.append(causes[next_cause][1])
            next_cause += 1
        depth = 0.0 if before is None else before.depth_commanded
        deeper = cycle.depth_commanded - depth
        direction = Way.SAME if abs(deeper) <= ROUNDING_M else Way.DEEPER if deeper > 0 else Way.BACK
        away = away if direction is Way.SAME else cycle.depth_commanded <= ARRIVED_M
        yield CycleTrace(
            cycle.phase,
            direction,
            away,
            cycle.verdict == Clamp.kind,
            tuple(dict.fromkeys(reported)),
            _phases(before, cycle),
        )
        before = cycle


def _phases(before: CycleRecord | None, cycle: CycleRecord) -> frozenset[str]:
    """Return the phases that a sample may have: the phases of its program step, or of the next step."""
    if before is None or before.step != cycle.step or before.phase not in WITHIN:
        return CYCLES
    within = WITHIN[before.phase]
    return within if cycle.step else within | {Phase.RETRACT}  # without a program: approach, track, retract


def _after_cycle(model: GuardModel, states: States, recorded: CycleTrace) -> States:
    """Return the states that are possible after a cycle."""
    reached = set()
    for state in states:
        # a run that ends retracts in any step; a sample may end one step and begin the next without a record
        phases = CYCLES if recorded.causes or state.code is not None else recorded.phases
        for conditions in _conditions(model, state, recorded):
            for step in _steps(model, state, conditions, phases):
                if (step.shown, step.way, step.after.away) == (recorded.phase, recorded.way, recorded.away):
                    reached.add(step.after)
    return frozenset(reached)


def _conditions(model: GuardModel, state: GuardState, recorded: CycleTrace) -> Iterator[tuple[Cause, ...]]:
    """Yield the sets of conditions that may have been active in a cycle.

    If a clamp shortened the order, each set consists of the recorded conditions and one more that may have
    shortened it. Otherwise, the recorded conditions are the only set.
    """
    if not recorded.held:
        yield recorded.causes
        return
    checked = {cause for phase in model.next_phases(state) for cause in model.conditions(phase)}
    kinds: dict[object, Cause] = {}
    for cause in checked:
        if model.rows[cause].reaction is Reaction.CLAMPED:
            kinds[model.rows[cause].when, cause is Cause.NO_FORCE] = cause
    for cause in kinds.values():
        yield (*recorded.causes, cause)


def _steps(
    model: GuardModel, state: GuardState, conditions: tuple[Cause, ...], phases: Iterable[str]
) -> Iterator[GuardStep]:
    """Yield the transitions in each of the phases that checks all of these conditions."""
    for phase in model.next_phases(state) & frozenset(phases):
        if set(conditions) <= set(model.conditions(phase)):
            yield from model.judge(state, phase, conditions)


def _silent(model: GuardModel, states: States, conditions: tuple[Cause, ...]) -> States:
    """Return these states, and all states that are reached from them without a cycle. The conditions apply in the
    first step.
    """
    known, waiting = set(states), [(state, conditions) for state in states]
    reached = set() if conditions else set(states)
    while waiting:
        state, active = waiting.pop()
        for step in _steps(model, state, active, model.next_phases(state)):
            if step.shown or step.after in reached:
                continue
            reached.add(step.after)
            waiting.append((step.after, ()))
    return frozenset(reached or known)


def _ends(
    model: GuardModel,
    states: States,
    causes: list[tuple[Cause, ...]],
    end: Mapping[str, str],
    was_reported: bool,
) -> bool:
    """Return whether a run in one of these states can end as recorded, with these causes in between.

    The causes in one tuple are simultaneous.
    """
    cause = Cause(end["cause"]) if end.get("cause") in set(Cause) else None
    if cause is not None and not was_reported and model.rows[cause].exit_code != COMPLETED:
        causes = [*causes, (cause,)]  # the run ended before a cycle could report the cause
    states = _silent(model, states, ())
    for number, each in enumerate(causes, 1):
        # a cycle whose order the robot refused is not recorded, but the next cause is
        unrecorded = number < len(causes)
        states = frozenset().union(*(_with(model, state, each, unrecorded) for state in states))
    rest = json.loads(end.get("rest") or "{}")
    report = Told.UNMOVED if not rest else Told.RETRACTED if rest.get("retracted") else Told.LEFT
    codes = _OUTCOMES[Outcome(end["outcome"])]
    depth = rest.get("depth_m")
    if report is Told.RETRACTED and not (isinstance(depth, float) and depth <= ARRIVED_M):
        return False
    return any(
        state.phase == Phase.END and state.told is report and state.code in codes
        for state in _final_states(model, states)
    )


def _with(model: GuardModel, state: GuardState, conditions: tuple[Cause, ...], unrecorded: bool) -> States:
    """Return the states after a step with these conditions, and all states that are reached from them without a
    cycle.
    """
    reached = set()
    for step in _steps(model, state, conditions, model.next_phases(state)):
        if unrecorded or not step.shown:
            reached.add(step.after)
    return _silent(model, frozenset(reached), ()) if reached else frozenset()


def _final_states(model: GuardModel, states: States) -> set[GuardState]:
    """Return these states, and the states after the final check.

    A stopped run does not report the findings of the final check as causes, so all findings are tried.
    """
    reached = set(states)
    for state in states:
        if state.phase == AT_REST and state.code == STOPPED:
            for cause in model.conditions(AT_REST):
                reached.update(step.after for step in model.judge(state, AT_REST, (cause,)))
    return reached
