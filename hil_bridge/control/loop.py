"""One cycle's decision as two pure functions: sample → task and controller → supervisor → target position.

The same functions make the decisions of a run and of its replay; a run looks at the clock between them.
"""

import math
from dataclasses import dataclass

from msgspec.structs import replace

from hil_bridge.control.course.answers import calm, explain_halt
from hil_bridge.control.course.contour import Contour, ContourState, normal_force
from hil_bridge.control.course.following import Following, Trail
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.oscillation import Advice, OscillationDetector, OscillationState
from hil_bridge.control.course.supervisor import Supervisor
from hil_bridge.control.course.task import Phase, Target, Task, TaskOutput, TaskState
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
from hil_bridge.control.failing import Failed, blame_answer, blame_error, farthest_answer
from hil_bridge.control.program.program import Program
from hil_bridge.control.program.state import Felt
from hil_bridge.control.sample import Sample
from hil_bridge.control.types import SAMPLE_MS, Measurement
from hil_bridge.errors.causes import Cause, Reason
from hil_bridge.errors.failures import RAISED, raise_if_asked
from protocol.geometry import Vector, rotate

# Asked for in every cycle, by names of this module: until Python 3.12 an enum's own name costs ten times that.
_APPROACH, _TRACK, _RETRACT, _END = Phase.APPROACH, Phase.TRACK, Phase.RETRACT, Phase.END
_FREE = _APPROACH, Phase.MOVE, Phase.SEEK
LONGEST_SAMPLES = 2.0
"""Sample times that one sample counts for at most. Chosen: as far off as a control period may be."""
_NO_CONTOUR, _NO_OSCILLATION = ContourState(), OscillationState()


