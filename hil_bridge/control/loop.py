"""One cycle's decision as two pure functions: sample → program and controller → supervisor → target position.

The same functions make the decisions of a run and of its replay; a run looks at the clock between them.
"""

import math
from dataclasses import dataclass, field
from enum import Enum

from msgspec import Struct
from msgspec.structs import replace

from hil_bridge.control.course.answers import calm, explain_halt
from hil_bridge.control.course.contact_sample import ContactSample
from hil_bridge.control.course.following import Following, Trail
from hil_bridge.control.course.intent import FREE_SPACE, Intent, Phase, Target
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.oscillation import Advice, OscillationDetector, OscillationState
from hil_bridge.control.course.supervisor import Supervisor
from hil_bridge.control.course.touch import Doubt
from hil_bridge.control.course.verdict import (
    LEAVES,
    Allow,
    Clamp,
    Observation,
    Request,
    Stop,
    SupervisorState,
    Verdict,
)
from hil_bridge.control.decision import Decision, LoopState, Proposal
from hil_bridge.control.failing import Failed, blame_answer, blame_error, is_stiffness
from hil_bridge.control.program.answer import farthest_answer
from hil_bridge.control.program.program import Program
from hil_bridge.control.program.state import ProgramState
from hil_bridge.control.sample import Sample
from hil_bridge.control.types import SAMPLE_MS, Command, Measurement
from hil_bridge.errors.causes import Cause, Reason
from hil_bridge.errors.failures import RAISED, raise_if_interrupt
from protocol.geometry import Vector

# Asked for in every cycle, by names of this module: until Python 3.12 an enum's own name costs ten times that.
_APPROACH, _TRACK, _RETRACT, _END = Phase.APPROACH, Phase.TRACK, Phase.RETRACT, Phase.END
LONGEST_SAMPLES = 2.0
"""Sample times that one sample counts for at most. Chosen: as far off as a control period may be."""
_NO_OSCILLATION = OscillationState()
_ROUNDING = 1e-9
"""Slack for arithmetic, m."""


class Route(Enum):
    """How a proposal is judged."""

    FAILURE = "failure"
    """A controller or step has failed."""
    RETRACTION = "retraction"
    """The tool goes back: a retraction of the program, or of a step of ours."""
    OSCILLATION = "oscillation"
    """The force oscillates at the lowest gain."""
    ORDER = "order"
    """Anything else: an order that may press or travel."""


_FAILURE, _RETRACTION, _OSCILLATION, _ORDER = Route


class Case(Struct, frozen=True, gc=False):
    """All that a proposal is judged by."""

    route: Route
    state: LoopState
    sample: Sample
    proposal: Proposal
    guard: Supervisor
    """The supervisor with the limits of the leg."""
    observation: Observation


class Ruling(Struct, frozen=True, gc=False):
    """A proposal with the supervisor's verdict."""

    program: ProgramState
    intent: Intent
    supervisor: SupervisorState
    verdict: Verdict
    """The verdict on what was proposed."""
    order: Verdict
    """The verdict on what is ordered: on the retraction after a stop, else the same."""


