"""Program as a pure state machine: a sequence of legs, each carried out by its step and its stroke.

A run without steps is the program of an approach, a straight path and a retraction. See
`docs/explanation/one-cycle.md` for the path of one sample from the sensor to the order.
"""

import math
from dataclasses import dataclass
from typing import Any

from msgspec.structs import replace

from hil_bridge.control.course.contact_sample import ContactSample
from hil_bridge.control.course.facing import Facing, FacingSample, elsewhere, inward
from hil_bridge.control.course.intent import Intent, Phase, Target
from hil_bridge.control.course.parameters import TaskParameters
from hil_bridge.control.course.state import Course, StepState
from hil_bridge.control.course.stroke import Order, Stroke
from hil_bridge.control.course.yielding import go_back, yield_to
from hil_bridge.control.geometry.ways import Place
from hil_bridge.control.geometry.work_frame import Face, WorkFrame
from hil_bridge.control.program.answer import check_result
from hil_bridge.control.program.contact_force import find_across, measure_skew, subtract_zero
from hil_bridge.control.program.leg import Leg, Row, StepFailed
from hil_bridge.control.program.orienting import heading_of, turn_tool
from hil_bridge.control.program.outcome import cut, ending, outcome
from hil_bridge.control.program.state import ProgramState
from hil_bridge.control.sample import Sample
from hil_bridge.control.steps.seam import StepContext, StepResult
from hil_bridge.control.types import Controller, ControllerFailed, Measurement
from hil_bridge.errors.causes import Reason
from hil_bridge.errors.failures import RAISED, raise_if_interrupt
from protocol.geometry import Vector, normalise

_TRACK, _RETRACT, _END, _APPROACH = Phase.TRACK, Phase.RETRACT, Phase.END, Phase.APPROACH
_MOVE = Phase.MOVE

_SLIDES = 0.05
"""Smallest share of the speed at which the tool counts as sliding along its path. Chosen."""
POINT = Face()
"""Tool with a point contact at the reference point of the contact moments."""
FACING = Facing()
"""Default estimator of the normal."""


