"""The course of a program as a pure state machine: one leg after the other, each by the task with its parameters.

It takes the place of `course.task.Task` in the loop, and its state stands in `TaskState.course`. Approach, tracking and
retraction are the task's own; what a program adds is where the path leads, how fast, with which force and orientation.

While the force is controlled along the surface's normal, the controller is shown depths from the ground: the plane that
the estimated normal predicts along the path. So a corner or a way back, where the slope changes its sign, is no
disturbance for it.
"""

import math
from dataclasses import dataclass
from typing import Any

from msgspec.structs import replace

from hil_bridge.control.course.parameters import TaskParameters
from hil_bridge.control.course.task import Phase, Stride, Target, Task, TaskOutput, TaskState
from hil_bridge.control.program import free_steps
from hil_bridge.control.program.across import beside
from hil_bridge.control.program.facing import Facing, Look, elsewhere, inward
from hil_bridge.control.program.feed import STUCK_S, feed_of, progress, yielding
from hil_bridge.control.program.felt import Face, WorkFrame, lateral_of, measure_skew, subtract_zero
from hil_bridge.control.program.legs import Leg, Row
from hil_bridge.control.program.orienting import heading_of, turn_tool
from hil_bridge.control.program.outcome import added, count_sample, cut
from hil_bridge.control.program.outcome import done as outcome_of
from hil_bridge.control.program.state import CourseState, Felt, Tally
from hil_bridge.control.types import Controller, Measurement
from hil_bridge.control.words.paths import Place
from hil_bridge.control.words.steps import Hold, Move, Seek, Track, Zero
from hil_bridge.errors.causes import Cause, Reason
from protocol.geometry import normalise

_TRACK, _RETRACT, _END, _APPROACH = Phase.TRACK, Phase.RETRACT, Phase.END, Phase.APPROACH
_ROUNDING = 1e-9
"""Slack for sums of steps, m."""


POINT = Face()
"""A tool that touches in a point, where its contact moments are told about."""
FACING = Facing()
"""The estimate of the normal by default."""


