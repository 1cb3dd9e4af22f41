"""A recording as a trace of the model: its cycles as steps, and the first one that the model does not accept.

A recording shows phase, order, verdict and causes of each cycle. It does not show all of the model's state. So all
states are followed in which the run may be; a cycle that fits none of them is not accepted.
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
"""Chosen: two orders for the same depth differ by less, m."""
_OUTCOMES = {
    Outcome.COMPLETED: (COMPLETED,),
    Outcome.STOPPED: (2, STOPPED),
    Outcome.INTERRUPTED: (INTERRUPTED,),
}
"""Exit codes of the model that fit an outcome."""
States = frozenset[GuardState]


class Shown(NamedTuple):
    """A cycle as a recording shows it."""

    phase: str
    way: Way
    away: bool
    """The order is no deeper than the start."""
    held: bool
    """A clamp shortened the order."""
    causes: tuple[Cause, ...]
    phases: frozenset[str]
    """Phases that the step of the program allows for this sample."""


class Unaccepted(NamedTuple):
    """The place where a recording leaves the model."""

    cycle: int
    """Number of the cycle; that of all cycles where it is the end of the run."""
    at: float
    """s on the run's clock."""
    shown: Shown | None
    """The cycle; None for the end of the run."""


def first_unaccepted(recording: Recording, model: GuardModel) -> Unaccepted | None:
    """Find the first cycle, or the end, that the model does not accept; None for a recording that it accepts.

    What came in the moment in which the last cycle ended may belong to that cycle, or come behind it: both are tried.
    """
    found = _first(recording, model, behind=False)
    if found is None or _first(recording, model, behind=True) is None:
        return None
    return found


def _first(recording: Recording, model: GuardModel, behind: bool) -> Unaccepted | None:
    cycles, events = recording.cycles, _causes(recording.events)
    states = _silent(model, frozenset({GuardState()}), ())
    known: dict[tuple[States, Shown], States] = {}
    for cycle, shown in zip(cycles, _shown(recording, behind), strict=True):
        after = known.get((states, shown))
        if after is None:
            after = known[states, shown] = _after_cycle(model, states, shown)
        if not after:
            return Unaccepted(cycle.cycle, cycle.started_at, shown)
        states = after
    if not recording.end:
        return None
    last = cycles[-1].answered_at if cycles else -1.0
    told = [(at, cause) for at, cause in events if at > last or (behind and at == last)]
    alone: list[tuple[Cause, ...]] = [(cause,) for _, cause in told]
    moments = [tuple(cause for _, cause in group) for _, group in groupby(told, lambda each: each[0])]
    if not any(_ends(model, states, causes, recording.end, bool(events)) for causes in (alone, moments)):
        at = recording.events[-1].at if recording.events else last
        return Unaccepted(len(cycles), at, None)
    return None


def _causes(events: Iterable[EventRecord]) -> list[tuple[float, Cause]]:
    """When the run was stopped, and what followed."""
    kinds = EventKind.STOP, EventKind.THEN
    return [(event.at, event.cause) for event in events if event.kind in kinds and event.cause is not None]


def _shown(recording: Recording, behind: bool) -> Iterator[Shown]:
    causes, next_cause = _causes(recording.events), 0
    before, away = None, True
    for cycle in recording.cycles:
        found = [] if cycle.asked is None else [cycle.asked.cause]
        until = cycle.answered_at
        if behind and cycle is recording.cycles[-1]:
            until = math.nextafter(until, -math.inf)
        while next_cause < len(causes) and causes[next_cause][0] <= until:
            found.append(causes[next_cause][1])
            next_cause += 1
        depth = 0.0 if before is None else before.depth_commanded
        deeper = cycle.depth_commanded - depth
        way = Way.SAME if abs(deeper) <= ROUNDING_M else Way.DEEPER if deeper > 0 else Way.BACK
        away = away if way is Way.SAME else cycle.depth_commanded <= ARRIVED_M
        yield Shown(
            cycle.phase,
            way,
            away,
            cycle.verdict == Clamp.kind,
            tuple(dict.fromkeys(found)),
            _phases(before, cycle),
        )
        before = cycle


def _phases(before: CycleRecord | None, cycle: CycleRecord) -> frozenset[str]:
    """Phases that a sample may be of: those of the step of the program, or of the next one."""
    if before is None or before.step != cycle.step or before.phase not in WITHIN:
        return CYCLES
    within = WITHIN[before.phase]
    return within if cycle.step else within | {Phase.RETRACT}  # without a program: approach, track, retract


