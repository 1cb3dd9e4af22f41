"""Model of the guard as a state machine: phases, conditions from the cause table, and reactions.

Conditions and reactions are those of `hil_bridge.errors.cause_table`, the table that the code and the documentation
also use. The tables below complete the model: the conditions that each phase checks, the orders that it requests,
and the phases that may follow. The model contains no forces and no times. An order is compared with the previous
order: back, same or deeper.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from enum import IntEnum, StrEnum
from typing import NamedTuple

from hil_bridge.control.course.intent import CONNECT, TARE, Phase
from hil_bridge.control.course.verdict import Stage
from hil_bridge.errors.cause_row import COMPLETED, INTERRUPTED, STOPPED, CauseRow, Reaction, When
from hil_bridge.errors.cause_table import ROWS
from hil_bridge.errors.causes import Cause


class Way(IntEnum):
    """Direction of an order along the approach, relative to the previous order."""

    BACK = -1
    SAME = 0
    DEEPER = 1


class Told(StrEnum):
    """Report on the tool at the end of a run."""

    NOTHING = ""
    """No report: the run has not ended."""
    UNMOVED = "nothing has moved"
    RETRACTED = "retracted"
    LEFT = "NOT retracted"


BY_ORDERS, AT_REST = "by orders", "at rest"
"""Phases after the cycles: the retraction by orders alone, for a run that can no longer decide, and the final check
of the tool.
"""
WORKING = frozenset({Phase.APPROACH, Phase.TRACK, Phase.SEEK, Phase.MOVE, Phase.ZERO})
CYCLES = WORKING | {Phase.RETRACT}
"""Phases that run cycle by cycle and therefore appear in a recording."""


class GuardState(NamedTuple):
    """State of the guard in a run."""

    phase: str = CONNECT
    code: int | None = None
    """Exit code of the run; None while it continues."""
    away: bool = True
    """Whether the tool is ordered to a depth no deeper than the start, and no observation contradicts this."""
    stage: Stage = Stage.GOES
    """Stage of the retraction."""
    told: Told = Told.NOTHING


class GuardStep(NamedTuple):
    """Transition of the model: active conditions, resulting order, and next state."""

    conditions: tuple[Cause, ...]
    shown: str
    """Phase of the cycle that records the transition; empty if no cycle records it."""
    way: Way | None
    """Direction of the order, or None."""
    after: GuardState


LOOKS: Mapping[str, frozenset[When]] = {
    CONNECT: frozenset({When.BEFORE_MOTION, When.ALWAYS}),
    TARE: frozenset({When.LIFT, When.ALWAYS}),
    **dict.fromkeys(WORKING, frozenset({When.CYCLE, When.ALWAYS})),
    Phase.RETRACT: frozenset({When.RETRACTION, When.ALWAYS}),
    BY_ORDERS: frozenset({When.RETRACTION, When.ALWAYS}),
    AT_REST: frozenset({When.END}),
    Phase.END: frozenset(),
}
"""Times at which a phase checks conditions, by phase."""
ASKS: Mapping[str, frozenset[Way]] = {
    TARE: frozenset({Way.BACK, Way.SAME}),
    Phase.APPROACH: frozenset({Way.SAME, Way.DEEPER}),
    Phase.TRACK: frozenset(Way),
    Phase.SEEK: frozenset({Way.SAME}),
    Phase.MOVE: frozenset({Way.BACK, Way.SAME}),
    Phase.ZERO: frozenset({Way.SAME}),
    Phase.RETRACT: frozenset({Way.BACK, Way.SAME}),
    BY_ORDERS: frozenset({Way.BACK, Way.SAME}),
}
"""Directions of the orders that a phase may request."""
FOLLOWS: Mapping[str, frozenset[str]] = {
    CONNECT: frozenset({CONNECT, TARE}),
    TARE: frozenset({TARE, *CYCLES}),
    **dict.fromkeys(CYCLES, CYCLES),
}
"""Phases that the next sample may have while the run continues. A program may run its steps in any order."""
WITHIN: Mapping[str, frozenset[str]] = {
    **{phase: frozenset({phase}) for phase in CYCLES},
    Phase.APPROACH: frozenset({Phase.APPROACH, Phase.TRACK}),
    Phase.TRACK: frozenset({Phase.TRACK, Phase.APPROACH}),
}
"""Phases that the next sample may have within one program step, in which contact is detected and lost."""
ENDS: Mapping[str, frozenset[str]] = {
    TARE: frozenset({TARE}),
    Phase.RETRACT: frozenset({Phase.RETRACT}),
    BY_ORDERS: frozenset({BY_ORDERS}),
    AT_REST: frozenset({AT_REST}),
}
"""Phases that the next sample may have once the run ends."""
STAGES: Mapping[Stage, frozenset[Stage]] = {
    Stage.GOES: frozenset({Stage.GOES, Stage.WAITS, Stage.TRUSTED}),
    Stage.WAITS: frozenset({Stage.WAITS, Stage.SLOW, Stage.TRUSTED}),
    Stage.SLOW: frozenset({Stage.SLOW, Stage.TRUSTED}),
    Stage.TRUSTED: frozenset({Stage.TRUSTED}),
}
"""Stages that may follow a stage of a retraction. A retraction waits once, and retries once."""
STRONGEST = (
    Reaction.REFUSED,
    Reaction.LEFT,
    Reaction.STANDS,
    Reaction.RETRACTS_OR_LEFT,
    Reaction.RETRACTS,
    Reaction.CLAMPED,
)
"""Priority of reactions, strongest first: of several simultaneous conditions, only the strongest reaction applies."""


@dataclass(frozen=True)
class GuardModel:
    """State machine of the guard. Tests replace its tables to plant deliberate mistakes."""

    rows: Mapping[Cause, CauseRow] = field(default_factory=lambda: ROWS)
    looks: Mapping[str, frozenset[When]] = field(default_factory=lambda: LOOKS)
    asks: Mapping[str, frozenset[Way]] = field(default_factory=lambda: ASKS)
    follows: Mapping[str, frozenset[str]] = field(default_factory=lambda: FOLLOWS)
    ends: Mapping[str, frozenset[str]] = field(default_factory=lambda: ENDS)
    stages: Mapping[Stage, frozenset[Stage]] = field(default_factory=lambda: STAGES)
    strongest: tuple[Reaction, ...] = STRONGEST
    trusts_orders: bool = False
    """Deliberate mistake for tests: whether a tool that was ordered away is reported as retracted, regardless of
    what the final check detects.
    """

    def conditions(self, phase: str) -> tuple[Cause, ...]:
        """Return the conditions that a phase checks. The motion limits also apply in a retraction."""
        whens = self.looks[phase]
        return tuple(
            cause
            for cause, row in self.rows.items()
            if row.when in whens
            or (phase == Phase.RETRACT and row.when is When.CYCLE and row.reaction is Reaction.CLAMPED)
        )

    def next_phases(self, state: GuardState) -> frozenset[str]:
        """Return the phases that the next sample may have."""
        if state.code is None and state.phase in self.follows:
            return self.follows[state.phase]
        return self.ends.get(state.phase, frozenset())

    def judge(self, state: GuardState, phase: str, conditions: tuple[Cause, ...]) -> Iterator[GuardStep]:
        """Yield every possible transition for a sample in this phase with these conditions."""
        rows = [self.rows[cause] for cause in conditions]
        ending = [row for row in rows if row.exit_code not in (None, COMPLETED)]
        reactions = {row.reaction for row in rows if row.exit_code != COMPLETED}
        reaction = next((each for each in self.strongest if each in reactions), None)
        code = _code_after(state.code, ending)
        stage = state.stage if state.phase == phase else Stage.GOES
        here = state._replace(phase=phase, code=code, stage=stage)
        if phase == CONNECT:
            after = here if reaction is None else here._replace(phase=Phase.END, told=Told.UNMOVED)
            yield GuardStep(conditions, "", None, after)
        elif phase == TARE:
            yield from self._lift(here, conditions, reaction)
        elif phase == AT_REST:
            yield self._report_end(here, conditions)
        elif phase == BY_ORDERS:
            yield from self._leave(here, conditions, reaction)
        else:
            yield from self._cycle(here, conditions, reaction)

    def _lift(
        self, here: GuardState, conditions: tuple[Cause, ...], reaction: Reaction | None
    ) -> Iterator[GuardStep]:
        """Yield the transitions of the motion to the point where the zero is taken.

        Every fault leaves the tool at its position, and the robot may also refuse to end its movement.
        """
        if reaction is None and here.code is None:
            for direction in self.asks[TARE]:
                yield GuardStep(conditions, "", direction, here)
            return
        if reaction is not None:
            yield GuardStep(conditions, "", None, here)
        yield GuardStep(conditions, "", None, here._replace(phase=AT_REST))
        yield GuardStep(conditions, "", None, here._replace(phase=Phase.END, told=Told.UNMOVED))

    def _cycle(
        self, here: GuardState, conditions: tuple[Cause, ...], reaction: Reaction | None
    ) -> Iterator[GuardStep]:
        """Yield the transitions of a cycle, including the transitions that end the cycles."""
        phase, rows = here.phase, [self.rows[cause] for cause in conditions]
        back, rest = here._replace(phase=Phase.RETRACT), here._replace(phase=AT_REST)
        if reaction is Reaction.LEFT:
            yield GuardStep(conditions, "", None, rest._replace(away=False))
        elif reaction is Reaction.STANDS:
            for recorded in {phase, str(Phase.RETRACT)}:
                yield GuardStep(conditions, recorded, Way.SAME, rest)
        elif reaction in (Reaction.RETRACTS, Reaction.RETRACTS_OR_LEFT):
            for recorded in {phase, str(Phase.RETRACT)}:
                for direction in self.asks[Phase.RETRACT]:
                    yield from _after_order(GuardStep(conditions, recorded, direction, back))
            if any(row.when is When.ALWAYS for row in rows):  # an exception leaves the cycles
                yield GuardStep(conditions, "", None, here._replace(phase=BY_ORDERS))
            if reaction is Reaction.RETRACTS_OR_LEFT:
                yield GuardStep(conditions, "", None, rest._replace(away=False))
        else:
            is_clamped = reaction is Reaction.CLAMPED
            for stage in self.stages[here.stage] if phase == Phase.RETRACT else (Stage.GOES,):
                for direction in self._directions(phase, stage, conditions, is_clamped):
                    yield from _after_order(
                        GuardStep(conditions, phase, direction, here._replace(stage=stage))
                    )
            if phase == Phase.RETRACT and not is_clamped:
                yield GuardStep(conditions, "", None, rest)

    def _directions(
        self, phase: str, stage: Stage, conditions: tuple[Cause, ...], is_clamped: bool
    ) -> frozenset[Way]:
        """Return the possible directions of the order in a cycle that continues. A clamp may reduce a request, at
        most to a standstill.
        """
        if phase == Phase.RETRACT and stage is Stage.WAITS and Cause.NO_FORCE not in conditions:
            return frozenset({Way.SAME})
        requested = self.asks[phase]
        return requested | {Way.SAME, Way.BACK} if is_clamped else requested

    def _leave(
        self, here: GuardState, conditions: tuple[Cause, ...], reaction: Reaction | None
    ) -> Iterator[GuardStep]:
        """Yield the transitions of the retraction by orders alone, as long as the robot accepts orders."""
        if reaction not in (Reaction.STANDS, Reaction.LEFT):
            for direction in self.asks[BY_ORDERS]:
                yield from _after_order(GuardStep(conditions, "", direction, here))
        if reaction is Reaction.CLAMPED:
            return
        unknown = reaction in (Reaction.LEFT, Reaction.RETRACTS_OR_LEFT)
        rest = here._replace(phase=AT_REST)
        yield GuardStep(conditions, "", None, rest._replace(away=False) if unknown else rest)

    def _report_end(self, here: GuardState, conditions: tuple[Cause, ...]) -> GuardStep:
        """Return the transition to the end of the run. A tool that is not known to be away and free counts as not
        retracted.
        """
        free = here.away and (self.trusts_orders or not conditions)
        code = (here.code or COMPLETED) if free else (here.code or STOPPED)
        if not free and code == INTERRUPTED:
            code = STOPPED
        report = Told.RETRACTED if free else Told.LEFT
        return GuardStep(conditions, "", None, here._replace(phase=Phase.END, code=code, told=report))


def _code_after(before: int | None, ending: Collection[CauseRow]) -> int | None:
    """Return the exit code after these conditions. Only a failure overrides an interruption by the operator."""
    codes = [row.exit_code for row in ending if row.exit_code != INTERRUPTED]
    if before not in (None, INTERRUPTED) or not ending:
        return before
    return codes[0] if codes else INTERRUPTED


def _after_order(step: GuardStep) -> Iterator[GuardStep]:
    """Yield the transition with each value of `away` to which its order may lead."""
    match step.way:
        case Way.DEEPER:
            places = {False, step.after.away}
        case Way.BACK:
            places = {True, step.after.away}
        case _:
            places = {step.after.away}
    for away in places:
        yield step._replace(after=step.after._replace(away=away))