@dataclass(frozen=True, slots=True)
class Program:
    """Steps a task through the legs of a program."""

    row: Row
    task: Task
    """The task with the run's own parameters."""
    frame: WorkFrame
    facing: Facing = FACING
    face: Face = POINT
    follows: bool = False
    """Control the force along the estimated normal whatever the tool's orientation."""
    safe_height: float = 0.0
    """Height over the start point, or the frame's plane, at which the tool goes to other places, m."""

    # --- as a task

    @property
    def parameters(self) -> TaskParameters:
        """The run's own parameters."""
        return self.task.parameters

    @property
    def controller(self) -> Controller[Any]:
        return self.task.controller

    @property
    def turns(self) -> bool:
        """Whether any step turns the tool."""
        return any(getattr(leg.step, "orientation", "fixed") != "fixed" for leg in self.row.legs)

    def initial(self) -> TaskState:
        """State at the start point, away from the surface."""
        return TaskState(course=CourseState())

    def way(self, speed_mm_s: float, dt: float) -> float:
        """As `Task.way`."""
        return self.task.way(speed_mm_s, dt)

    def finish(self, state: TaskState, reason: Reason) -> TaskState:
        """Retract from the next sample on and end, for a reason from outside."""
        if state.reason or state.phase is _END:
            return state
        turn = state.turn if state.phase is _RETRACT else None
        return replace(state, phase=Phase.RETRACT, turn=turn, reason=reason)

    def fail(self, state: TaskState, reason: Reason) -> TaskState:
        """Retract from the next sample on and end, because something is wrong."""
        if state.reason or state.phase is _END:
            return state
        course = state.course
        if course.began is not None:
            reason = reason.in_step(self.row.legs[course.leg].label)
        return replace(self.finish(state, reason), failed=True)

    def hold(self, state: TaskState, measurement: Measurement) -> TaskOutput:
        """The answer that changes nothing."""
        return self._output(state, self.task.hold(state, measurement))

    # --- what is felt

    def sense(
        self, state: TaskState, measurement: Measurement, felt: Felt
    ) -> tuple[TaskState, Measurement, Felt]:
        """The sample from the program's own zero, with the way along the path, and along the surface's normal where
        that is followed.
        """
        course = state.course
        if course.start is None:
            course = self._start(felt)
            state = replace(state, course=course)
        leg = self.row.legs[course.leg]
        if course.zero:
            felt = subtract_zero(felt, course, self.frame)
            change = felt.force[0] - measurement.force
            paired = measurement.paired_force
            measurement = replace(
                measurement, force=felt.force[0], paired_force=None if paired is None else paired + change
            )
        if leg.way is not None:
            place = felt.place[0] - course.origin[0], felt.place[1] - course.origin[1]
            along = leg.way.along(course.seen, state.travel - course.base, place)
            course = replace(course, seen=max(along, 0.0))
            state, measurement = (
                replace(state, course=course),
                replace(measurement, travel=course.base + along),
            )
        if state.phase is not _TRACK or not self._follows(leg):
            return state, measurement, felt
        return *self._along_normal(state, leg, measurement, felt), felt

    def _start(self, felt: Felt) -> CourseState:
        """State at the first sample."""
        frame = self.frame
        x, y = 0.0, 0.0
        if frame.origin is not None:
            x, y = (
                sum((p - o) * n for p, o, n in zip(felt.position, frame.origin, axis, strict=True)) - moved
                for axis, moved in zip((frame.x, frame.y), felt.place, strict=True)
            )
        plane = frame.plane or felt.position
        deep = sum((p - q) * n for p, q, n in zip(plane, felt.position, frame.approach, strict=True))
        home = None if felt.quaternion is None else normalise(felt.quaternion)
        return CourseState(start=(x, y), safe=min(deep - self.safe_height, 0.0), home=home)

    def _follows(self, leg: Leg) -> bool:
        return self.follows or getattr(leg.step, "orientation", "") == "normal"

    def _along_normal(
        self, state: TaskState, leg: Leg, measurement: Measurement, felt: Felt
    ) -> tuple[TaskState, Measurement]:
        """The estimate after this sample, and the force along the normal."""
        course, heading = state.course, heading_of(leg, state.course)
        if state.in_contact:
            stiffness = state.stiffness or self.parameters.expected_stiffness_n_m
            per_angle = max(stiffness, 1.0) * self.face.radius**2 / 4.0
            slides = leg.way is not None and abs(course.feed) > 0.05
            look = Look(
                measurement.dt,
                measurement.travel,
                measurement.position - measurement.force_at_position / max(stiffness, 1.0),
                felt.force,
                heading if slides else (0.0, 0.0),
                *measure_skew(self.frame, self.face, felt, per_angle),
            )
            course = replace(course, facing=self.facing.after(course.facing, look, per_angle or 1.0))
            state = replace(state, course=course)
        a, t, b = inward(course.facing.fall)
        force = measurement.force
        if not (math.isfinite(force) and force > self.parameters.loss_threshold_n):
            return state, measurement
        pressed = felt.force[0] * a + felt.force[1] * t + felt.force[2] * b
        paired = measurement.paired_force
        p, q = course.facing.fall
        slope = p * heading[0] + q * heading[1]
        return state, replace(
            measurement,
            force=pressed,
            paired_force=None if paired is None else paired * pressed / force,
            advance=1.0 / math.sqrt(1.0 + slope * slope),
        )

    # --- one sample

    def step(self, state: TaskState, measurement: Measurement, felt: Felt) -> tuple[TaskState, TaskOutput]:
        """One sample, after `sense`. Steps that end without it are passed over."""
        known = math.isfinite(measurement.force) and math.isfinite(measurement.position)
        if not (known or state.reason):
            return state, self.hold(state, measurement)
        while not state.reason and state.phase is not _END:
            if state.course.began is None:
                state = self._begin(state, felt)
            leg = self.row.legs[state.course.leg]
            if self._over(state, leg, measurement, felt):
                state = self._next(state, leg, felt)
                continue
            state, output, done = self._take(state, leg, measurement, felt)
            if not state.reason:
                course = turn_tool(state.course, leg, self.frame, self.facing, measurement.dt)
                state = replace(state, course=course)
            output = self._output(state, output)
            if state.reason:
                return replace(state, turn=None), output
            return (self._next(state, leg, felt) if done else state), output
        return self._leave(state, measurement, felt)

    def _leave(self, state: TaskState, measurement: Measurement, felt: Felt) -> tuple[TaskState, TaskOutput]:
        """Back out of the surface where the tool is; then the run ends."""
        course = state.course
        if course.began is not None:
            leg = self.row.legs[course.leg]
            state = replace(
                state,
                course=replace(
                    course, done=(*course.done, cut(course, leg, felt.now, state.reason)), began=None
                ),
            )
        course = yielding(
            state.course, felt.force, self.way(self.parameters.retract_speed_mm_s, measurement.dt)
        )
        state, output = self.task.step(replace(state, course=course), measurement)
        aside = math.hypot(felt.force[1], felt.force[2])
        if aside > max(self.parameters.contact_threshold_n, -felt.force[0]):  # not by what hangs above
            output = replace(output, in_contact=True)
        return state, self._output(state, output)

    def _begin(self, state: TaskState, felt: Felt) -> TaskState:
        """State at the first sample of a leg."""
        course, leg = state.course, self.row.legs[state.course.leg]
        presses = state.phase is _TRACK
        course = replace(
            course,
            began=felt.now,
            origin=course.at,
            base=state.travel,
            local=0.0,
            seen=0.0,
            aside=0.0,
            stage=0,
            since=felt.now,
            stuck=0.0,
            passed=0.0,
            yielded=0.0,
            feed=1.0,
            memory=None,
            found=((0.0, 0.0, 0.0), 0),
            readings=((), 0, -1),
            tally=Tally(),
            ground=course.ground if presses else 0.0,
            facing=course.facing if presses else elsewhere(course.facing),
        )
        if leg.first_of_repeat:
            course = replace(course, first_pass=None, this_pass=(0.0, 0.0))
        phase = _PHASES[leg.step.do]
        if phase is Phase.SEEK and leg.step.until == "edge":
            phase = _TRACK
        # a stroke begins elsewhere: what was learnt of places belongs to the one before
        memory = None if phase is _APPROACH else state.controller
        if phase is _TRACK and memory is None:
            memory = self.controller.initial()
        if phase is _TRACK:
            return replace(
                state, phase=phase, turn=None, lost_for=None, settled=False, controller=memory, course=course
            )
        return replace(
            state, phase=phase, turn=None, lost_at=None, controller=memory, course=course, touch=None
        )

    def _over(self, state: TaskState, leg: Leg, measurement: Measurement, felt: Felt) -> bool:
        """Whether a leg is over before it has used this sample."""
        step, course = leg.step, state.course
        if step.do == "approach":
            touches = measurement.force > leg.stroke.parameters.contact_threshold_n
            return touches and leg.stroke.is_proven(state)
        for_s = getattr(step, "for_s", None)
        return for_s is not None and felt.now - course.began >= for_s

    def _take(
        self, state: TaskState, leg: Leg, measurement: Measurement, felt: Felt
    ) -> tuple[TaskState, TaskOutput, bool]:
        """One sample of a leg: state, answer, and whether the leg ends with it."""
        step = leg.step
        if state.phase is _TRACK or (state.phase is _APPROACH and step.do != "approach"):
            return self._press(state, leg, measurement, felt)
        match step:
            case Move():
                taken = free_steps.move(leg, state, measurement, felt)
            case Seek():
                taken = free_steps.seek(leg, state, measurement, felt)
            case Zero():
                taken = free_steps.zero(leg, state, measurement, felt)
            case _:
                if state.phase is _RETRACT:
                    way = self.way(leg.stroke.parameters.retract_speed_mm_s, measurement.dt)
                    state = replace(state, course=yielding(state.course, felt.force, way))
                state, output = leg.stroke.step(state, measurement)
                if state.failed:
                    state = self._label_failure(state, leg)
                    output = replace(output, reason=state.reason)
                ended = state.phase is _END
                if ended:
                    state = replace(state, phase=Phase.RETRACT)
                return state, output, ended
        state, depth, done, trouble = taken
        if trouble:
            state = self.fail(state, trouble)
        phase = _PHASES[step.do]
        return state, TaskOutput(phase, Target(depth, 0.0), state.in_contact, losses=state.losses), done

    def _press(
        self, state: TaskState, leg: Leg, measurement: Measurement, felt: Felt
    ) -> tuple[TaskState, TaskOutput, bool]:
        """One sample of a leg that presses."""
        step, course, way = leg.step, state.course, leg.way
        local = state.travel - course.base
        reference = leg.reference(max(local, 0.0))
        feed, trouble = 1.0, None
        if isinstance(step, Track):
            lateral = lateral_of(felt.force, course.facing.fall if self._follows(leg) else (0.0, 0.0))
            feed, trouble = feed_of(step, measurement.force - reference, lateral, local)
            feed = min(feed, 0.0) if felt.held else feed
            course = replace(course, feed=feed)
            if step.lateral_limit_n is not None and state.in_contact and not felt.held:
                course = progress(course, leg.stroke.parameters.speed_mm_s, measurement.dt, local)
                if course.stuck >= STUCK_S:
                    text = (
                        f"a lateral force of {lateral:.1f} N holds the feed {local * 1e3:.1f} mm along the path: "
                        "something stands in the way"
                    )
                    trouble = trouble or Reason(Cause.NO_PROGRESS, text)
            state = replace(state, course=course)
        if trouble:
            state = self.fail(state, trouble)
            return state, self.task.hold(state, measurement), False
        before, ground = state, course.ground
        fall = course.facing.fall if self._follows(leg) else (0.0, 0.0)
        seen = measurement
        if ground or fall != (0.0, 0.0):
            behind = _rise(fall, felt.place, course.at)
            seen = replace(
                measurement,
                position=measurement.position - (ground - behind),
                commanded=measurement.commanded - ground,
            )
        state, output = leg.stroke.step(state, seen, Stride(reference, feed))
        if state.travel < course.base:
            state = replace(state, travel=course.base)
        local = state.travel - course.base
        course = state.course
        if isinstance(step, Track) and step.across != "position":
            course = beside(leg.stroke, step, course, measurement, _leftwards(leg, state, felt))
        at = course.at
        if way is not None:
            (x, y), (h, k) = way.at(local), way.headings[way.piece(local)]
            at = course.origin[0] + x - course.aside * k, course.origin[1] + y + course.aside * h
        raised = ground + _rise(fall, course.at, at)
        course = count_sample(
            replace(course, at=at, ground=raised, local=local if way else 0.0),
            leg,
            before,
            state,
            measurement,
        )
        began = felt.now if course.began is None else course.began
        if isinstance(step, Hold) and felt.now - began >= step.for_s / 2:
            course = replace(course, found=added(course.found, felt.position))
        stiffness = state.stiffness if output.command is None else output.command.stiffness or state.stiffness
        state = replace(state, course=course, stiffness=stiffness)
        depth = output.target.depth + raised
        output = replace(
            output,
            target=Target(depth, 0.0),
            reference=reference,
            command=_shift_answer(output.command, raised),
        )
        if isinstance(step, Seek):
            return self._edge((before, state), leg, output, measurement, felt)
        if state.phase is _RETRACT:  # the task has given up
            state = (
                self._label_failure(state, leg)
                if state.failed
                else replace(state, phase=Phase.TRACK, reason=None)
            )
            output = replace(output, reason=state.reason, failed=state.failed)
        return state, output, way is not None and local >= way.length - _ROUNDING

    def _edge(
        self,
        states: tuple[TaskState, TaskState],
        leg: Leg,
        output: TaskOutput,
        measurement: Measurement,
        felt: Felt,
    ) -> tuple[TaskState, TaskOutput, bool]:
        """A leg that looks for the end of the surface: a loss of contact is what it wants."""
        before, state = states
        course = state.course
        if state.in_contact:
            state = replace(state, course=replace(course, found=(felt.position, 1)))
            assert leg.way is not None
            if state.travel - course.base >= leg.way.length - _ROUNDING or state.phase is _RETRACT:
                mm = leg.way.length * 1e3
                state = self.fail(
                    replace(state, phase=Phase.TRACK, reason=None, failed=False),
                    Reason(Cause.NO_EDGE, f"no edge within {mm:g} mm"),
                )
            return state, replace(output, reason=state.reason, failed=state.failed), False
        lost = state.phase is not _TRACK or state.reason is not None
        if lost:  # stand still: the next leg leads away
            state = replace(before, course=course, travel=state.travel)
            target = Target(measurement.commanded, 0.0)
            output = replace(output, phase=Phase.TRACK, target=target, reason=None, failed=False)
        return state, output, lost

    def _label_failure(self, state: TaskState, leg: Leg) -> TaskState:
        """The task's failure with the step's number."""
        return replace(state, reason=None if state.reason is None else state.reason.in_step(leg.label))

    def _next(self, state: TaskState, leg: Leg, felt: Felt) -> TaskState:
        """State behind a leg: its outcome, and where the row goes on."""
        course = state.course
        done = outcome_of(course, leg, felt.now, felt.position)
        number = course.leg + 1
        if leg.leave_to is not None:
            deep, way = course.this_pass
            mean = deep / way if way else None
            first = mean if course.first_pass is None else course.first_pass
            if (
                leg.removed is not None
                and mean is not None
                and first is not None
                and mean - first >= leg.removed
            ):
                number = leg.leave_to
                done = replace(done, text=f"{(mean - first) * 1e3:.3f} mm removed")
            course = replace(course, first_pass=first, this_pass=(0.0, 0.0))
        course = replace(
            course, leg=min(number, len(self.row.legs) - 1), began=None, done=(*course.done, done)
        )
        phase = Phase.END if number >= len(self.row.legs) else state.phase
        return replace(state, phase=phase, course=course)

    def _output(self, state: TaskState, output: TaskOutput) -> TaskOutput:
        """The task's answer with the place and orientation of the program."""
        course = state.course
        notes = {}
        if course.feed != 1.0:
            notes["feed"] = course.feed
        if math.isfinite(course.facing.sigma):
            p, q = course.facing.fall
            notes["normal_x_deg"], notes["normal_y_deg"] = (
                math.degrees(math.atan(slope)) for slope in (p, q)
            )
            notes["normal_sigma_deg"] = math.degrees(course.facing.sigma)
        return replace(
            output,
            target=Target(output.target.depth, *course.at),
            reason=state.reason,
            failed=state.failed,
            turned=course.turned,
            leg=course.leg,
            notes=notes,
        )


_PHASES = {
    "approach": Phase.APPROACH,
    "track": Phase.TRACK,
    "hold": Phase.TRACK,
    "seek": Phase.SEEK,
    "retract": Phase.RETRACT,
    "move": Phase.MOVE,
    "zero": Phase.ZERO,
}
"""Phase in which a leg begins."""


def _rise(fall: Place, before: Place, after: Place) -> float:
    """How much deeper the surface lies at one place than at another, m, going by its slopes."""
    return fall[0] * (after[0] - before[0]) + fall[1] * (after[1] - before[1])


def _leftwards(leg: Leg, state: TaskState, felt: Felt) -> tuple[float, float]:
    """Force to the left of the path, N, and the reported way to the left of it, m."""
    assert leg.way is not None
    course, local = state.course, state.travel - state.course.base
    (h, k), (x, y) = heading_of(leg, state.course), leg.way.at(local)
    dx, dy = felt.place[0] - course.origin[0] - x, felt.place[1] - course.origin[1] - y
    return h * felt.force[2] - k * felt.force[1], h * dy - k * dx


def _shift_answer(command: Any, ground: float) -> Any:
    """A controller's answer in depths from the start point."""
    return command if command is None or not ground else replace(command, position=command.position + ground)