@dataclass(frozen=True, slots=True)
class ControlLoop:
    """Program and supervisor in the work frame of the program."""

    program: Program
    supervisor: Supervisor
    detector: OscillationDetector | None = None
    """Lowers the gain of a loop that swings, and at last ends the run; None lets it swing."""
    following: Following | None = None
    """Watches whether the robot goes where it is ordered to; None for a robot whose servo is not known."""
    sample_time: float = SAMPLE_MS * 1e-3
    """Sample time that the controller is tuned for, s; the first sample counts as that long."""
    guards: tuple[Supervisor, ...] = field(init=False, repr=False, compare=False)
    """The supervisor with the limits of each leg."""

    def __post_init__(self) -> None:
        whole = self.supervisor
        guards = (
            Supervisor(leg.limits, whole.speed, whole.witness, leg.works_aside or not leg.step.watches_way)
            for leg in self.program.row.legs
        )
        object.__setattr__(self, "guards", tuple(guards))

    def initial(self, start: Vector) -> LoopState:
        """State at the start point, away from the surface; its reported position in the base frame, m."""
        return LoopState(start, self.program.initial(), self.supervisor.initial(start))

    def finish(self, state: LoopState, reason: Reason) -> LoopState:
        """Retract from the next sample on, for a reason from outside the decision."""
        return replace(state, program=self.program.finish(state.program, reason))

    def step(self, state: LoopState, sample: Sample) -> tuple[LoopState, Decision]:
        """One cycle: what is proposed, judged."""
        return self.judge(state, sample, self.propose(state, sample))

    def since(self, before: float | None, now: float) -> float:
        """Time that a sample counts for when the one before was looked at then, both s on the run's clock.

        A sample that comes late counts for no more than `LONGEST_SAMPLES`: a computer that stood still must not make
        the tool leap. Where the time is not known the sample time stands for it.
        """
        passed = math.nan if before is None else now - before
        if 0.0 <= passed < LONGEST_SAMPLES * self.sample_time:
            return passed
        if not math.isfinite(passed):
            return self.sample_time
        return 0.0 if passed < 0.0 else LONGEST_SAMPLES * self.sample_time

    def propose(self, state: LoopState, sample: Sample) -> Proposal:
        """Return the intent of program and controller for a sample."""
        before, dt = state.program, self.since(state.seen_at, sample.now)
        if sample.doubt != before.step.stroke.doubt:
            stroke = replace(before.step.stroke, doubt=Doubt(sample.doubt))
            before = replace(before, step=replace(before.step, stroke=stroke))
        before, contact = self.program.sense(before, sample, state.start, state.supervisor.depth, dt)
        program, intent, failed = self._decide(before, contact)
        oscillation, advice = self._watch(state.oscillation, contact.measurement, intent)
        if advice is not None and advice.factor < 1.0:
            intent = calm(intent, contact.measurement, advice)
        reason, trace = (None, "") if failed is None else failed
        return Proposal(
            contact=contact,
            intent=intent,
            failure=reason,
            advice=advice,
            program=program,
            oscillation=oscillation,
            trace=trace,
        )

    # --- the verdict on a proposal

    def judge(self, state: LoopState, sample: Sample, proposal: Proposal) -> tuple[LoopState, Decision]:
        """Return the supervisor's verdict on what was proposed for this sample, as the decision of the cycle.

        A stop turns the proposal into a retraction. While retracting only the limits of motion apply, and that of the
        force which the retraction itself makes.
        """
        intent, advice = proposal.intent, proposal.advice
        if proposal.failure is not None:  # of a step that follows a retraction, too
            route = _FAILURE
        elif (intent.phase is _RETRACT or intent.phase is _END) and self._retracts(proposal):
            route = _RETRACTION
        else:
            route = _OSCILLATION if advice is not None and advice.retract else _ORDER
        begins = intent.leg != state.program.course.leg
        against = self._against(proposal) if begins else proposal.contact.measurement.against
        observation = _observe(sample, proposal, against)
        case = Case(
            route=route,
            state=state,
            sample=sample,
            proposal=proposal,
            guard=self.guards[intent.leg],
            observation=observation,
        )
        if route is _ORDER:
            ruling = self._supervise_order(case)
        elif route is _RETRACTION:
            ruling = self._supervise_retraction(case)
        else:
            ruling = _stop_failure(case) if route is _FAILURE else _stop_oscillation(case)
        if type(ruling.verdict) is not Allow and (reason := _reason_to_end(case, ruling)) is not None:
            ruling = self._retract(case, ruling, reason)
        return self._conclude(case, ruling)

    def _supervise_retraction(self, case: Case) -> Ruling:
        """Supervise a retraction: at a stop it ends, and the tool stands still."""
        state, intent = case.state, case.proposal.intent
        supervisor, verdict = case.guard.retreat(
            state.supervisor, case.observation, self._request(state, intent)
        )
        if isinstance(verdict, Stop):
            intent = replace(intent, reason=verdict.reason, failed=True)
        return Ruling(case.proposal.program, intent, supervisor, verdict, verdict)

    def _supervise_order(self, case: Case) -> Ruling:
        """Supervise an order that presses or travels: by the limits, and the watch over the robot's path."""
        state, proposal, guard = case.state, case.proposal, case.guard
        request = self._request(state, proposal.intent, self._barrier(proposal, guard.limits))
        supervisor, verdict = guard.step(state.supervisor, case.observation, request)
        if isinstance(verdict, Stop):
            return Ruling(proposal.program, proposal.intent, supervisor, verdict, verdict)
        strayed = (
            ""
            if self.following is None
            else self.following.fault(state.trail, case.observation, guard.limits)
        )
        if strayed:
            supervisor, stop = guard.stop(supervisor, Reason(Cause.OFF_PATH, strayed))
            return Ruling(proposal.program, proposal.intent, supervisor, stop, stop)
        if proposal.advice is not None and proposal.advice.factor < 1.0:
            lowered = Reason(Cause.GAIN, f"the force swings: gain lowered to {proposal.advice.factor:g}")
            holds = verdict.holds if isinstance(verdict, Clamp) else ()
            verdict = Clamp(verdict.depth, verdict.position, (*holds, lowered))
        return Ruling(proposal.program, proposal.intent, supervisor, verdict, verdict)

    def _retract(self, case: Case, ruling: Ruling, reason: Reason) -> Ruling:
        """Retract in place of what was proposed, from the state before this sample: the controller's answer to
        it no longer matters.
        """
        state, proposal = case.state, case.proposal
        reason = proposal.failure or self.program.in_step(proposal.intent.leg, reason)
        program, intent = self.program.step(self.program.fail(state.program, reason), proposal.contact)
        request = self._request(state, intent)
        supervisor, order = case.guard.retreat(ruling.supervisor, case.observation, request)
        return Ruling(program, intent, supervisor, ruling.verdict, order)

    def _conclude(self, case: Case, ruling: Ruling) -> tuple[LoopState, Decision]:
        """Return the decision of a ruling, and the state behind it."""
        state, sample, measurement = case.state, case.sample, case.proposal.contact.measurement
        order, intent, before, held = ruling.order, ruling.intent, state.supervisor, False
        stands = isinstance(order, Stop)
        last = before if isinstance(order, Stop) else order
        depth, position = last.depth, last.position
        if (
            intent.phase is _RETRACT
            and intent.target.depth < before.depth <= depth
            and math.dist(before.position, position) <= _ROUNDING
        ):
            # Held back at the border of the workspace, a retraction has come as far as it can.
            held = not (isinstance(order, Clamp) and order.goes_on)
            if held and intent.reason is None and intent.leg < len(self.program.row.legs) - 1:  # more to do
                reason = explain_halt(ruling.verdict, case.observation)
                intent = replace(intent, reason=reason, failed=True)
        trail: Trail = ()
        if self.following is not None:
            reported = measurement.position, depth
            trail = self.following.after(state.trail, reported, sample.now, sample.position_at)
        after = LoopState(
            start=state.start,
            program=ruling.program,
            supervisor=ruling.supervisor,
            oscillation=case.proposal.oscillation,
            seen_at=sample.now,
            trail=trail,
        )
        return after, Decision(
            depth=measurement.position,
            force=measurement.force,
            target=Target(depth, intent.target.travel, intent.target.across),
            position=position,
            intent=intent,
            verdict=ruling.verdict,
            ended=ruling.program.step.stroke.phase is _END or held or stands,
            stands=stands,
            quaternion=ruling.supervisor.quaternion,
        )

    def _barrier(self, proposal: Proposal, limits: Limits) -> float:
        """Depth, m, at which the force limit less its margin is predicted. The prediction takes the stiffness in hand,
        the reported position and the force that belongs to it. What the robot has yet to do of its orders lies before
        it.
        """
        measurement = proposal.contact.measurement
        command = proposal.intent.command
        stiffness = self.program.stroke.parameters.expected_stiffness_n_m
        learnt = None if command is None else command.stiffness
        if learnt is not None and learnt > stiffness:
            stiffness = learnt
        left = limits.force_limit_n * (1.0 - limits.force_margin_share) - measurement.force_at_position
        barrier = measurement.position + left / stiffness
        return barrier if math.isfinite(barrier) else measurement.position

    def _decide(
        self, state: ProgramState, contact: ContactSample
    ) -> tuple[ProgramState, Intent, Failed | None]:
        """Decide the program's step, and report a failure of its controller or step; None if there is none.

        Both may come from a plug-in: every error that one raises, and an answer that is not of numbers or cannot
        be meant, is its failure.
        """
        measurement = contact.measurement
        try:
            program, intent = self.program.step(state, contact)
            command = intent.command
            if command is None or self._is_meant(command, measurement):
                return program, intent, None
            failed = blame_answer(self.program.controller, command)
        except RAISED as error:
            raise_if_interrupt(error)
            failed = blame_error(self.program.controller, self.program.row.legs[state.course.leg], error)
        return state, self.program.hold(state, measurement), failed

    def _is_meant(self, command: Command, measurement: Measurement) -> bool:
        """Whether a controller's answer is of numbers, and a place that it can mean."""
        # neither holds for what is not a number; a sum with what is huge would lose where the tool is
        limits, way = self.supervisor.limits, abs(command.position - measurement.commanded)
        meant = way <= limits.correction_total_mm * 1e-3 or way <= farthest_answer(limits)
        numbers = math.isfinite(command.correction + command.across + command.turn)
        return meant and numbers and is_stiffness(command.stiffness)

    def _retracts(self, proposal: Proposal) -> bool:
        """Whether an intent is the retraction that its phase tells. That of a step of a plug-in is watched as any
        other intent: a stop brings a retraction of ours.
        """
        return (
            proposal.program.course.reason is not None
            or not self.program.row.legs[proposal.intent.leg].foreign
        )

    def _against(self, proposal: Proposal) -> float:
        """Force against the way of the step that has begun with this sample, N. The sample was felt on the way of the
        step before.
        """
        leg = self.program.row.legs[proposal.intent.leg]
        if leg.way is None and leg.phase is Phase.MOVE:  # no path leads there
            return 0.0
        return proposal.contact.against(proposal.program.step.heading)

    def _watch(
        self, state: OscillationState, measurement: Measurement, intent: Intent
    ) -> tuple[OscillationState, Advice | None]:
        """Apply the oscillation detector to a sample of TRACK in contact; it restarts in every other phase."""
        if self.detector is None or intent.phase is not _TRACK:
            return _NO_OSCILLATION, None
        if intent.command is None or not intent.in_contact:
            return state, None
        reference = self.program.parameters.force_n if intent.reference is None else intent.reference
        error = measurement.force - reference
        return self.detector.step(state, error, intent.command.stiffness, measurement.dt)

    def _request(self, state: LoopState, intent: Intent, barrier: float = math.inf) -> Request:
        frame, depth, travel = self.program.frame, intent.target.depth, intent.target.travel
        (x, y, z), (a, b, c), (u, v, w) = state.start, frame.approach, frame.x
        target = x, y, z = x + depth * a + travel * u, y + depth * b + travel * v, z + depth * c + travel * w
        if aside := intent.target.across:
            r, s, t = frame.y
            target = x + aside * r, y + aside * s, z + aside * t
        learnt = None if intent.command is None else intent.command.stiffness
        stiffness = learnt, self.program.stroke.parameters.expected_stiffness_n_m
        return Request(
            depth=depth,
            position=target,
            direction=frame.approach,
            barrier=barrier,
            quaternion=intent.turned,
            stiffness=stiffness,
        )