@dataclass(frozen=True, slots=True)
class ControlLoop:
    """Task and supervisor in the task frame."""

    task: Task | Program
    supervisor: Supervisor
    approach: Vector
    """Unit vector into the surface, base frame."""
    travel: Vector
    """Unit vector along the surface, base frame, perpendicular to `approach`."""
    detector: OscillationDetector | None = None
    """Lowers the gain of a loop that swings, and at last ends the run; None lets it swing."""
    contour: Contour | None = None
    """Estimates the surface's normal, along which the force is then controlled; None keeps the approach direction,
    as the paper does.
    """
    following: Following | None = None
    """Watches whether the robot goes where it is ordered to; None for a robot whose servo is not known."""
    sample_time: float = SAMPLE_MS * 1e-3
    """Sample time that the controller is tuned for, s; the first sample counts as that long."""

    @property
    def across(self) -> Vector:
        """Third direction of the work frame, base frame: its y axis, travel × approach."""
        (a, b, c), (u, v, w) = self.approach, self.travel
        return v * c - w * b, w * a - u * c, u * b - v * a

    def initial(self, start: Vector) -> LoopState:
        """State at the start point, away from the surface; its reported position in the base frame, m."""
        return LoopState(start, self.task.initial(), self.supervisor.initial(start))

    def finish(self, state: LoopState, reason: Reason) -> LoopState:
        """Retract from the next sample on, for a reason from outside: time is up, a person wants it."""
        return replace(state, task=self.task.finish(state.task, reason))

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
        """Intent of task and controller for a sample."""
        (x, y, z), (a, b, c) = sample.position, state.start
        x, y, z = x - a, y - b, z - c
        (a, b, c), (u, v, w) = self.approach, self.travel
        depth = x * a + y * b + z * c
        program = self.task if isinstance(self.task, Program) else None
        measurement = Measurement(
            sample.sensor_at,
            sample.force,
            depth,
            state.supervisor.depth,
            True,  # not looked at: the task judges contact
            sample.paired_force,
            x * u + y * v + z * w,
            saturated=sample.saturated,
            dt=self.since(state.seen_at, sample.now),
            against=0.0 if program is not None else sample.force_travel,
            sample=sample,
        )
        contour, before, felt = _NO_CONTOUR, state.task, None
        before = before if sample.doubt == before.doubt else replace(before, doubt=Doubt(sample.doubt))
        if program is not None:
            before, measurement, felt = program.sense(
                before, measurement, self._feel(state, sample, measurement)
            )
        elif self.contour is not None:
            contour, measurement = self._face(state, measurement, sample)
        if sample.held:
            measurement = replace(measurement, advance=0.0)
        task, output, failed = self._decide(before, measurement, felt)
        oscillation, advice = self._watch(state.oscillation, measurement, output)
        if advice is not None and advice.factor < 1.0:
            output = calm(output, measurement, advice)
        trace = "" if failed is None else failed.trace
        return Proposal(
            depth,
            measurement,
            output,
            None if failed is None else failed.reason,
            advice,
            task,
            oscillation,
            contour,
            felt,
            trace,
        )

    def judge(self, state: LoopState, sample: Sample, proposal: Proposal) -> tuple[LoopState, Decision]:
        """The supervisor's word on what was proposed for this sample. A stop turns it into a retraction; while
        retracting only the limits of motion apply, and the force that the retraction itself makes.
        """
        task, output, advice = proposal.task, proposal.output, proposal.advice
        seen, guard, follows = _observe(sample, proposal, output), self._guard(output), self.following
        verdict: Verdict
        if output.phase is _RETRACT or output.phase is _END:
            request = self._request(state, output)
            supervisor, verdict = guard.retreat(state.supervisor, seen, request)
            if isinstance(verdict, Stop):
                output = replace(output, reason=verdict.reason, failed=True)
        elif proposal.failure is not None:
            supervisor, verdict = guard.stop(state.supervisor, proposal.failure.cause, proposal.failure.text)
        elif advice is not None and advice.retract:
            text = f"the force goes on swinging by ±{advice.amplitude:.1f} N at the lowest gain"
            supervisor, verdict = guard.stop(state.supervisor, Cause.OSCILLATION, text)
        else:
            request = self._request(state, output, self._barrier(proposal, guard.limits))
            supervisor, verdict = guard.step(state.supervisor, seen, request)
            strayed = "" if follows is None else follows.fault(state.trail, seen, guard.limits)
            if strayed and not isinstance(verdict, Stop):
                supervisor, verdict = guard.stop(state.supervisor, Cause.OFF_PATH, strayed)
        reason = None if type(verdict) is Allow else _reason(state, output, verdict)
        way: Verdict = verdict
        if reason is not None and output.phase is not _RETRACT:
            # From the state before this sample: the controller's answer to it no longer matters.
            task, output = self._step(self.task.fail(state.task, reason), proposal.measurement, proposal.felt)
            supervisor, way = guard.retreat(supervisor, seen, self._request(state, output))
        elif advice is not None and advice.factor < 1.0 and not isinstance(verdict, Stop):
            lowered = Reason(Cause.GAIN, f"the force swings: gain lowered to {advice.factor:g}")
            holds = verdict.holds if isinstance(verdict, Clamp) else ()
            way = verdict = Clamp(verdict.depth, verdict.position, (*holds, lowered))
        before = state.supervisor
        stands, held = isinstance(way, Stop), False
        depth, position = (
            (before.depth, before.position) if isinstance(way, Stop) else (way.depth, way.position)
        )
        if output.phase is _RETRACT and output.target.depth < before.depth <= depth:
            # Held back at the border of the workspace, a retraction has come as far as it can.
            held = not (isinstance(way, Clamp) and way.goes_on)
            if held and output.reason is None:  # of a program, which has more to do
                output = replace(output, reason=explain_halt(verdict, seen), failed=True)
        trail: Trail = ()
        if follows is not None:
            trail = follows.after(state.trail, (proposal.depth, depth), sample.now, sample.position_at)
        after = LoopState(
            state.start, task, supervisor, proposal.oscillation, proposal.contour, sample.now, trail
        )
        return after, Decision(
            proposal.depth,
            proposal.measurement.force,
            proposal.contour.angle,
            Target(depth, output.target.travel, output.target.across),
            position,
            output,
            verdict,
            ended=task.phase is _END or held or stands,
            stands=stands,
            quaternion=supervisor.quaternion,
        )

    def _guard(self, output: TaskOutput) -> Supervisor:
        """The supervisor with the limits of the step under way."""
        if not isinstance(self.task, Program):
            return self.supervisor
        guard = self.supervisor
        return Supervisor(self.task.row.legs[output.leg].limits, guard.speed, guard.witness)

    def _barrier(self, proposal: Proposal, limits: Limits) -> float:
        """Depth, m, at which the force limit less its margin is predicted. The prediction takes the stiffness in hand,
        the reported position and the force that belongs to it. What the robot has yet to do of its orders lies before
        it.
        """
        measurement = proposal.measurement
        command = proposal.output.command
        stiffness = self.task.parameters.expected_stiffness_n_m
        if command is not None and command.stiffness is not None:
            stiffness = max(stiffness, command.stiffness)
        left = limits.force_limit_n * (1.0 - limits.force_margin_share) - measurement.force_at_position
        barrier = measurement.position + left / stiffness
        return barrier if math.isfinite(barrier) else measurement.position

    def _step(
        self, state: TaskState, measurement: Measurement, felt: Felt | None
    ) -> tuple[TaskState, TaskOutput]:
        if isinstance(self.task, Program):
            assert felt is not None
            return self.task.step(state, measurement, felt)
        return self.task.step(state, measurement)

    def _feel(self, state: LoopState, sample: Sample, measurement: Measurement) -> Felt:
        """The sample as a program needs it."""
        x, y, z = (p - s for p, s in zip(sample.position, state.start, strict=True))
        r, s, t = self.across
        across, quaternion = 0.0, None
        if len(sample.quaternion) == 4:
            quaternion = sample.quaternion
            if len(sample.wrench) == 6:
                across = -sum(
                    f * n for f, n in zip(rotate(quaternion, sample.wrench[:3]), self.across, strict=True)
                )
        return Felt(
            sample.now,
            (measurement.travel, x * r + y * s + z * t),
            sample.position,
            quaternion,
            (sample.force, sample.force_travel, across),
            sample.wrench,
            sample.sensor_sequence,
            held=sample.held,
        )

    def _decide(
        self, state: TaskState, measurement: Measurement, felt: Felt | None
    ) -> tuple[TaskState, TaskOutput, Failed | None]:
        """The task's step, and what is wrong with its controller; None while nothing is.

        A controller may come from another package: every error that it raises, and an answer that is not of numbers
        or cannot be meant, is its failure.
        """
        try:
            task, output = self._step(state, measurement, felt)
            command = output.command
            if command is None:
                return task, output, None
            # neither holds for what is no number; a sum with what is huge would lose where the tool is
            limits, way = self.supervisor.limits, abs(command.position - measurement.commanded)
            meant = way <= limits.correction_total_mm * 1e-3 or way <= farthest_answer(limits)
            if meant and math.isfinite(command.correction + command.across):
                return task, output, None
            failed = blame_answer(self.task.controller, command)
        except RAISED as error:
            raise_if_asked(error)
            failed = blame_error(self.task.controller, error)
        return state, self.task.hold(state, measurement), failed

    def _face(
        self, state: LoopState, measurement: Measurement, sample: Sample
    ) -> tuple[ContourState, Measurement]:
        """The measurement along the surface's normal while tracking; the estimate begins again with every contact."""
        if self.contour is None or state.task.phase is not _TRACK:
            return _NO_CONTOUR, measurement
        force, travel = measurement.force, measurement.travel
        contour = self.contour.after(
            state.contour, measurement.dt, (travel, measurement.position), (force, sample.force_travel)
        )
        if not (math.isfinite(force) and force > self.task.parameters.loss_threshold_n):
            return contour, measurement
        pressed = normal_force(contour.angle, force, sample.force_travel)
        paired = measurement.paired_force
        return contour, replace(
            measurement,
            force=pressed,
            paired_force=None if paired is None else paired * pressed / force,
            advance=math.cos(contour.angle),
        )

    def _watch(
        self, state: OscillationState, measurement: Measurement, output: TaskOutput
    ) -> tuple[OscillationState, Advice | None]:
        """The detector's word on a sample of TRACK in contact; it begins again with every other phase."""
        if self.detector is None or output.phase is not _TRACK:
            return _NO_OSCILLATION, None
        if output.command is None or not output.in_contact:
            return state, None
        wanted = self.task.parameters.force_n if output.reference is None else output.reference
        error = measurement.force - wanted
        return self.detector.step(state, error, output.command.stiffness, measurement.dt)

    def _request(self, state: LoopState, output: TaskOutput, barrier: float = math.inf) -> Request:
        depth, travel = output.target.depth, output.target.travel
        (x, y, z), (a, b, c), (u, v, w) = state.start, self.approach, self.travel
        target = x + depth * a + travel * u, y + depth * b + travel * v, z + depth * c + travel * w
        if aside := output.target.across:
            x, y, z = (p + aside * n for p, n in zip(target, self.across, strict=True))
            target = x, y, z
        return Request(depth, target, self.approach, barrier, output.turned)


