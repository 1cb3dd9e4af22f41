"""Pure state machine of a stroke: approach, track the surface, retract. It covers one touch until the tool is
lifted.

The controller is stepped in TRACK only. Its state is kept through a contact loss and a new approach, so that the
learnt stiffness is preserved. `in_contact` informs it of the loss.
"""

import math
from dataclasses import dataclass
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from hil_bridge.control.course.escape import escape_distance
from hil_bridge.control.course.intent import Phase
from hil_bridge.control.course.parameters import TaskParameters
from hil_bridge.control.course.touch import Doubt, Touch, TouchTest, begin_tracking, keep_tracking
from hil_bridge.control.types import Command, Controller, Measurement, ask, begin
from hil_bridge.errors.causes import Cause, Reason

# Used in every cycle: before Python 3.12, access through the enum takes ten times as long.
_APPROACH, _TRACK, _RETRACT, _END = Phase.APPROACH, Phase.TRACK, Phase.RETRACT, Phase.END


class Stride(Struct, frozen=True, gc=False):
    """Parameters of a step for one sample of tracking."""

    reference: float
    """Desired force, N."""
    feed: float = 1.0
    """Feed along the surface, as a share of the speed; negative for backward motion."""


class Order(Struct, frozen=True, gc=False):
    """Response of a stroke or a step to one sample."""

    phase: Phase
    """Phase to which this sample belongs."""
    depth: float
    """Target depth along the approach direction, m."""
    command: Command | None = None
    """Response of the controller; None outside TRACK."""
    reference: float | None = None
    """Desired force, N; None if the force of the task applies."""


class StrokeState(Struct, frozen=True):
    """State of a stroke."""

    phase: Phase = _APPROACH
    """Phase of the run. A stroke uses APPROACH, TRACK and RETRACT; END means that the tool is lifted."""
    travel: float = 0.0
    """Path length commanded so far, m."""
    speed_mm_s: float = 0.0
    """Travel speed reached since the touch, mm/s; 0 while there is no contact, and while the travel pauses or moves
    backwards.
    """
    turn: float | None = None
    """Depth at which the current approach or retraction began, m; None before its first sample."""
    in_contact: bool = False
    settled: bool = False
    """Whether the tool may travel: since the first contact, the force has been high enough, or the controller has
    been in its dead band.
    """
    free: float | None = None
    """Reported position in the newest sample without contact, m."""
    lost_at: float | None = None
    """Depth commanded when contact was lost, m; None before the first loss and after contact is regained."""
    lost_for: float | None = None
    """Time of consecutive samples without contact, s; None after a sample with contact."""
    losses: int = 0
    """Number of contact losses so far."""
    controller: Any = None
    """Internal state of the controller; None before the first contact."""
    trouble: Reason | None = None
    """Reason why the stroke has been given up and the tool retracts; None while it continues."""
    stiffness: float | None = None
    """Latest estimate of the contact stiffness by the controller, N/m."""
    doubt: Doubt = Doubt.NONE
    """Reason why a touch in the newest sample must be confirmed."""
    touch: Touch | None = None
    """Touch that is being confirmed or has been confirmed; None for a touch without doubt, and without a touch."""


