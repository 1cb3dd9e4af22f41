"""Every reachable state of the model, and the rules that hold in all of them.

The search is breadth-first. From each state it tries no condition, each condition alone, and every pair.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from itertools import combinations

from hil_bridge.control.course.intent import CONNECT, TARE, Phase
from hil_bridge.control.course.verdict import Stage
from hil_bridge.errors.cause_row import COMPLETED, INTERRUPTED, STOPPED, Reaction, When
from hil_bridge.errors.causes import Cause
from hil_bridge.lab.invariants.model import (
    AT_REST,
    BY_ORDERS,
    WORKING,
    GuardModel,
    GuardState,
    GuardStep,
    Told,
    Way,
)


class GuardRule(StrEnum):
    """A rule that every step, or every state, must keep."""

    DEEPER = "nothing is ordered deeper from the cycle on that ends the run"
    LATCHED = "an end stays an end, and a failure stays a failure"
    FORWARD = "no phase goes backwards: once the run ends, it only retracts, rests and tells"
    STILL = "nothing is ordered once the tool stands still or is left"
    LIFT = "nothing is ordered deeper on the way to the zero"
    REFUSED = "a run that is refused has moved nothing"
    CLAMP = "a condition that shortens an order ends nothing"
    STAGE = "a retraction waits once and tries once more"
    TOLD = "a tool that may still press is told as NOT retracted"
    CODE = "exit code 0 or 130 means that the tool is off the surface, or never moved"
    WAY_OUT = "from every state the run comes to an end, and every end is told"
    LOOKED = "every condition of the table is looked at in some state"


RANKS: Mapping[str, int] = {CONNECT: 0, TARE: 1, Phase.RETRACT: 3, BY_ORDERS: 4, AT_REST: 5, Phase.END: 6}
"""Order of the phases once a run ends; the working phases are at 2."""

Check = Callable[[GuardModel, GuardState, GuardStep], bool]


def _rank(state: GuardState) -> int:
    return RANKS.get(state.phase, 2)


def _forward(model: GuardModel, before: GuardState, step: GuardStep) -> bool:
    after = step.after
    if after.code is not None and after.phase in WORKING:
        return False
    return _rank(after) >= _rank(before) or (before.code is None and _rank(before) == 3)


def _still(model: GuardModel, before: GuardState, step: GuardStep) -> bool:
    reactions = {model.rows[cause].reaction for cause in step.conditions}
    if reactions & {Reaction.STANDS, Reaction.LEFT} and before.phase not in (CONNECT, AT_REST):
        return step.way in (None, Way.SAME) and _rests(step.after)
    return not _rests(before) or step.way is None


def _rests(state: GuardState) -> bool:
    """Whether nothing is ordered from here on. A run that ends during the motion to its zero orders nothing either."""
    return state.phase in (AT_REST, Phase.END) or (state.phase == TARE and state.code is not None)


def _clamp(model: GuardModel, before: GuardState, step: GuardStep) -> bool:
    rows = [model.rows[cause] for cause in step.conditions]
    if not rows or any(row.reaction is not Reaction.CLAMPED for row in rows):
        return True
    return step.after.code == before.code and step.after.phase not in (AT_REST, Phase.END)


def _stage(model: GuardModel, before: GuardState, step: GuardStep) -> bool:
    if before.phase != Phase.RETRACT or step.after.phase != Phase.RETRACT or before.code != step.after.code:
        return True
    order = list(Stage)
    return order.index(step.after.stage) >= order.index(before.stage)


def _check_report(model: GuardModel, before: GuardState, step: GuardStep) -> bool:
    after = step.after
    if after.told is Told.UNMOVED:
        return before.phase in (CONNECT, TARE)
    result = any(model.rows[cause].when is When.END for cause in step.conditions)
    return after.told is not Told.RETRACTED or (before.away and not result)


CHECKS: Mapping[GuardRule, Check] = {
    GuardRule.DEEPER: lambda model, before, step: step.after.code is None or step.way is not Way.DEEPER,
    GuardRule.LATCHED: lambda model, before, step: (
        before.code in (None, step.after.code) or (before.code == INTERRUPTED and step.after.code == STOPPED)
    ),
    GuardRule.FORWARD: _forward,
    GuardRule.STILL: _still,
    GuardRule.LIFT: lambda model, before, step: (
        before.phase not in (CONNECT, TARE) or step.after.phase != TARE or step.way is not Way.DEEPER
    ),
    GuardRule.REFUSED: lambda model, before, step: (
        all(model.rows[cause].reaction is not Reaction.REFUSED for cause in step.conditions)
        or step.after.told is Told.UNMOVED
    ),
    GuardRule.CLAMP: _clamp,
    GuardRule.STAGE: _stage,
    GuardRule.TOLD: _check_report,
    GuardRule.CODE: lambda model, before, step: (
        step.after.phase != Phase.END
        or step.after.code not in (COMPLETED, INTERRUPTED)
        or step.after.told in (Told.RETRACTED, Told.UNMOVED)
    ),
}
"""The rules that a single step shows to be broken."""


@dataclass(frozen=True)
class GuardSearch:
    """The result of a search."""

    states: int
    steps: int
    broken: Mapping[GuardRule, tuple[GuardStep, ...]]
    """Each violated rule, with the shortest path to its violation."""

    @property
    def held(self) -> tuple[GuardRule, ...]:
        """Rules that hold."""
        return tuple(rule for rule in GuardRule if rule not in self.broken)


def search(model: GuardModel) -> GuardSearch:
    """Go through all states of the model."""
    parents: dict[GuardState, tuple[GuardState, GuardStep] | None] = {GuardState(): None}
    successors: dict[GuardState, set[GuardState]] = {}
    broken: dict[GuardRule, tuple[GuardStep, ...]] = {}
    checked: set[Cause] = set()
    waiting, count = [GuardState()], 0
    for state in waiting:  # it grows meanwhile
        successors[state] = set()
        for step, alike in _all_steps(model, state, checked):
            count += alike
            for rule, check in CHECKS.items():
                if rule not in broken and not check(model, state, step):
                    broken[rule] = (*_path(parents, state), step)
            if step.after not in parents:
                parents[step.after] = state, step
                waiting.append(step.after)
            successors[state].add(step.after)
    ending = _ending_states(successors)
    for state in parents:
        if state not in ending:
            broken.setdefault(GuardRule.WAY_OUT, _path(parents, state))
    if {cause for cause, row in model.rows.items() if row.when is not When.READING} - checked:
        broken[GuardRule.LOOKED] = ()
    return GuardSearch(len(parents), count, broken)


def _all_steps(model: GuardModel, state: GuardState, checked: set[Cause]) -> Iterator[tuple[GuardStep, int]]:
    """Every step from a state, each with the number of those that are alike.

    Conditions with equal rows in the table have equal effects, so only one of them is tried.
    """
    for phase in sorted(model.next_phases(state)):
        causes = model.conditions(phase)
        checked.update(causes)
        kinds: dict[object, list[Cause]] = {}
        for cause in causes:
            row = model.rows[cause]
            kinds.setdefault((row.when, row.reaction, row.exit_code, cause is Cause.NO_FORCE), []).append(
                cause
            )
        groups = list(kinds.values())
        tried = [((), 1), *(((group[0],), len(group)) for group in groups)]
        tried += [((a[0], b[0]), len(a) * len(b)) for a, b in combinations(groups, 2)]
        tried += [((a[0], a[1]), len(a) * (len(a) - 1) // 2) for a in groups if len(a) > 1]
        for several, alike in tried:
            for step in model.judge(state, phase, several):
                yield step, alike


def _ending_states(successors: Mapping[GuardState, set[GuardState]]) -> set[GuardState]:
    """Return the states from which a reported end can be reached."""
    ending = {state for state in successors if state.phase == Phase.END and state.told is not Told.NOTHING}
    while more := {state for state, after in successors.items() if state not in ending and after & ending}:
        ending |= more
    return ending


def _path(
    parents: Mapping[GuardState, tuple[GuardState, GuardStep] | None], state: GuardState
) -> tuple[GuardStep, ...]:
    steps: list[GuardStep] = []
    while (parent := parents[state]) is not None:
        state, step = parent
        steps.append(step)
    return tuple(reversed(steps))
