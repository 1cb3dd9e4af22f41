"""One cycle's decision as two pure functions: sample → program and controller → supervisor → target position.

The same functions make the decisions of a run and of its replay; a run looks at the clock between them.
"""

import math
from dataclasses import dataclass, field

from msgspec.structs import replace

from hil_bridge.control.course.answers import calm, explain_halt
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
    Verdict,
)
from hil_bridge.control.decision import Decision, LoopState, Proposal
from hil_bridge.control.failing import Failed, blame_answer, blame_error, is_stiffness
from hil_bridge.control.program.answer import farthest_answer
from hil_bridge.control.program.program import Program
from hil_bridge.control.program.state import Felt, ProgramState
from hil_bridge.control.sample import Sample
from hil_bridge.control.types import SAMPLE_MS, Command, Measurement
from hil_bridge.errors.causes import Cause, Reason
from hil_bridge.errors.failures import RAISED, raise_if_asked
from protocol.geometry import Vector

# Asked for in every cycle, by names of this module: until Python 3.12 an enum's own name costs ten times that.
_APPROACH, _TRACK, _RETRACT, _END = Phase.APPROACH, Phase.TRACK, Phase.RETRACT, Phase.END
LONGEST_SAMPLES = 2.0
"""Sample times that one sample counts for at most. Chosen: as far off as a control period may be."""
_NO_OSCILLATION = OscillationState()
_ROUNDING = 1e-9
"""Slack for arithmetic, m."""


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
        """Intent of program and controller for a sample."""
        before, dt = state.program, self.since(state.seen_at, sample.now)
        if sample.doubt != before.stroke.doubt:
            before = replace(before, stroke=replace(before.stroke, doubt=Doubt(sample.doubt)))
        before, felt = self.program.sense(before, sample, state.start, state.supervisor.depth, dt)
        program, intent, failed = self._decide(before, felt)
        oscillation, advice = self._watch(state.oscillation, felt.measurement, intent)
        if advice is not None and advice.factor < 1.0:
            intent = calm(intent, felt.measurement, advice)
        reason, trace = (None, "") if failed is None else failed
        return Proposal(felt, intent, reason, advice, program, oscillation, trace)

    def judge(self, state: LoopState, sample: Sample, proposal: Proposal) -> tuple[LoopState, Decision]:
        """The supervisor's word on what was proposed for this sample. A stop turns it into a retraction; while
        retracting only the limits of motion apply, and the force that the retraction itself makes.
        """
        program, intent, advice = proposal.program, proposal.intent, proposal.advice
        begins, measurement = intent.leg != state.program.leg, proposal.felt.measurement
        against = self._against(proposal) if begins else measurement.against
        observation, reported = _observe(sample, proposal, against), measurement.position
        guard, follows = self.guards[intent.leg], self.following
        ends = intent.phase is _RETRACT or intent.phase is _END
        backs = ends and proposal.failure is None and self._retracts(proposal)
        verdict: Verdict
        if proposal.failure is not None:  # of a step that follows a retraction, too
            supervisor, verdict = guard.stop(state.supervisor, proposal.failure.cause, proposal.failure.text)
        elif backs:
            request = self._request(state, intent)
            supervisor, verdict = guard.retreat(state.supervisor, observation, request)
            if isinstance(verdict, Stop):
                intent = replace(intent, reason=verdict.reason, failed=True)
        elif advice is not None and advice.retract:
            text = f"the force goes on swinging by ±{advice.amplitude:.1f} N at the lowest gain"
            supervisor, verdict = guard.stop(state.supervisor, Cause.OSCILLATION, text)
        else:
            request = self._request(state, intent, self._barrier(proposal, guard.limits))
            supervisor, verdict = guard.step(state.supervisor, observation, request)
            strayed = "" if follows is None else follows.fault(state.trail, observation, guard.limits)
            if strayed and not isinstance(verdict, Stop):
                supervisor, verdict = guard.stop(state.supervisor, Cause.OFF_PATH, strayed)
        reason = None if type(verdict) is Allow else _reason(state, intent, verdict)
        way: Verdict = verdict
        if reason is not None and not (backs and intent.phase is _RETRACT):
            # From the state before this sample: the controller's answer to it no longer matters.
            reason = proposal.failure or self.program.in_step(intent.leg, reason)
            program, intent = self.program.step(self.program.fail(state.program, reason), proposal.felt)
            supervisor, way = guard.retreat(supervisor, observation, self._request(state, intent))
        elif advice is not None and advice.factor < 1.0 and not isinstance(verdict, Stop):
            lowered = Reason(Cause.GAIN, f"the force swings: gain lowered to {advice.factor:g}")
            holds = verdict.holds if isinstance(verdict, Clamp) else ()
            way = verdict = Clamp(verdict.depth, verdict.position, (*holds, lowered))
        before, stands, held = state.supervisor, isinstance(way, Stop), False
        last = before if isinstance(way, Stop) else way
        depth, position = last.depth, last.position
        aside = math.dist(before.position, position) > _ROUNDING
        if intent.phase is _RETRACT and intent.target.depth < before.depth <= depth and not aside:
            # Held back at the border of the workspace, a retraction has come as far as it can.
            held = not (isinstance(way, Clamp) and way.goes_on)
            if held and intent.reason is None and intent.leg < len(self.program.row.legs) - 1:  # more to do
                intent = replace(intent, reason=explain_halt(verdict, observation), failed=True)
        trail: Trail = ()
        if follows is not None:
            trail = follows.after(state.trail, (reported, depth), sample.now, sample.position_at)
        after = LoopState(state.start, program, supervisor, proposal.oscillation, sample.now, trail)
        return after, Decision(
            reported,
            measurement.force,
            Target(depth, intent.target.travel, intent.target.across),
            position,
            intent,
            verdict,
            ended=program.stroke.phase is _END or held or stands,
            stands=stands,
            quaternion=supervisor.quaternion,
        )

    def _barrier(self, proposal: Proposal, limits: Limits) -> float:
        """Depth, m, at which the force limit less its margin is predicted. The prediction takes the stiffness in hand,
        the reported position and the force that belongs to it. What the robot has yet to do of its orders lies before
        it.
        """
        measurement = proposal.felt.measurement
        command = proposal.intent.command
        stiffness = self.program.stroke.parameters.expected_stiffness_n_m
        learnt = None if command is None else command.stiffness
        if learnt is not None and learnt > stiffness:
            stiffness = learnt
        left = limits.force_limit_n * (1.0 - limits.force_margin_share) - measurement.force_at_position
        barrier = measurement.position + left / stiffness
        return barrier if math.isfinite(barrier) else measurement.position

    def _decide(self, state: ProgramState, felt: Felt) -> tuple[ProgramState, Intent, Failed | None]:
        """The program's step, and what is wrong with its controller or its step; None while nothing is.

        Both may come from another package: every error that one raises, and an answer that is not of numbers or cannot
        be meant, is its failure.
        """
        measurement = felt.measurement
        try:
            program, intent = self.program.step(state, felt)
            command = intent.command
            if command is None or self._is_meant(command, measurement):
                return program, intent, None
            failed = blame_answer(self.program.controller, command)
        except RAISED as error:
            raise_if_asked(error)
            failed = blame_error(self.program.controller, self.program.row.legs[state.leg], error)
        return state, self.program.hold(state, measurement), failed

    def _is_meant(self, command: Command, measurement: Measurement) -> bool:
        """Whether a controller's answer is of numbers, and a place that it can mean."""
        # neither holds for what is no number; a sum with what is huge would lose where the tool is
        limits, way = self.supervisor.limits, abs(command.position - measurement.commanded)
        meant = way <= limits.correction_total_mm * 1e-3 or way <= farthest_answer(limits)
        numbers = math.isfinite(command.correction + command.across + command.turn)
        return meant and numbers and is_stiffness(command.stiffness)

    def _retracts(self, proposal: Proposal) -> bool:
        """Whether an intent is the retraction that its phase tells. That of a step of another package is watched as any
        other intent: a stop brings a retraction of ours.
        """
        return proposal.program.reason is not None or not self.program.row.legs[proposal.intent.leg].foreign

    def _against(self, proposal: Proposal) -> float:
        """Force against the way of the step that has begun with this sample, N. The sample was felt on the way of the
        step before.
        """
        leg = self.program.row.legs[proposal.intent.leg]
        if leg.way is None and leg.phase is Phase.MOVE:  # no path leads there
            return 0.0
        return proposal.felt.against(proposal.program.heading)

    def _watch(
        self, state: OscillationState, measurement: Measurement, intent: Intent
    ) -> tuple[OscillationState, Advice | None]:
        """The detector's word on a sample of TRACK in contact; it begins again with every other phase."""
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
        return Request(depth, target, frame.approach, barrier, intent.turned, stiffness)