@dataclass(frozen=True, slots=True)
class Program:
    """Program that carries out its legs, sample by sample."""

    row: Row
    stroke: Stroke
    """Stroke with the parameters of the run."""
    frame: WorkFrame
    facing: Facing = FACING
    face: Face = POINT
    safe_height: float = 0.0
    """Height above the start point, or above the plane of the frame, at which the tool moves to other points, m."""

    @property
    def parameters(self) -> TaskParameters:
        """Parameters of the run."""
        return self.stroke.parameters

    @property
    def controller(self) -> Controller[Any]:
        return self.stroke.controller

    @property
    def turns(self) -> bool:
        """Whether any step turns the tool."""
        return any(leg.step.orientation != "fixed" for leg in self.row.legs)

    def initial(self) -> ProgramState:
        """Return the state at the start point, away from the surface."""
        return ProgramState()

    def finish(self, state: ProgramState, reason: Reason) -> ProgramState:
        """Return the state that retracts from the next sample on and ends, for an external reason."""
        return self._end(state, reason, failed=False)

    def fail(self, state: ProgramState, reason: Reason) -> ProgramState:
        """Return the state that retracts from the next sample on and ends, because of a failure."""
        return self._end(state, self.where(state, reason), failed=True)

    def _end(self, state: ProgramState, reason: Reason, failed: bool) -> ProgramState:
        """Return the state that retracts from the next sample on. An earlier reason is kept."""
        if state.course.reason or state.phase is _END:
            return state
        stroke = state.step.stroke
        turn = stroke.turn if stroke.phase is _RETRACT else None
        step = replace(state.step, stroke=replace(stroke, phase=_RETRACT, turn=turn))
        return ProgramState(replace(state.course, reason=reason, failed=failed), step)

    def where(self, state: ProgramState, reason: Reason) -> Reason:
        """Return a reason with the step in which the run stops added, if an operator has written the steps."""
        return reason if state.course.began is None else self.in_step(state.course.leg, reason)

    def in_step(self, number: int, reason: Reason) -> Reason:
        """Return a reason that arose in the given leg with its step added, if an operator has written the steps."""
        return reason.in_step(self.row.legs[number].label) if self.row.written else reason

    def completed(self, state: ProgramState) -> Reason | None:
        """Return the reason why a successful run has ended; None if its steps report it."""
        return state.course.reason or (None if self.row.written else state.course.travelled)

    def hold(self, state: ProgramState, measurement: Measurement) -> Intent:
        """Return the intent that changes nothing."""
        phase = self.row.legs[state.course.leg].phase if state.course.began is None else state.phase
        return self._intent(state, Order(phase, measurement.commanded))

    # --- the sample in the work frame

    def sense(
        self, state: ProgramState, sample: Sample, start: Vector, ordered: float, dt: float
    ) -> tuple[ProgramState, ContactSample]:
        """Return the sample in the work frame, relative to the program's own zero.

        The measurement contains the path length. Its force is along the surface's normal if the step follows the
        normal. `start` is the reported position at the start point, base frame, m. `ordered` is the previously
        ordered depth, m. `dt` is the time since that order, s.
        """
        course, step = state.course, state.step
        frame, wrench, paired, (h, k) = self.frame, sample.wrench, sample.paired_force, step.heading
        (x, y, z), (a, b, c) = sample.position, start
        x, y, z = x - a, y - b, z - c
        (a, b, c), (u, v, w), (r, s, t) = frame.approach, frame.x, frame.y
        depth, place = x * a + y * b + z * c, (x * u + y * v + z * w, x * r + y * s + z * t)
        if course.start is None:
            course = self._start(course, sample, place)
        across = sample.force_across
        force = sample.force, sample.force_travel, find_across(frame, sample) if across is None else across
        if course.zero:
            force, wrench = subtract_zero(course, frame, sample, force)
            paired = None if paired is None else paired + (force[0] - sample.force)
        leg, travel = self.row.legs[course.leg], place[0]
        if course.began is None and leg.way is not None and course.reason is None:
            course, step = _begin_path(course, step, leg)
            h, k = step.heading
        against = force[1] * h + force[2] * k
        if leg.way is not None:
            there = place[0] - course.origin[0], place[1] - course.origin[1]
            along = leg.way.along(course.reached, step.stroke.travel - course.base, there)
            reached, travel = 0.0 if along < 0.0 else along, course.base + along
            if reached != course.reached:
                course = replace(course, reached=reached)
        elif leg.phase is _MOVE:  # no path leads there
            against = 0.0
        measurement = Measurement(
            time=sample.sensor_at,
            force=force[0],
            position=depth,
            commanded=ordered,
            in_contact=True,  # not used: the stroke judges contact
            paired_force=paired,
            travel=travel,
            travel_next=0.0,
            free_position=None,
            advance=0.0 if sample.held else 1.0,
            saturated=sample.saturated,
            dt=dt,
            against=against,
            sample=sample,
        )
        contact = ContactSample(sample, measurement, place, force, wrench)
        if course is not state.course or step is not state.step:
            state = ProgramState(course, step)
        if not leg.follows or step.stroke.phase is not _TRACK:
            return state, contact
        return self._along_normal(state, leg, contact)

    def _start(self, course: Course, sample: Sample, place: Place) -> Course:
        """Return the course at the first sample."""
        frame, position, quaternion = self.frame, sample.position, sample.orientation
        x, y = 0.0, 0.0
        if frame.origin is not None:
            x, y = (
                sum((p - o) * n for p, o, n in zip(position, frame.origin, axis, strict=True)) - travelled
                for axis, travelled in zip((frame.x, frame.y), place, strict=True)
            )
        plane = frame.plane or position
        deep = sum((p - q) * n for p, q, n in zip(plane, position, frame.approach, strict=True))
        home = None if quaternion is None else normalise(quaternion)
        return replace(course, start=(x, y), safe=min(deep - self.safe_height, 0.0), home=home)

    def _along_normal(
        self, state: ProgramState, leg: Leg, contact: ContactSample
    ) -> tuple[ProgramState, ContactSample]:
        """Return the estimate of the normal after this sample, and the sample with the force along the normal."""
        heading, measurement = heading_of(leg, state), contact.measurement
        if state.in_contact:
            stiffness = state.step.stroke.stiffness or self.parameters.expected_stiffness_n_m
            per_angle = max(stiffness, 1.0) * self.face.radius**2 / 4.0
            slides = leg.way is not None and abs(state.step.feed) > _SLIDES
            indented = measurement.force_at_position / max(stiffness, 1.0) if leg.shows_ground else 0.0
            reading = FacingSample(
                measurement.dt,
                measurement.travel,
                measurement.position - indented,
                contact.force,
                heading if slides else (0.0, 0.0),
                *measure_skew(self.frame, self.face, contact, per_angle),
            )
            facing = self.facing.after(state.course.facing, reading, per_angle or 1.0)
            state = ProgramState(replace(state.course, facing=facing), state.step)
        fall, force = state.course.facing.fall, measurement.force
        if not (math.isfinite(force) and force > self.parameters.loss_threshold_n):
            return state, contact
        a, t, b = inward(fall)
        pressed = contact.force[0] * a + contact.force[1] * t + contact.force[2] * b
        paired = measurement.paired_force
        slope = fall[0] * heading[0] + fall[1] * heading[1]
        measurement = replace(
            measurement,
            force=pressed,
            paired_force=None if paired is None else paired * pressed / force,
            advance=measurement.advance / math.sqrt(1.0 + slope * slope),
        )
        return state, replace(contact, measurement=measurement)

    # --- one sample

    def step(self, state: ProgramState, contact: ContactSample) -> tuple[ProgramState, Intent]:
        """Return the state and the intent after one sample from `sense`. Steps that end without using the sample
        are skipped.
        """
        measurement = contact.measurement
        finite = math.isfinite(measurement.force + measurement.position + measurement.against)
        if not (finite or state.course.reason):  # a built-in retraction needs neither
            leg = self.row.legs[state.course.leg]
            if leg.phase is not _RETRACT or leg.foreign:
                return state, self.hold(state, measurement)
        while state.course.reason is None and state.step.stroke.phase is not _END:
            if state.course.began is None:
                state = self._begin(state, contact.sample.now)
            course = state.course
            leg = self.row.legs[course.leg]
            result = _step_answer(leg, StepContext(leg, course, contact), state.step)
            if result is None:
                state = self._next(state, leg, contact)
                continue
            state = ProgramState(replace(course, zero=result.zero) if result.zero else course, result.state)
            if result.trouble is not None:  # no order goes deeper from now on, regardless of the step
                depth = min(result.order.depth, measurement.commanded)
                state = self.fail(state, result.trouble)
                return state, self._intent(state, replace(result.order, depth=depth))
            if leg.turns:
                turned = turn_tool(state, leg, self.frame, self.facing, measurement.dt)
                if turned is not course.turned:
                    state = ProgramState(replace(state.course, turned=turned), state.step)
            intent = self._intent(state, result.order)
            return (self._next(state, leg, contact) if result.done else state), intent
        return self._leave(state, contact)

    def _leave(self, state: ProgramState, contact: ContactSample) -> tuple[ProgramState, Intent]:
        """Retract from the surface at the tool's position, and then end the run."""
        course, step = state.course, state.step
        leg = self.row.legs[course.leg]
        if course.began is not None:
            done = cut(state, leg, contact.sample.now, course.reason)
            course = replace(course, done=(*course.done, done), began=None)
        before = step.at
        distance = self.stroke.way(self.parameters.retract_speed_mm_s, contact.measurement.dt)
        if course.failed and leg.phase in (_MOVE, Phase.SEEK):
            step = go_back(step, course.origin, contact, distance)
        else:
            step = yield_to(step, contact, (distance, self.stroke.friction_share), leg.works_aside)
        stroke, order = self.stroke.step(step.stroke, contact.measurement)
        if step.at != before and stroke.phase is _END:  # not before the tool is clear of the obstacle
            stroke = replace(stroke, phase=_RETRACT)
        state = ProgramState(course, replace(step, stroke=stroke))
        intent = self._intent(state, order)
        aside = math.hypot(contact.force[1], contact.force[2])
        least = max(self.parameters.contact_threshold_n, -contact.force[0])  # not for an obstacle above
        if leg.works_aside and aside > least:
            intent = replace(intent, in_contact=True)
        return state, intent

    def _begin(self, state: ProgramState, now: float) -> ProgramState:
        """Return the state at the first sample of a leg."""
        leg, stroke = self.row.legs[state.course.leg], state.step.stroke
        seeks, phase = self._seeks(state), leg.phase
        presses = seeks or stroke.phase is _TRACK
        if phase is _TRACK:  # a touch that is not confirmed yet stays so in any next step
            stroke = stroke if seeks else leg.stroke.tracking(stroke)
        else:  # a stroke at another position: the learnt positions belong to the previous one
            memory = None if phase is _APPROACH else stroke.controller
            stroke = replace(stroke, phase=phase, turn=None, lost_at=None, controller=memory, touch=None)
        course, step = _begin_path(state.course, state.step, leg)
        again: dict[str, Any] = {"first_pass": None, "this_pass": (0.0, 0.0)} if leg.repeat.is_first else {}
        facing = course.facing if presses else elsewhere(course.facing)
        course = replace(course, began=now, facing=facing, **again)
        ground = step.ground if presses else 0.0
        return ProgramState(course, StepState(stroke, step.at, step.heading, ground))

    def _seeks(self, state: ProgramState) -> bool:
        """Return whether the previous step has ended before its touch was confirmed. An approach confirms its own
        touch.
        """
        if state.phase is not _APPROACH or not state.course.done:
            return False
        before = self.row.legs[state.course.done[-1].leg]
        return before.step.controls or not before.stroke.is_proven(state.step.stroke)

    def _next(self, state: ProgramState, leg: Leg, contact: ContactSample) -> ProgramState:
        """Return the state after a leg: its outcome, and the leg at which the program continues."""
        course, step, repeat = state.course, state.step, leg.repeat
        done = outcome(state, leg, contact.sample.now, contact.sample.position)
        number, first, this = course.leg + 1, course.first_pass, course.this_pass
        if leg.way is not None:
            this = this[0] + step.tally.deep, this[1] + step.tally.total
        if repeat.leave_to is not None:
            (deep, path), this = this, (0.0, 0.0)
            mean = deep / path if path else None
            first = mean if first is None else first
            removed = 0.0 if mean is None or first is None else mean - first
            if repeat.removed is not None and mean is not None and removed >= repeat.removed:
                number = repeat.leave_to
                done = replace(done, text=f"{removed * 1e3:.3f} mm removed")
        if number >= len(self.row.legs):
            number, step = len(self.row.legs) - 1, replace(step, stroke=replace(step.stroke, phase=_END))
        course = replace(
            course,
            leg=number,
            began=None,
            first_pass=first,
            this_pass=this,
            travelled=ending(state, leg) or course.travelled,
            done=(*course.done, done),
        )
        return ProgramState(course, step)

    def _intent(self, state: ProgramState, order: Order) -> Intent:
        """Return the order of a step, completed with the position and orientation of the program."""
        course, step, stroke, notes = state.course, state.step, state.step.stroke, {}
        x, y = step.at
        if step.feed != 1.0:
            notes["feed"] = step.feed
        if math.isfinite(course.facing.sigma):
            p, q = course.facing.fall
            notes["normal_x_deg"], notes["normal_y_deg"] = (
                math.degrees(math.atan(slope)) for slope in (p, q)
            )
            notes["normal_sigma_deg"] = math.degrees(course.facing.sigma)
        return Intent(
            phase=order.phase,
            target=Target(order.depth, x, y),
            in_contact=stroke.in_contact,
            command=order.command,
            losses=stroke.losses,
            reason=course.reason,
            failed=course.failed,
            reference=order.reference,
            turned=course.turned,
            leg=course.leg,
            notes=notes,
        )


def _begin_path(course: Course, step: StepState, leg: Leg) -> tuple[Course, StepState]:
    """Return the state at the start of a leg's path, from the tool's commanded position."""
    heading = step.heading if leg.way is None else leg.way.headings[0]
    return (
        replace(course, origin=step.at, base=step.stroke.travel, reached=0.0),
        replace(step, local=0.0, heading=heading),
    )


def _step_answer(leg: Leg, context: StepContext, state: StepState) -> StepResult | None:
    """Return the response of the step to a sample; None if the step is over before the sample. Raises StepFailed
    for every exception of the step, and for an invalid response.
    """
    try:
        if leg.step.is_over(context, state):
            return None
        result = leg.step.take(context, state)
        if leg.foreign:
            check_result(context, leg, state, result)
        return result
    except ControllerFailed:
        raise
    except RAISED as error:
        raise_if_interrupt(error)
        raise StepFailed(leg) from error