def _after_cycle(model: GuardModel, states: States, shown: Shown) -> States:
    """States behind a cycle."""
    found = set()
    for state in states:
        # once the run ends it retracts, whatever its step; and a sample may end one step and begin the next unshown
        phases = CYCLES if shown.causes or state.code is not None else shown.phases
        for conditions in _conditions(model, state, shown):
            for step in _steps(model, state, conditions, phases):
                if (step.shown, step.way, step.after.away) == (shown.phase, shown.way, shown.away):
                    found.add(step.after)
    return frozenset(found)


def _conditions(model: GuardModel, state: GuardState, shown: Shown) -> Iterator[tuple[Cause, ...]]:
    """Conditions that may have held in a cycle: those that are told, and each that may have shortened the order."""
    if not shown.held:
        yield shown.causes
        return
    looked = {cause for phase in model.next_phases(state) for cause in model.conditions(phase)}
    kinds: dict[object, Cause] = {}
    for cause in looked:
        if model.rows[cause].reaction is Reaction.CLAMPED:
            kinds[model.rows[cause].when, cause is Cause.NO_FORCE] = cause
    for cause in kinds.values():
        yield (*shown.causes, cause)


def _steps(
    model: GuardModel, state: GuardState, conditions: tuple[Cause, ...], phases: Iterable[str]
) -> Iterator[GuardStep]:
    """Return steps in those phases in which all of these conditions are checked."""
    for phase in model.next_phases(state) & frozenset(phases):
        if set(conditions) <= set(model.conditions(phase)):
            yield from model.judge(state, phase, conditions)


def _silent(model: GuardModel, states: States, conditions: tuple[Cause, ...]) -> States:
    """Return these states and all that follow without a cycle; the conditions hold in the first step."""
    found, waiting = set(states), [(state, conditions) for state in states]
    reached = set() if conditions else set(states)
    while waiting:
        state, held = waiting.pop()
        for step in _steps(model, state, held, model.next_phases(state)):
            if step.shown or step.after in reached:
                continue
            reached.add(step.after)
            waiting.append((step.after, ()))
    return frozenset(reached or found)


def _ends(
    model: GuardModel, states: States, causes: list[tuple[Cause, ...]], end: Mapping[str, str], was_told: bool
) -> bool:
    """Whether a run that may be in these states can end so, with these causes on the way: those that hold at once
    together.
    """
    cause = Cause(end["cause"]) if end.get("cause") in set(Cause) else None
    if cause is not None and not was_told and model.rows[cause].exit_code != COMPLETED:
        causes = [*causes, (cause,)]  # it ended before there was a cycle that could tell it
    states = _silent(model, states, ())
    for number, each in enumerate(causes, 1):
        # a cycle whose order the robot did not take is not recorded: the next cause tells of it
        unrecorded = number < len(causes)
        states = frozenset().union(*(_with(model, state, each, unrecorded) for state in states))
    rest = json.loads(end.get("rest") or "{}")
    told = Told.UNMOVED if not rest else Told.RETRACTED if rest.get("retracted") else Told.LEFT
    codes = _OUTCOMES[Outcome(end["outcome"])]
    depth = rest.get("depth_m")
    if told is Told.RETRACTED and not (isinstance(depth, float) and depth <= ARRIVED_M):
        return False
    return any(
        state.phase == Phase.END and state.told is told and state.code in codes
        for state in _told(model, states)
    )


def _with(model: GuardModel, state: GuardState, conditions: tuple[Cause, ...], unrecorded: bool) -> States:
    """States behind a step with these conditions, and all that follow without a cycle."""
    found = set()
    for step in _steps(model, state, conditions, model.next_phases(state)):
        if unrecorded or not step.shown:
            found.add(step.after)
    return _silent(model, frozenset(found), ()) if found else frozenset()


def _told(model: GuardModel, states: States) -> set[GuardState]:
    """States with the ends of those that rest. What is found there is told as a cause of a run that went well alone."""
    found = set(states)
    for state in states:
        if state.phase == AT_REST and state.code == STOPPED:
            for cause in model.conditions(AT_REST):
                found.update(step.after for step in model.judge(state, AT_REST, (cause,)))
    return found