@dataclass(frozen=True, slots=True)
class Stroke:
    """Controller of the tool from the approach until the tool is lifted."""

    parameters: TaskParameters
    controller: Controller[Any]
    force_limit_n: float = math.inf
    """Contact force at which the supervisor stops the run, N."""
    position_step: float | None = None
    """Resolution of the robot's position, m, of which every motion is a multiple; None for a robot without position
    steps.
    """
    escape_mm_s: float = 0.0
    """Speed of the retraction from a force beyond the limit, mm/s."""
    friction_share: float = 0.0
    """Share of the contact force that friction may cause against the motion."""

    def way(self, speed_mm_s: float, dt: float) -> float:
        """Return the distance covered in one sample at the given speed, m.

        For a robot that moves in discrete position steps, the distance is a multiple of the step, so that every
        sample of a steady cycle orders the same distance. A distance that would be rounded to 0 is not rounded: it
        accumulates in the command, and the speed is kept.
        """
        way = speed_mm_s * 1e-3 * dt
        if self.position_step is None:
            return way
        return round(way / self.position_step) * self.position_step or way

    def step(
        self, state: StrokeState, measurement: Measurement, stride: Stride | None = None
    ) -> tuple[StrokeState, Order]:
        """Return the state and the order after one sample. `measurement.in_contact` is ignored: contact is derived
        from the force.

        Without a stride, the desired force of the parameters applies. A measurement that is not finite changes
        nothing and repeats the last commanded depth. A retraction continues even then, because it needs neither
        force nor position.
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
        """Return whether a contact is confirmed, now or before the tool began to track."""
        if state.touch is not None:
            return state.touch.proven
        return state.doubt is Doubt.NONE or state.phase is _TRACK

    def tracking(self, state: StrokeState) -> StrokeState:
        """Return the state at the first sample of tracking. The first samples of a touch that needed no
        confirmation are checked.
        """
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
        """Return the distance to move into unexplored space, m, short enough that a touch stays within the allowed
        force.

        Derived: there is no contact at the reported position. So however late a touch is reported, it ends no
        deeper below the surface than the command is `ahead` of that position. Motion that is ordered but not yet
        reported represents the measured delay. Each move is at most half of the allowed distance, which keeps the
        steps even. If the position is not a number, the delay counts as 0, so that a retraction continues. `share`
        is the part of the allowed force that a touch may cause.
        """
        parameters = self.parameters
        allowed = share * min(parameters.force_n, self.force_limit_n / 2) / parameters.expected_stiffness_n_m
        lead = max(ahead, 0.0) if math.isfinite(ahead) else 0.0
        distance = self.way(parameters.approach_speed_mm_s, dt)
        return max(min(distance, allowed / 2, allowed - lead), _SLOWEST * dt)

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
                "task.unverified_depth_mm, because an axis is not verified",
            )
        if depth - turn > limit_mm * 1e-3 + _ROUNDING:
            text = (
                f"no contact found within {limit_mm:g} mm: start nearer, set {setting}, or check that "
                "frame.approach points to the surface"
            )
            return self._give_up(state, measurement, Reason(Cause.NO_CONTACT, text))
        state = replace(state, turn=turn)
        if self._beyond_edge(state, depth):
            return self._give_up(state, measurement, self._edge)
        return state, Order(_APPROACH, depth)

    def _prove(self, state: StrokeState, measurement: Measurement) -> tuple[StrokeState, Order]:
        """Process one sample of a doubtful touch: pause, and move deeper by a small step once the force has
        responded to the last step.
        """
        parameters = self.parameters
        test = TouchTest(parameters.zero_change_n, parameters.least_stiffness, self.position_step or 0.0)
        touch, step, reason = test.after(state.touch or Touch(state.doubt), measurement)
        state = replace(state, touch=touch)
        if reason is not None:
            return self._give_up(state, measurement, reason)
        ahead = measurement.commanded - measurement.position
        step = (
            min(step, max(self.careful_step(ahead, measurement.dt), self.position_step or 0.0))
            if step
            else 0.0
        )
        return state, Order(_APPROACH, measurement.commanded + step)

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
        has_settled = state.settled or measurement.force >= parameters.travel_from_share * reference
        travel, risen = state.travel, 0.0
        if state.in_contact and has_settled:
            speed, rise = parameters.speed_mm_s, parameters.travel_rise_s
            if rise:
                speed = min(state.speed_mm_s + speed * measurement.dt / rise, speed)
            travel += self.way(speed, measurement.dt) * measurement.advance * stride.feed
            risen = speed if measurement.advance * stride.feed > 0.0 else 0.0
        adjusted = replace(
            measurement, in_contact=state.in_contact, travel_next=travel, free_position=state.free
        )
        memory, command = ask(self.controller, state.controller, adjusted, reference)
        order = Order(_TRACK, command.position, command, reference)
        stiffness = command.stiffness or state.stiffness
        if state.in_contact:  # regained, if it was lost
            return replace(
                state,
                travel=travel,
                speed_mm_s=risen,
                settled=has_settled or command.held,
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
            settled=has_settled,
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
        """Begin to retract in this sample."""
        return self._retract(replace(state, phase=_RETRACT, turn=None, trouble=reason), measurement)

    def _retract(self, state: StrokeState, measurement: Measurement) -> tuple[StrokeState, Order]:
        """Move back by the configured distance, and at least to the depth of the start. The tool has already been
        in the space up to there. Beyond it there may be an obstacle, so the steps are the steps of an approach.
        """
        parameters, commanded = self.parameters, measurement.commanded
        turn = commanded if state.turn is None else state.turn
        goal = min(turn - parameters.retract_mm * 1e-3, 0.0)
        step = self.way(parameters.retract_speed_mm_s, measurement.dt)
        stiffness = (
            parameters.expected_stiffness_n_m
        )  # not the learnt one: a stiffer surface needs less distance
        escape = escape_distance(measurement, self.force_limit_n, stiffness, self.escape_mm_s)
        if commanded > _ROUNDING:
            depth = max(commanded - max(step, escape), 0.0)
        else:
            careful = min(step, self.careful_step(measurement.position - commanded, measurement.dt))
            depth = max(commanded - max(careful, escape), min(goal, commanded))  # it may be beyond the goal
        # A command that the supervisor held at the workspace border has not arrived.
        phase = _END if commanded <= goal + _ROUNDING else state.phase
        return replace(state, phase=phase, turn=turn), Order(_RETRACT, depth)


_ROUNDING = 1e-9
"""Tolerance for the rounding error of summed steps, m."""

_CLOSING = 0.6
"""Share of the allowed force that the approach of a robot without position steps may use. Chosen: the rest is
reserved for its motion until the touch is reported.
"""

_SLOWEST = 0.2e-3
"""Smallest speed of the approach, regardless of the stiffness, m/s. Chosen: 0.036 mm in a cycle of 180 ms, less
than a step of the robot's position.
"""