def _reason(state: LoopState, intent: Intent, verdict: Verdict) -> Reason | None:
    """Why the run must end; None while it need not. An approach that is held in place would last for ever."""
    match verdict:
        case Stop(reason=reason):
            return reason
        case Clamp(depth=depth, reasons=reasons) if (
            intent.phase is _APPROACH and depth <= state.supervisor.depth and not verdict.goes_on
        ):
            held = "the touch" if intent.in_contact else "no contact found: the approach"
            return Reason(Cause.HELD_APPROACH, f"{held} {', '.join(reasons)}")
        case Clamp() if intent.phase in (Phase.MOVE, Phase.SEEK) and verdict.is_for(Cause.WORKSPACE):
            return Reason(Cause.LEAVES_WORKSPACE, f"the {intent.phase} {LEAVES.text}")
        case _:
            return None


def _observe(sample: Sample, proposal: Proposal, against: float) -> Observation:
    felt, measurement, intent = proposal.felt, proposal.felt.measurement, proposal.intent
    if proposal.program.zero:  # a zero of the program's own hides no force either
        force = felt.force[0] if abs(felt.force[0]) > abs(sample.force) else sample.force
        sample = replace(sample, force=force, resultant=max(sample.resultant, math.hypot(*felt.force)))
    free = intent.phase in FREE_SPACE and not intent.in_contact
    return Observation(
        sample,
        measurement.position,
        measurement.dt,
        intent.in_contact,
        against,
        felt.aside,
        measurement.force if free else None,
    )
