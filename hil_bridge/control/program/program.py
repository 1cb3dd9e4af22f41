"""A program as a pure state machine: one leg after the other, each by its step and its stroke.

A run without steps is the program of an approach, a straight way and a retraction. See
`docs/explanation/one-cycle.md` for one sample from the sensor to the order.
"""

import math
from dataclasses import dataclass
from typing import Any

from msgspec.structs import replace

from hil_bridge.control.course.facing import Facing, Look, elsewhere, inward
from hil_bridge.control.course.intent import Intent, Phase, Target
from hil_bridge.control.course.parameters import TaskParameters
from hil_bridge.control.course.stroke import Order, Stroke
from hil_bridge.control.course.yielding import go_back, yield_to
from hil_bridge.control.geometry.ways import Place
from hil_bridge.control.program.answer import check_taken
from hil_bridge.control.program.felt import Face, WorkFrame, find_across, measure_skew, subtract_zero
from hil_bridge.control.program.leg import Leg, Row, StepFailed
from hil_bridge.control.program.orienting import heading_of, turn_tool
from hil_bridge.control.program.outcome import cut, ending, outcome
from hil_bridge.control.program.state import Felt, ProgramState, Tally
from hil_bridge.control.sample import Sample
from hil_bridge.control.steps.seam import Taken
from hil_bridge.control.types import Controller, ControllerFailed, Measurement
from hil_bridge.errors.causes import Reason
from hil_bridge.errors.failures import RAISED, raise_if_asked
from protocol.geometry import Vector, normalise

_TRACK, _RETRACT, _END, _APPROACH = Phase.TRACK, Phase.RETRACT, Phase.END, Phase.APPROACH
_MOVE = Phase.MOVE

_SLIDES = 0.05
"""Chosen: share of the speed from which the tool counts as sliding along its path."""
POINT = Face()
"""A tool that touches in a point, where its contact moments are told about."""
FACING = Facing()
"""The estimate of the normal by default."""


