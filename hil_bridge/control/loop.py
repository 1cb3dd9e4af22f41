"""Decision of one cycle as two pure functions: sample → program and controller → supervisor → target position.

A run and its replay use the same functions. A run checks the clock between them.
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

# Used in every cycle: before Python 3.12, access through the enum takes ten times as long.
_APPROACH, _TRACK, _RETRACT, _END = Phase.APPROACH, Phase.TRACK, Phase.RETRACT, Phase.END
LONGEST_SAMPLES = 2.0
"""Maximum duration that one sample counts for, in sample times. Chosen: the largest allowed ratio of control period
to sample time.
"""
_NO_OSCILLATION = OscillationState()
_ROUNDING = 1e-9
"""Tolerance for rounding errors, m."""


class Route(Enum):
    """Route by which a proposal is judged."""

    FAILURE = "failure"
    """A controller or step has failed."""
    RETRACTION = "retraction"
    """The program or a built-in step retracts the tool."""
    OSCILLATION = "oscillation"
    """The force oscillates at the smallest gain."""
    ORDER = "order"
    """Any other order, which may press or travel."""


_FAILURE, _RETRACTION, _OSCILLATION, _ORDER = Route


class Case(Struct, frozen=True, gc=False):
    """Input from which a proposal is judged."""

    route: Route
    state: LoopState
    sample: Sample
    proposal: Proposal
    guard: Supervisor
    """Supervisor with the limits of the current leg."""
    observation: Observation


class Ruling(Struct, frozen=True, gc=False):
    """Proposal with the supervisor's verdict."""

    program: ProgramState
    intent: Intent
    supervisor: SupervisorState
    verdict: Verdict
    """Verdict on the proposal."""
    order: Verdict
    """Verdict on the order: on the retraction after a stop, otherwise equal to `verdict`."""