def _stop_failure(case: Case) -> Ruling:
    """Stop the run because a controller or step failed."""
    failure = case.proposal.failure
    assert failure is not None
    return _stopped(case, failure)


def _stop_oscillation(case: Case) -> Ruling:
    """Stop the run because the force oscillates at the lowest gain."""
    advice = case.proposal.advice
    assert advice is not None
    text = f"the force continues swinging by ±{advice.amplitude:.1f} N at the lowest gain"
    return _stopped(case, Reason(Cause.OSCILLATION, text))


def _stopped(case: Case, reason: Reason) -> Ruling:
    supervisor, stop = case.guard.stop(case.state.supervisor, reason)
    return Ruling(case.proposal.program, case.proposal.intent, supervisor, stop, stop)


def _reason_to_end(case: Case, ruling: Ruling) -> Reason | None:
    """Return why a retraction must take the place of what was proposed and not allowed; None while it need not.

    A retraction stays one. An approach that is held in place would last for ever.
    """
    intent, verdict = ruling.intent, ruling.verdict
    if case.route is _RETRACTION and intent.phase is _RETRACT:
        return None
    match verdict:
        case Stop(reason=reason):
            return reason
        case Clamp(depth=depth, reasons=reasons) if (
            intent.phase is _APPROACH and depth <= case.state.supervisor.depth and not verdict.goes_on
        ):
            held = "the touch" if intent.in_contact else "no contact found: the approach"
            return Reason(Cause.HELD_APPROACH, f"{held} {', '.join(reasons)}")
        case Clamp() if intent.phase in (Phase.MOVE, Phase.SEEK) and verdict.is_for(Cause.WORKSPACE):
            return Reason(Cause.LEAVES_WORKSPACE, f"the {intent.phase} {LEAVES.text}")
        case _:
            return None


def _observe(sample: Sample, proposal: Proposal, against: float) -> Observation:
    contact, measurement, intent = proposal.contact, proposal.contact.measurement, proposal.intent
    if proposal.program.course.zero:  # a zero of the program's own hides no force either
        force = contact.force[0] if abs(contact.force[0]) > abs(sample.force) else sample.force
        sample = replace(sample, force=force, resultant=max(sample.resultant, math.hypot(*contact.force)))
    free = intent.phase in FREE_SPACE and not intent.in_contact
    return Observation(
        sample=sample,
        depth=measurement.position,
        dt=measurement.dt,
        pressing=intent.in_contact,
        against=against,
        aside=0.0 if sample.hidden is None else contact.aside,
        free_force=measurement.force if free else None,
    )
