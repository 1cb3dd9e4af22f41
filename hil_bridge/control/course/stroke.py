"""A stroke as a pure state machine: approach, track the surface, retract. One touch, until the tool has lifted.

The controller is stepped in TRACK only. Its state lives on through a contact loss and a new approach, so that the
learnt stiffness is kept. `in_contact` tells it of the loss.
"""

import math
from dataclasses import dataclass
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from hil_bridge.control.course.escape import escape_way
from hil_bridge.control.course.intent import Phase
from hil_bridge.control.course.parameters import TaskParameters
from hil_bridge.control.course.touch import Doubt, Touch, TouchTest, begin_tracking, keep_tracking
from hil_bridge.control.types import Command, Controller, Measurement, ask, begin
from hil_bridge.errors.causes import Cause, Reason

# Asked for in every cycle, by names of this module: until Python 3.12 an enum's own name costs ten times that.
_APPROACH, _TRACK, _RETRACT, _END = Phase.APPROACH, Phase.TRACK, Phase.RETRACT, Phase.END


class Stride(Struct, frozen=True, gc=False):
    """How a step leads one sample of tracking."""

    reference: float
    """Desired force, N."""
    feed: float = 1.0
    """Share of the speed along the surface; negative goes back."""


class Order(Struct, frozen=True, gc=False):
    """The answer of a stroke, or of a step, for one sample."""

    phase: Phase
    """Phase that this sample belonged to."""
    depth: float
    """Where the tool is wanted along the approach direction, m."""
    command: Command | None = None
    """Answer of the controller; None outside TRACK."""
    reference: float | None = None
    """Desired force, N; None for that of the task."""


class StrokeState(Struct, frozen=True):
    """Where a stroke is."""

    phase: Phase = _APPROACH
    """Phase of the run. A stroke takes samples in APPROACH, TRACK and RETRACT; END tells that it has lifted."""
    travel: float = 0.0
    """Length of the way commanded so far, m."""
    speed_mm_s: float = 0.0
    """Speed to which the travel has risen since the touch, mm/s; 0 without contact, and where it stands or goes
    back.
    """
    turn: float | None = None
    """Depth at which the present approach or retraction began, m; None before its first sample."""
    in_contact: bool = False
    settled: bool = False
    """The force has been high enough for the tool to travel, or the controller rests in its dead band, since contact
    was found.
    """
    free: float | None = None
    """Reported position of the newest sample without contact, m."""
    lost_at: float | None = None
    """Depth commanded when contact was lost, m; None before the first loss and when it has been found
    again.
    """
    lost_for: float | None = None
    """Time of the samples in a row without contact, s; None after one with contact."""
    losses: int = 0
    """Contact losses so far."""
    controller: Any = None
    """The controller's own state; None before the first contact."""
    trouble: Reason | None = None
    """Why the stroke has been given up, and retracts; None while it continues."""
    stiffness: float | None = None
    """The controller's last estimate of the contact stiffness, N/m."""
    doubt: Doubt = Doubt.NONE
    """Why a touch must be proven, by the newest sample."""
    touch: Touch | None = None
    """The touch that is being proven, or was; None if there is none."""