@dataclass(frozen=True, slots=True)
class ControlLoop:
    """Control loop: program and supervisor in the work frame of the program."""

    program: Program
    supervisor: Supervisor
    detector: OscillationDetector | None = None
    """Detector that lowers the gain of an oscillating loop and finally ends the run; None to allow oscillation."""
    following: Following | None = None
    """Check that the robot follows its orders; None if the servo of the robot is unknown."""
    sample_time: float = SAMPLE_MS * 1e-3
    """Sample time that the controller is tuned for, s. It is also the duration of the first sample."""
    guards: tuple[Supervisor, ...] = field(init=False, repr=False, compare=False)
    """Supervisors with the limits of each leg."""

    def __post_init__(self) -> None:
        supervisor = self.supervisor
        guards = (
            Supervisor(
                leg.limits, supervisor.speed, supervisor.witness, leg.works_aside or not leg.step.watches_way
            )
            for leg in self.program.row.legs
        )
        object.__setattr__(self, "guards", tuple(guards))

    def initial(self, start: Vector) -> LoopState:
        """Return the state at the start point, away from the surface. `start` is the reported position there, base
        frame, m.
        """
        return LoopState(start, self.program.initial(), self.supervisor.initial(start))

    def finish(self, state: LoopState, reason: Reason) -> LoopState:
        """Return the state that retracts from the next sample on, for an external reason."""
        return replace(state, program=self.program.finish(state.program, reason))

    def step(self, state: LoopState, sample: Sample) -> tuple[LoopState, Decision]:
        """Return the decision of one cycle, which consists of a proposal and the verdict on it."""
        return self.judge(state, sample, self.propose(state, sample))

    def since(self, before: float | None, now: float) -> float:
        """Return the duration that a sample counts for, s, given the time of the previous sample. Both times are in
        s on the run's clock.

        A late sample counts for at most `LONGEST_SAMPLES`, so that the tool does not leap after the computer was
        unresponsive. If the time is unknown, the duration is the sample time.
        """
        passed = math.nan if before is None else now - before
        if 0.0 <= passed < LONGEST_SAMPLES * self.sample_time:
            return passed
        if not math.isfinite(passed):
            return self.sample_time
        return 0.0 if passed < 0.0 else LONGEST_SAMPLES * self.sample_time

    def propose(self, state: LoopState, sample: Sample) -> Proposal:
        """Return the proposal of the program and the controller for a sample."""
        before, dt = state.program, self.since(state.previous_at, sample.now)
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
        """Return the decision of the cycle: the supervisor's verdict on the proposal for this sample.

        A stop turns the proposal into a retraction. While retracting, only the motion limits and the limit of the
        force that the retraction itself causes apply.
        """
        intent, advice = proposal.intent, proposal.advice
        if proposal.failure is not None:  # also of a step after a retraction
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
        """Supervise a retraction. A stop ends the retraction, and the tool stops."""
        state, intent = case.state, case.proposal.intent
        supervisor, verdict = case.guard.retreat(
            state.supervisor, case.observation, self._request(state, intent)
        )
        if isinstance(verdict, Stop):
            intent = replace(intent, reason=verdict.reason, failed=True)
        return Ruling(case.proposal.program, intent, supervisor, verdict, verdict)

    def _supervise_order(self, case: Case) -> Ruling:
        """Supervise an order that presses or travels, by checking the limits and the robot's path."""
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
            lowered = Reason(Cause.GAIN, f"the force oscillates: gain lowered to {proposal.advice.factor:g}")
            holds = verdict.holds if isinstance(verdict, Clamp) else ()
            verdict = Clamp(verdict.depth, verdict.position, (*holds, lowered))
        return Ruling(proposal.program, proposal.intent, supervisor, verdict, verdict)

    def _retract(self, case: Case, ruling: Ruling, reason: Reason) -> Ruling:
        """Retract instead of the proposal, from the state before this sample. The controller's response to the
        sample is discarded.
        """
        state, proposal = case.state, case.proposal
        reason = proposal.failure or self.program.in_step(proposal.intent.leg, reason)
        program, intent = self.program.step(self.program.fail(state.program, reason), proposal.contact)
        request = self._request(state, intent)
        supervisor, order = case.guard.retreat(ruling.supervisor, case.observation, request)
        return Ruling(program, intent, supervisor, ruling.verdict, order)

    def _conclude(self, case: Case, ruling: Ruling) -> tuple[LoopState, Decision]:
        """Return the decision that follows from a ruling, and the next state."""
        state, sample, measurement = case.state, case.sample, case.proposal.contact.measurement
        order, intent, before, is_over = ruling.order, ruling.intent, state.supervisor, False
        must_stop = isinstance(order, Stop)
        last = before if isinstance(order, Stop) else order
        depth, position = last.depth, last.position
        if (
            intent.phase is _RETRACT
            and intent.target.depth < before.depth <= depth
            and math.dist(before.position, position) <= _ROUNDING
        ):
            # A retraction that is held at the border of the workspace cannot continue.
            is_over = not (isinstance(order, Clamp) and order.goes_on)
            if (
                is_over and intent.reason is None and intent.leg < len(self.program.row.legs) - 1
            ):  # more steps follow
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
            previous_at=sample.now,
            trail=trail,
        )
        return after, Decision(
            depth=measurement.position,
            force=measurement.force,
            target=Target(depth, intent.target.travel, intent.target.across),
            position=position,
            intent=intent,
            verdict=ruling.verdict,
            ended=ruling.program.step.stroke.phase is _END or is_over or must_stop,
            stands=must_stop,
            quaternion=ruling.supervisor.quaternion,
        )

    def _barrier(self, proposal: Proposal, limits: Limits) -> float:
        """Return the depth at which the predicted force reaches the force limit less its margin, m. The prediction
        uses the current stiffness, the reported position and the force at that position. Orders that the robot has
        yet to carry out are added.
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
        """Return the response of the program's step, and the failure of its controller or step (None if there is no
        failure).

        Both controller and step may come from a plug-in. Every exception that they raise counts as a failure, and
        so does a response that is not numeric or is implausible.
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
        """Return whether the response of a controller is numeric and its position plausible."""
        # false for NaN; adding a huge number would lose the tool's position to rounding
        limits, distance = self.supervisor.limits, abs(command.position - measurement.commanded)
        meant = distance <= limits.correction_total_mm * 1e-3 or distance <= farthest_answer(limits)
        numbers = math.isfinite(command.correction + command.across + command.turn)
        return meant and numbers and is_stiffness(command.stiffness)

    def _retracts(self, proposal: Proposal) -> bool:
        """Return whether an intent is really the retraction that its phase declares. A retraction ordered by a
        plug-in's step is supervised like any other intent: a stop starts a built-in retraction.
        """
        return (
            proposal.program.course.reason is not None
            or not self.program.row.legs[proposal.intent.leg].foreign
        )

    def _against(self, proposal: Proposal) -> float:
        """Return the force against the direction of the step that has begun with this sample, N. The sample itself
        was measured during the previous step.
        """
        leg = self.program.row.legs[proposal.intent.leg]
        if leg.way is None and leg.phase is Phase.MOVE:  # no path leads there
            return 0.0
        return proposal.contact.against(proposal.program.step.heading)

    def _watch(
        self, state: OscillationState, measurement: Measurement, intent: Intent
    ) -> tuple[OscillationState, Advice | None]:
        """Apply the oscillation detector to a sample of TRACK in contact. The detector restarts in every other
        phase.
        """
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
    """Stop the run because the force oscillates at the smallest gain."""
    advice = case.proposal.advice
    assert advice is not None
    text = f"the force continues to oscillate by ±{advice.amplitude:.1f} N at the lowest gain"
    return _stopped(case, Reason(Cause.OSCILLATION, text))


def _stopped(case: Case, reason: Reason) -> Ruling:
    supervisor, stop = case.guard.stop(case.state.supervisor, reason)
    return Ruling(case.proposal.program, case.proposal.intent, supervisor, stop, stop)


def _reason_to_end(case: Case, ruling: Ruling) -> Reason | None:
    """Return the reason why a retraction must replace a proposal that was not allowed; None if no retraction is
    needed.

    A retraction stays a retraction. An approach that is held in position would never end.
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
            subject = "the touch" if intent.in_contact else "no contact found: the approach"
            return Reason(Cause.HELD_APPROACH, f"{subject} {', '.join(reasons)}")
        case Clamp() if intent.phase in (Phase.MOVE, Phase.SEEK) and verdict.is_for(Cause.WORKSPACE):
            return Reason(Cause.LEAVES_WORKSPACE, f"the {intent.phase} {LEAVES.text}")
        case _:
            return None


def _observe(sample: Sample, proposal: Proposal, against: float) -> Observation:
    contact, measurement, intent = proposal.contact, proposal.contact.measurement, proposal.intent
    if proposal.program.course.zero:  # the program's own zero must not hide a force either
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