def _reason(state: LoopState, output: TaskOutput, verdict: Verdict) -> Reason | None:
    """Why the run must end; None while it need not. An approach that is held in place would last for ever."""
    match verdict:
        case Stop(reason=reason):
            return reason
        case Clamp(depth=depth, reasons=reasons) if (
            output.phase is _APPROACH and depth <= state.supervisor.depth and not verdict.goes_on
        ):
            held = "the touch" if output.in_contact else "no contact found: the approach"
            return Reason(Cause.HELD_APPROACH, f"{held} {', '.join(reasons)}")
        case Clamp() if output.phase in (Phase.MOVE, Phase.SEEK) and verdict.is_for(Cause.WORKSPACE):
            return Reason(Cause.LEAVES_WORKSPACE, f"the {output.phase} {LEAVES.text}")
        case _:
            return None


def _observe(sample: Sample, proposal: Proposal, output: TaskOutput) -> Observation:
    force, resultant, felt = sample.force, sample.resultant, proposal.felt
    if felt is not None and proposal.task.course.zero:  # a zero of the program's own hides no force either
        force = felt.force[0] if abs(felt.force[0]) > abs(force) else force
        resultant = max(resultant, math.hypot(*felt.force))
    # by place, in the order of the fields: by name every one costs as much as to read it
    return Observation(
        sample.now,
        force,
        resultant,
        sample.sensor_at,
        sample.sensor_sequence,
        sample.unchanged,
        sample.saturated,
        sample.dead_axis,
        output.in_contact,
        proposal.depth,
        sample.fault,
        sample.peak_force,
        sample.peak_resultant,
        sample.peak_moment,
        None if sample.tilt is None else sample.position,
        sample.tilt or 0.0,
        sample.gap,
        proposal.measurement.dt,
        None if proposal.felt is None else proposal.felt.quaternion,
        proposal.measurement.against,
        sample.witness,
        proposal.measurement.force if output.phase in _FREE and not output.in_contact else None,
        sample.overdue,
        sample.fault_cause or Cause.ROBOT_STATE,
        sample.fault_remedy,
    )