@dataclass(frozen=True, slots=True)
class Stroke:
    """Steps a controller from the approach to the lifted tool."""

    parameters: TaskParameters
    controller: Controller[Any]
    force_limit_n: float = math.inf
    """Contact force at which the supervisor stops the run."""
    position_step: float | None = None
    """Step of the robot's position, m, in whole ones of which the tool moves; None for a robot that has none."""
    escape_mm_s: float = 0.0
    """Speed at which it goes back from a force beyond the limit, mm/s."""
    friction_share: float = 0.0
    """Share of the contact force that may come up against the way by friction."""

    def way(self, speed_mm_s: float, dt: float) -> float:
        """Way of one sample at this speed, m.

        A robot that moves in whole position steps is given whole ones, so that every sample of a steady cycle asks for
        the same. What rounds to none is not rounded: it adds up in the command, and the speed stays.
        """
        way = speed_mm_s * 1e-3 * dt
        if self.position_step is None:
            return way
        return round(way / self.position_step) * self.position_step or way

    def step(
        self, state: StrokeState, measurement: Measurement, stride: Stride | None = None
    ) -> tuple[StrokeState, Order]:
        """One sample. `measurement.in_contact` is not looked at: contact is judged here, from the force. Without a
        stride the force is that of the parameters.

        A measurement that is not finite changes nothing and asks for the depth commanded before. A retraction continues
        regardless, for it needs neither force nor position.
        """
        phase = state.phase
        finite = math.isfinite(measurement.force + measurement.position)
        if not finite and phase is not _RETRACT:
            return state, Order(phase, measurement.commanded)
        parameters = self.parameters
        threshold = parameters.loss_threshold_n if state.in_contact else parameters.contact_threshold_n
        touching = measurement.force > threshold
        free = state.free if touching else measurement.position
        if touching != state.in_contact or free != state.free:
            state = replace(state, in_contact=touching, free=free)
        if phase is _TRACK:
            return self._track(state, measurement, stride or Stride(parameters.force_n))
        if phase is _APPROACH:
            return self._approach(state, measurement)
        if phase is _RETRACT:
            return self._retract(state, measurement)
        return state, Order(phase, measurement.commanded)

    def is_proven(self, state: StrokeState) -> bool:
        """Whether a contact may be taken for one."""
        return state.doubt is Doubt.NONE if state.touch is None else state.touch.proven

    def tracking(self, state: StrokeState) -> StrokeState:
        """State at the first sample of tracking. The first moments of a touch that needed no proof are watched."""
        memory = begin(self.controller) if state.controller is None else state.controller
        touch, risen = state.touch, state.speed_mm_s if state.phase is _TRACK else 0.0
        if state.phase is _APPROACH:
            touch = begin_tracking() if touch is None else None
        return replace(
            state,
            phase=_TRACK,
            speed_mm_s=risen,
            turn=None,
            lost_for=None,
            settled=False,
            controller=memory,
            touch=touch,
        )

    def careful_step(self, ahead: float, dt: float, share: float = 1.0) -> float:
        """Way into a place where the tool has not been, m, so short that a touch ends within the force allowed.

        Derived: there is no contact at the reported position. So however late a touch shows, it ends no deeper below
        the surface than the command is `ahead` of that position. What is already under way is the delay as it is
        measured; half of what is allowed at once keeps the steps even. A position that is not a number is no lead:
        a retraction continues without it. `share` is the part of that force which a touch may make.
        """
        parameters = self.parameters
        allowed = share * min(parameters.force_n, self.force_limit_n / 2) / parameters.expected_stiffness_n_m
        lead = max(ahead, 0.0) if math.isfinite(ahead) else 0.0
        way = self.way(parameters.approach_speed_mm_s, dt)
        return max(min(way, allowed / 2, allowed - lead), _SLOWEST * dt)

    # --- approach

    def _approach(self, state: StrokeState, measurement: Measurement) -> tuple[StrokeState, Order]:
        if state.in_contact and not self.is_proven(state):
            return self._prove(state, measurement)
        if state.in_contact:
            return self._track(self.tracking(state), measurement, Stride(self.parameters.force_n))
        if state.touch is not None:
            state = replace(state, touch=None)
        turn = measurement.commanded if state.turn is None else state.turn
        ahead = measurement.commanded - measurement.position
        share = _CLOSING if self.position_step is None else 1.0
        depth = measurement.commanded + self.careful_step(ahead, measurement.dt, share)
        limit_mm, setting = (
            self.parameters.approach_depth_limit_mm,
            "task.approach_depth_limit_mm (at_most_mm of a step)",
        )
        if state.doubt is Doubt.AXIS and limit_mm > self.parameters.unverified_depth_mm:
            limit_mm, setting = (
                self.parameters.unverified_depth_mm,
                "task.unverified_depth_mm, for an axis is not verified",
            )
        if depth - turn > limit_mm * 1e-3 + _ROUNDING:
            text = (
                f"no contact found within {limit_mm:g} mm: start nearer, set {setting}, or see whether frame.approach "
                "points to the surface"
            )
            return self._give_up(state, measurement, Reason(Cause.NO_CONTACT, text))
        state = replace(state, turn=turn)
        if self._beyond_edge(state, depth):
            return self._give_up(state, measurement, self._edge)
        return state, Order(_APPROACH, depth)

    def _prove(self, state: StrokeState, measurement: Measurement) -> tuple[StrokeState, Order]:
        """One sample of a touch in doubt: stand, and go deeper by a small step once the last one is answered."""
        parameters = self.parameters
        test = TouchTest(parameters.zero_change_n, parameters.least_stiffness, self.position_step or 0.0)
        touch, way, reason = test.after(state.touch or Touch(state.doubt), measurement)
        state = replace(state, touch=touch)
        if reason is not None:
            return self._give_up(state, measurement, reason)
        ahead = measurement.commanded - measurement.position
        way = (
            min(way, max(self.careful_step(ahead, measurement.dt), self.position_step or 0.0)) if way else 0.0
        )
        return state, Order(_APPROACH, measurement.commanded + way)

    def _beyond_edge(self, state: StrokeState, depth: float) -> bool:
        limit = self.parameters.search_depth_limit_mm * 1e-3
        return state.lost_at is not None and depth - state.lost_at > limit + _ROUNDING

    @property
    def _edge(self) -> Reason:
        text = f"the surface ended: no contact within {self.parameters.search_depth_limit_mm:g} mm"
        return Reason(Cause.SURFACE_ENDED, text)

    # --- track

    def _track(
        self, state: StrokeState, measurement: Measurement, stride: Stride
    ) -> tuple[StrokeState, Order]:
        touch = state.touch
        if touch is not None and state.in_contact:
            touch, doubtful = keep_tracking(touch, state.doubt, measurement)
            if doubtful:
                return self._prove(replace(state, phase=_APPROACH, turn=None, touch=touch), measurement)
        parameters, reference = self.parameters, stride.reference
        settled = state.settled or measurement.force >= parameters.travel_from_share * reference
        travel, risen = state.travel, 0.0
        if state.in_contact and settled:
            speed, rise = parameters.speed_mm_s, parameters.travel_rise_s
            if rise:
                speed = min(state.speed_mm_s + speed * measurement.dt / rise, speed)
            travel += self.way(speed, measurement.dt) * measurement.advance * stride.feed
            risen = speed if measurement.advance * stride.feed > 0.0 else 0.0
        shown = replace(
            measurement, in_contact=state.in_contact, travel_next=travel, free_position=state.free
        )
        memory, command = ask(self.controller, state.controller, shown, reference)
        order = Order(_TRACK, command.position, command, reference)
        stiffness = command.stiffness or state.stiffness
        if state.in_contact:  # found again, if it was lost
            return replace(
                state,
                travel=travel,
                speed_mm_s=risen,
                settled=settled or command.held,
                lost_at=None,
                lost_for=None,
                controller=memory,
                stiffness=stiffness,
                touch=touch,
            ), order
        first = state.lost_for is None
        lost_for = (state.lost_for or 0.0) + measurement.dt
        lost_at = measurement.commanded if first and state.lost_at is None else state.lost_at
        state = replace(
            state,
            speed_mm_s=0.0,
            settled=settled,
            controller=memory,
            stiffness=stiffness,
            lost_for=lost_for,
            losses=state.losses + first,
            lost_at=lost_at,
        )
        if self._beyond_edge(state, command.position):
            return self._give_up(state, measurement, self._edge)
        if state.losses >= parameters.loss_limit:
            reason = Reason(Cause.CONTACT_LOST, f"contact lost {state.losses} times")
            return self._give_up(state, measurement, reason)
        if lost_for * 1e3 >= parameters.loss_ms:
            state = replace(state, phase=_APPROACH, turn=None)
        return state, order

    # --- retract

    def _give_up(
        self, state: StrokeState, measurement: Measurement, reason: Reason
    ) -> tuple[StrokeState, Order]:
        """Retract from this sample on."""
        return self._retract(replace(state, phase=_RETRACT, turn=None, trouble=reason), measurement)

    def _retract(self, state: StrokeState, measurement: Measurement) -> tuple[StrokeState, Order]:
        """Back by what is asked for, and at least to the depth of the start. Up to there the tool has been before;
        beyond it something may be in the way, and the steps are those of an approach.
        """
        parameters, commanded = self.parameters, measurement.commanded
        turn = commanded if state.turn is None else state.turn
        goal = min(turn - parameters.retract_mm * 1e-3, 0.0)
        step = self.way(parameters.retract_speed_mm_s, measurement.dt)
        stiffness = parameters.expected_stiffness_n_m  # not the one learnt: a harder one goes back less
        escape = escape_way(measurement, self.force_limit_n, stiffness, self.escape_mm_s)
        if commanded > _ROUNDING:
            depth = max(commanded - max(step, escape), 0.0)
        else:
            careful = min(step, self.careful_step(measurement.position - commanded, measurement.dt))
            depth = max(commanded - max(careful, escape), min(goal, commanded))  # it may be beyond the goal
        # A command that the supervisor held back at the workspace's border does not count as arrived.
        phase = _END if commanded <= goal + _ROUNDING else state.phase
        return replace(state, phase=phase, turn=turn), Order(_RETRACT, depth)


_ROUNDING = 1e-9
"""Slack for sums of steps, m."""

_CLOSING = 0.6
"""Share of the force allowed for the approach of a robot that moves in no whole steps. Chosen: the rest is for its way
until the touch has shown.
"""

_SLOWEST = 0.2e-3
"""Speed of the approach whatever the stiffness, m/s. Chosen: 0.036 mm in a cycle of 180 ms, less than a step of the
robot's position.
"""