@dataclass(frozen=True, slots=True)
class Program:
    """Takes samples through the legs of a row."""

    row: Row
    stroke: Stroke
    """The stroke with the run's own parameters."""
    frame: WorkFrame
    facing: Facing = FACING
    face: Face = POINT
    safe_height: float = 0.0
    """Height over the start point, or the frame's plane, at which the tool goes to other places, m."""

    @property
    def parameters(self) -> TaskParameters:
        """The run's own parameters."""
        return self.stroke.parameters

    @property
    def controller(self) -> Controller[Any]:
        return self.stroke.controller

    @property
    def turns(self) -> bool:
        """Whether any step turns the tool."""
        return any(leg.step.orientation != "fixed" for leg in self.row.legs)

    def initial(self) -> ProgramState:
        """State at the start point, away from the surface."""
        return ProgramState()

    def finish(self, state: ProgramState, reason: Reason) -> ProgramState:
        """Retract from the next sample on and end, for a reason from outside."""
        if state.reason or state.phase is _END:
            return state
        turn = state.stroke.turn if state.phase is _RETRACT else None
        return replace(state, stroke=replace(state.stroke, phase=_RETRACT, turn=turn), reason=reason)

    def fail(self, state: ProgramState, reason: Reason) -> ProgramState:
        """Retract from the next sample on and end, because something is wrong."""
        if state.reason or state.phase is _END:
            return state
        return replace(self.finish(state, self.where(state, reason)), failed=True)

    def where(self, state: ProgramState, reason: Reason) -> Reason:
        """Why a run stops, with the step in which it does, where a person has written it."""
        return reason if state.began is None else self.in_step(state.leg, reason)

    def in_step(self, number: int, reason: Reason) -> Reason:
        """A reason that came in this leg, with its step where a person has written it."""
        return reason.in_step(self.row.legs[number].label) if self.row.written else reason

    def completed(self, state: ProgramState) -> Reason | None:
        """Why a run that went as it was meant to has ended; None where its steps tell that."""
        return state.reason or (None if self.row.written else state.led)

    def hold(self, state: ProgramState, measurement: Measurement) -> Intent:
        """The answer that changes nothing."""
        phase = self.row.legs[state.leg].phase if state.began is None else state.phase
        return self._intent(state, Order(phase, measurement.commanded))

    # --- what is felt

    def sense(
        self, state: ProgramState, sample: Sample, start: Vector, ordered: float, dt: float
    ) -> tuple[ProgramState, Felt]:
        """The sample as the program sees it: in the work frame and from the program's own zero.

        The measurement tells the way along the path. Its force is that along the surface's normal where that is
        followed. `start` is the position that was reported at the start point, base frame, m. `ordered` is the depth
        that was ordered before, m, `dt` the time since then, s.
        """
        frame, wrench, paired, (h, k) = self.frame, sample.wrench, sample.paired_force, state.heading
        (x, y, z), (a, b, c) = sample.position, start
        x, y, z = x - a, y - b, z - c
        (a, b, c), (u, v, w), (r, s, t) = frame.approach, frame.x, frame.y
        depth, place = x * a + y * b + z * c, (x * u + y * v + z * w, x * r + y * s + z * t)
        if state.start is None:
            state = self._start(state, sample, place)
        across = sample.force_across
        force = sample.force, sample.force_travel, find_across(frame, sample) if across is None else across
        if state.zero:
            force, wrench = subtract_zero(state, frame, sample, force)
            paired = None if paired is None else paired + (force[0] - sample.force)
        leg, travel = self.row.legs[state.leg], place[0]
        if state.began is None and leg.way is not None and state.reason is None:
            state = self._on_the_way(state, leg)
            h, k = state.heading
        against = force[1] * h + force[2] * k
        if leg.way is not None:
            there = place[0] - state.origin[0], place[1] - state.origin[1]
            along = leg.way.along(state.reached, state.stroke.travel - state.base, there)
            reached, travel = 0.0 if along < 0.0 else along, state.base + along
            if reached != state.reached:
                state = replace(state, reached=reached)
        elif leg.phase is _MOVE:  # no path leads there
            against = 0.0
        measurement = Measurement(
            sample.sensor_at,
            force[0],
            depth,
            ordered,
            True,  # not looked at: the stroke judges contact
            paired,
            travel,
            0.0,
            None,
            0.0 if sample.held else 1.0,
            sample.saturated,
            dt,
            against,
            sample,
        )
        felt = Felt(sample, measurement, place, force, wrench)
        if not leg.follows or state.stroke.phase is not _TRACK:
            return state, felt
        return self._along_normal(state, leg, felt)

    def _start(self, state: ProgramState, sample: Sample, place: Place) -> ProgramState:
        """State at the first sample."""
        frame, position, quaternion = self.frame, sample.position, sample.orientation
        x, y = 0.0, 0.0
        if frame.origin is not None:
            x, y = (
                sum((p - o) * n for p, o, n in zip(position, frame.origin, axis, strict=True)) - moved
                for axis, moved in zip((frame.x, frame.y), place, strict=True)
            )
        plane = frame.plane or position
        deep = sum((p - q) * n for p, q, n in zip(plane, position, frame.approach, strict=True))
        home = None if quaternion is None else normalise(quaternion)
        return replace(state, start=(x, y), safe=min(deep - self.safe_height, 0.0), home=home)

    def _on_the_way(self, state: ProgramState, leg: Leg) -> ProgramState:
        """State at the begin of a leg's way, from where the tool was ordered to."""
        heading = state.heading if leg.way is None else leg.way.headings[0]
        return replace(
            state, origin=state.at, base=state.stroke.travel, local=0.0, reached=0.0, heading=heading
        )

    def _along_normal(self, state: ProgramState, leg: Leg, felt: Felt) -> tuple[ProgramState, Felt]:
        """The estimate after this sample, and the force along the normal."""
        heading, measurement = heading_of(leg, state), felt.measurement
        if state.in_contact:
            stiffness = state.stroke.stiffness or self.parameters.expected_stiffness_n_m
            per_angle = max(stiffness, 1.0) * self.face.radius**2 / 4.0
            slides = leg.way is not None and abs(state.feed) > _SLIDES
            indented = measurement.force_at_position / max(stiffness, 1.0) if leg.shows_ground else 0.0
            look = Look(
                measurement.dt,
                measurement.travel,
                measurement.position - indented,
                felt.force,
                heading if slides else (0.0, 0.0),
                *measure_skew(self.frame, self.face, felt, per_angle),
            )
            state = replace(state, facing=self.facing.after(state.facing, look, per_angle or 1.0))
        a, t, b = inward(state.facing.fall)
        force = measurement.force
        if not (math.isfinite(force) and force > self.parameters.loss_threshold_n):
            return state, felt
        pressed = felt.force[0] * a + felt.force[1] * t + felt.force[2] * b
        paired = measurement.paired_force
        p, q = state.facing.fall
        slope = p * heading[0] + q * heading[1]
        measurement = replace(
            measurement,
            force=pressed,
            paired_force=None if paired is None else paired * pressed / force,
            advance=measurement.advance / math.sqrt(1.0 + slope * slope),
        )
        return state, replace(felt, measurement=measurement)

    # --- one sample

    def step(self, state: ProgramState, felt: Felt) -> tuple[ProgramState, Intent]:
        """One sample, after `sense`. Steps that end without it are passed over."""
        measurement = felt.measurement
        finite = math.isfinite(measurement.force + measurement.position + measurement.against)
        if not (finite or state.reason):  # a retraction of ours needs neither
            leg = self.row.legs[state.leg]
            if leg.phase is not _RETRACT or leg.foreign:
                return state, self.hold(state, measurement)
        while state.reason is None and state.stroke.phase is not _END:
            if state.began is None:
                state = self._begin(state, felt)
            leg = self.row.legs[state.leg]
            taken = _ask(leg, state, felt)
            if taken is None:
                state = self._next(state, leg, felt)
                continue
            state = taken.state
            if taken.trouble is not None:  # whatever the step asked for: nothing goes deeper from here on
                depth = min(taken.order.depth, measurement.commanded)
                state = self.fail(state, taken.trouble)
                return state, self._intent(state, replace(taken.order, depth=depth))
            if leg.turns:
                state = turn_tool(state, leg, self.frame, self.facing, measurement.dt)
            intent = self._intent(state, taken.order)
            return (self._next(state, leg, felt) if taken.done else state), intent
        return self._leave(state, felt)

    def _leave(self, state: ProgramState, felt: Felt) -> tuple[ProgramState, Intent]:
        """Back out of the surface where the tool is; then the run ends."""
        if state.began is not None:
            done = cut(state, self.row.legs[state.leg], felt.sample.now, state.reason)
            state = replace(state, done=(*state.done, done), began=None)
        before, way = state.at, self.stroke.way(self.parameters.retract_speed_mm_s, felt.measurement.dt)
        works_aside, phase = self.row.legs[state.leg].works_aside, self.row.legs[state.leg].phase
        if state.failed and phase in (_MOVE, Phase.SEEK):
            state = go_back(state, felt, way)
        else:
            state = yield_to(state, felt, (way, self.stroke.friction_share), works_aside)
        stroke, order = self.stroke.step(state.stroke, felt.measurement)
        if state.at != before and stroke.phase is _END:  # not before the tool is off what pushed it
            stroke = replace(stroke, phase=_RETRACT)
        state = replace(state, stroke=stroke)
        intent = self._intent(state, order)
        aside = math.hypot(felt.force[1], felt.force[2])
        least = max(self.parameters.contact_threshold_n, -felt.force[0])  # not by what hangs above
        if works_aside and aside > least:
            intent = replace(intent, in_contact=True)
        return state, intent

    def _begin(self, state: ProgramState, felt: Felt) -> ProgramState:
        """State at the first sample of a leg."""
        leg, stroke = self.row.legs[state.leg], state.stroke
        seeks, phase, now = self._seeks(state), leg.phase, felt.sample.now
        presses = seeks or stroke.phase is _TRACK
        if phase is _TRACK:  # a touch that is sought or tested yet stays so, whatever step comes
            stroke = stroke if seeks else leg.stroke.tracking(stroke)
        else:  # a stroke begins elsewhere: what was learnt of places belongs to the one before
            memory = None if phase is _APPROACH else stroke.controller
            stroke = replace(stroke, phase=phase, turn=None, lost_at=None, controller=memory, touch=None)
        again = {"first_pass": None, "this_pass": (0.0, 0.0)} if leg.first_of_repeat else {}
        return replace(
            self._on_the_way(state, leg),
            stroke=stroke,
            began=now,
            aside=0.0,
            lean=0.0,
            stage=0,
            since=now,
            stuck=0.0,
            passed=0.0,
            yielded=0.0,
            feed=1.0,
            memory=None,
            found=((0.0, 0.0, 0.0), 0),
            readings=((), 0, -1),
            tally=Tally(),
            text="",
            ground=state.ground if presses else 0.0,
            facing=state.facing if presses else elsewhere(state.facing),
            **again,
        )

    def _seeks(self, state: ProgramState) -> bool:
        """Whether the step before has ended while its touch was sought or tested; that of an approach is found."""
        if state.stroke.phase is not _APPROACH or not state.done:
            return False
        before = self.row.legs[state.done[-1].leg]
        return before.step.controls or not before.stroke.is_proven(state.stroke)

    def _next(self, state: ProgramState, leg: Leg, felt: Felt) -> ProgramState:
        """State behind a leg: its outcome, and where the row goes on."""
        done = outcome(state, leg, felt.sample.now, felt.sample.position)
        number, first, this = state.leg + 1, state.first_pass, state.this_pass
        if leg.way is not None:
            this = this[0] + state.tally.deep, this[1] + state.tally.total
        if leg.leave_to is not None:
            (deep, way), this = this, (0.0, 0.0)
            mean = deep / way if way else None
            first = mean if first is None else first
            removed = 0.0 if mean is None or first is None else mean - first
            if leg.removed is not None and mean is not None and removed >= leg.removed:
                number = leg.leave_to
                done = replace(done, text=f"{removed * 1e3:.3f} mm removed")
        over = number >= len(self.row.legs)
        return replace(
            state,
            stroke=replace(state.stroke, phase=_END) if over else state.stroke,
            leg=min(number, len(self.row.legs) - 1),
            began=None,
            first_pass=first,
            this_pass=this,
            led=ending(state, leg) or state.led,
            done=(*state.done, done),
        )

    def _intent(self, state: ProgramState, order: Order) -> Intent:
        """The order of a step with the place and orientation of the program."""
        (x, y), notes = state.at, {}
        if state.feed != 1.0:
            notes["feed"] = state.feed
        if math.isfinite(state.facing.sigma):
            p, q = state.facing.fall
            notes["normal_x_deg"], notes["normal_y_deg"] = (
                math.degrees(math.atan(slope)) for slope in (p, q)
            )
            notes["normal_sigma_deg"] = math.degrees(state.facing.sigma)
        return Intent(
            order.phase,
            Target(order.depth, x, y),
            state.stroke.in_contact,
            order.command,
            state.stroke.losses,
            state.reason,
            state.failed,
            order.reference,
            state.turned,
            state.leg,
            notes,
        )


def _ask(leg: Leg, state: ProgramState, felt: Felt) -> Taken | None:
    """The sample as the step takes it; None for a step that is over before it. Raises StepFailed for all that the step
    raises, and for an answer that is none.
    """
    try:
        if leg.step.is_over(leg, state, felt):
            return None
        taken = leg.step.take(leg, state, felt)
        if leg.foreign:
            check_taken(leg, state, taken, felt.measurement.commanded)
        return taken
    except ControllerFailed:
        raise
    except RAISED as error:
        raise_if_asked(error)
        raise StepFailed(leg) from error
