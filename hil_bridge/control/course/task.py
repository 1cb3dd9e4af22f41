"""The course of a run as a pure state machine: approach, track the surface, retract, end.

The controller is stepped in TRACK only. Its state lives on through a contact loss and a new approach, so that the
learnt stiffness is kept. `in_contact` tells it of the loss.
"""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple

from msgspec import Struct
from msgspec.structs import replace

from hil_bridge.control.course.escape import escape_way
from hil_bridge.control.course.parameters import TaskParameters
from hil_bridge.control.course.touch import Doubt, Touch, TouchTest, begin_tracking, keep_tracking
from hil_bridge.control.course.wall import way_back
from hil_bridge.control.types import Command, Controller, Measurement, as_answer
from hil_bridge.errors.causes import Cause, Reason
from protocol.geometry import Quaternion


class Phase(StrEnum):
    """Phases of a run, by the names that the record uses."""

    APPROACH = "approach"
    """Step into the surface until the force says contact."""
    TRACK = "track"
    """The controller holds the force while the tool travels along the surface."""
    RETRACT = "retract"
    """Step back out of the surface."""
    MOVE = "move"
    """To another place through free space."""
    SEEK = "seek"
    """Along the surface until something pushes back."""
    ZERO = "zero"
    """Stand still in free space, and take the reading for zero."""
    END = "end"
    """Nothing more to command."""


CONNECT, TARE = "connect", "tare"
BEFORE_TOUCH = CONNECT, TARE
"""Phases of a run before there is anything to decide: devices become ready, and the zero is taken."""

# Asked for in every cycle, by names of this module: until Python 3.12 an enum's own name costs ten times that.
_APPROACH, _TRACK, _RETRACT = Phase.APPROACH, Phase.TRACK, Phase.RETRACT


class Target(Struct, frozen=True):
    """Where the tool is wanted, from the start point."""

    depth: float
    """Along the approach direction, m."""
    travel: float
    """Along the travel direction, m."""
    across: float = 0.0
    """Along the third direction of the work frame, m."""


class Stride(NamedTuple):
    """How a program changes one sample of tracking."""

    reference: float | None = None
    """Desired force, N; None for that of the task."""
    feed: float = 1.0
    """Share of the speed along the surface; negative goes back."""


PLAIN = Stride()
"""A sample that no program changes."""


class TaskState(Struct, frozen=True):
    """Where the run is."""

    phase: Phase = Phase.APPROACH
    travel: float = 0.0
    """Travel commanded so far, m."""
    turn: float | None = None
    """Depth at which the present approach or retraction began, m; None before its first sample."""
    in_contact: bool = False
    settled: bool = False
    """The force has been high enough for the tool to travel, since contact was found."""
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
    reason: Reason | None = None
    """Why the run retracts or has ended; None while it goes on."""
    failed: bool = False
    """The reason is a failure, not the end of the work."""
    stiffness: float | None = None
    """The controller's last estimate of the contact stiffness, N/m; kept for a program."""
    course: Any = None
    """State of the program; None for a task without one."""
    doubt: Doubt = Doubt.NONE
    """Why a touch must be proven, by the newest sample."""
    touch: Touch | None = None
    """The touch that is being proven, or was; None where there is none."""
    yielded: float = 0.0
    """Way that the tool has gone back along the travel while it retracts, m."""
    across: float = 0.0
    """Way that the controller has commanded along the third direction of the work frame, m."""


class TaskOutput(Struct, frozen=True):
    """The task's answer for one sample."""

    phase: Phase
    """Phase that this sample belonged to."""
    target: Target
    in_contact: bool
    command: Command | None = None
    """Answer of the controller; None outside TRACK."""
    losses: int = 0
    """Contact losses so far."""
    reason: Reason | None = None
    """Why the run retracts or has ended; None while it goes on."""
    failed: bool = False
    """The reason is a failure, not the end of the work."""
    reference: float | None = None
    """Desired force of this sample, N; None for that of the task."""
    turned: Quaternion | None = None
    """Orientation wanted, base frame; None for that of the start."""
    leg: int = 0
    """Place of the program's step in its list, from 0; 0 without a program."""
    notes: dict[str, float] = {}
    """Further numbers of the program for the record, by name."""


@dataclass(frozen=True, slots=True)
class Task:
    """Steps a controller through the phases of a run."""

    parameters: TaskParameters
    controller: Controller[Any]
    force_limit_n: float = math.inf
    """Contact force at which the supervisor stops the run."""
    position_step: float | None = None
    """Step of the robot's position, m, in whole ones of which the tool moves; None for a robot that has none."""
    escape_mm_s: float = 0.0
    """Speed at which it goes back from a force beyond the limit, mm/s."""
    friction_share: float = 0.0
    """Share of the contact force that may come up against the travel by friction."""

    def initial(self) -> TaskState:
        """State at the start point, away from the surface."""
        return TaskState()

    def finish(self, state: TaskState, reason: Reason) -> TaskState:
        """Retract from the next sample on, for a reason from outside: time is up, a person wants it."""
        if state.phase in (Phase.RETRACT, Phase.END):
            return state
        return replace(state, phase=Phase.RETRACT, turn=None, reason=reason)

    def fail(self, state: TaskState, reason: Reason) -> TaskState:
        """Retract from the next sample on, because something is wrong."""
        if state.phase in (Phase.RETRACT, Phase.END):
            return state
        return replace(self.finish(state, reason), failed=True)

    def way(self, speed_mm_s: float, dt: float) -> float:
        """Way of one sample at this speed, m.

        A robot that moves in whole position steps is given whole ones, so that every sample of a steady cycle asks for
        the same. What rounds to none is not rounded: it adds up in the command, and the speed stays.
        """
        way = speed_mm_s * 1e-3 * dt
        if self.position_step is None:
            return way
        return round(way / self.position_step) * self.position_step or way

    def hold(self, state: TaskState, measurement: Measurement) -> TaskOutput:
        """The answer that changes nothing."""
        return _output(state, measurement.commanded, state.phase)

    def step(
        self, state: TaskState, measurement: Measurement, stride: Stride = PLAIN
    ) -> tuple[TaskState, TaskOutput]:
        """One sample. `measurement.in_contact` is not looked at: contact is judged here, from the force.

        A measurement that is not finite changes nothing and asks for the depth commanded before. A retraction goes on
        regardless, for it needs neither force nor position.
        """
        finite = math.isfinite(measurement.force) and math.isfinite(measurement.position)
        if not finite and state.phase in (Phase.APPROACH, Phase.TRACK):
            return state, _output(state, measurement.commanded, state.phase)
        parameters = self.parameters
        threshold = parameters.loss_threshold_n if state.in_contact else parameters.contact_threshold_n
        touching = measurement.force > threshold
        free = state.free if touching else measurement.position
        if touching != state.in_contact or free != state.free:
            state = replace(state, in_contact=touching, free=free)
        phase = state.phase
        if phase is _TRACK:
            return self._track(state, measurement, stride)
        if phase is _APPROACH:
            return self._approach(state, measurement)
        if phase is _RETRACT:
            return self._retract(state, measurement)
        return state, _output(state, measurement.commanded, phase)

    def _approach(self, state: TaskState, measurement: Measurement) -> tuple[TaskState, TaskOutput]:
        if state.in_contact and not self.is_proven(state):
            return self._prove(state, measurement)
        if state.in_contact:
            memory = self.controller.initial() if state.controller is None else state.controller
            state = replace(
                state,
                phase=Phase.TRACK,
                turn=None,
                lost_for=None,
                settled=False,
                controller=memory,
                touch=begin_tracking() if state.touch is None else None,
            )
            return self._track(state, measurement)
        if state.touch is not None:
            state = replace(state, touch=None)
        turn = measurement.commanded if state.turn is None else state.turn
        ahead = measurement.commanded - measurement.position
        depth = measurement.commanded + self.careful_step(ahead, measurement.dt)
        limit_mm = self.parameters.approach_depth_limit_mm
        if depth - turn > limit_mm * 1e-3 + _ROUNDING:
            text = (
                f"no contact found within {limit_mm:g} mm: start nearer, or set task.approach_depth_limit_mm "
                "(at_most_mm of a step)"
            )
            return self._retract(self.fail(state, Reason(Cause.NO_CONTACT, text)), measurement)
        state = replace(state, turn=turn)
        if self._beyond_edge(state, depth):
            return self._retract(self.fail(state, self._edge), measurement)
        return state, _output(state, depth, Phase.APPROACH)

    def is_proven(self, state: TaskState) -> bool:
        """Whether a contact may be taken for one."""
        return state.doubt is Doubt.NONE if state.touch is None else state.touch.proven

    def _prove(self, state: TaskState, measurement: Measurement) -> tuple[TaskState, TaskOutput]:
        """One sample of a touch in doubt: stand, and go deeper by a small step once the last one is answered."""
        parameters = self.parameters
        test = TouchTest(parameters.zero_change_n, parameters.least_stiffness, self.position_step or 0.0)
        touch, way, reason = test.after(state.touch or Touch(state.doubt), measurement)
        state = replace(state, touch=touch)
        if reason is not None:
            return self._retract(self.fail(state, reason), measurement)
        ahead = measurement.commanded - measurement.position
        way = (
            min(way, max(self.careful_step(ahead, measurement.dt), self.position_step or 0.0)) if way else 0.0
        )
        return state, _output(state, measurement.commanded + way, Phase.APPROACH)

    def careful_step(self, ahead: float, dt: float) -> float:
        """Way into a place where the tool has not been, m, so short that a touch ends within the force allowed.

        Derived: there is no contact at the reported position. So however late a touch shows, it ends no deeper below
        the surface than the command is `ahead` of that position. What is already under way is the delay as it is
        measured; half of what is allowed at once keeps the steps even. A position that is no number counts as no lead:
        a retraction goes on without it.
        """
        parameters = self.parameters
        allowed = min(parameters.force_n, self.force_limit_n / 2) / parameters.expected_stiffness_n_m
        lead = max(ahead, 0.0) if math.isfinite(ahead) else 0.0
        way = self.way(parameters.approach_speed_mm_s, dt)
        return max(min(way, allowed / 2, allowed - lead), _SLOWEST * dt)

    def _beyond_edge(self, state: TaskState, depth: float) -> bool:
        limit = self.parameters.search_depth_limit_mm * 1e-3
        return state.lost_at is not None and depth - state.lost_at > limit + _ROUNDING

    @property
    def _edge(self) -> Reason:
        text = f"the surface ended: no contact within {self.parameters.search_depth_limit_mm:g} mm"
        return Reason(Cause.SURFACE_ENDED, text)

    def _track(
        self, state: TaskState, measurement: Measurement, stride: Stride = PLAIN
    ) -> tuple[TaskState, TaskOutput]:
        touch = state.touch
        if touch is not None and state.in_contact:
            touch, doubtful = keep_tracking(touch, state.doubt, measurement)
            if doubtful:
                return self._prove(replace(state, phase=Phase.APPROACH, turn=None, touch=touch), measurement)
        reference = self.parameters.force_n if stride.reference is None else stride.reference
        enough = measurement.force >= self.parameters.travel_from_share * reference
        settled = state.settled or enough
        goes_on = state.in_contact and settled
        step = self.way(self.parameters.speed_mm_s, measurement.dt) * measurement.advance * stride.feed
        travel = state.travel + (step if goes_on else 0.0)
        seen = Measurement(
            measurement.time,
            measurement.force,
            measurement.position,
            measurement.commanded,
            state.in_contact,
            measurement.paired_force,
            measurement.travel,
            travel,
            state.free,
            measurement.advance,
            measurement.saturated,
            measurement.dt,
            measurement.against,
            measurement.sample,
        )
        memory, command = as_answer(self.controller.step(state.controller, seen, reference))
        if state.in_contact:
            state = TaskState(
                state.phase,
                travel,
                state.turn,
                True,
                settled,
                state.free,
                None,  # found again, if it was lost
                None,
                state.losses,
                memory,
                state.reason,
                state.failed,
                state.stiffness,
                state.course,
                state.doubt,
                touch,
                state.yielded,
                state.across + command.across,
            )
            output = _output(state, command.position, _TRACK, command)
            if travel > self.parameters.travel_limit_mm * 1e-3 - _ROUNDING:
                text = f"travelled {self.parameters.travel_limit_mm:g} mm"
                state = self.finish(state, Reason(Cause.TRAVELLED, text))
            return state, output
        first = state.lost_for is None
        lost_for = (state.lost_for or 0.0) + measurement.dt
        lost_at = measurement.commanded if first and state.lost_at is None else state.lost_at
        state = replace(
            state,
            settled=settled,
            controller=memory,
            lost_for=lost_for,
            losses=state.losses + first,
            lost_at=lost_at,
        )
        if self._beyond_edge(state, command.position):
            return self._retract(self.fail(state, self._edge), measurement)
        output = _output(state, command.position, Phase.TRACK, command)
        if state.losses >= self.parameters.loss_limit:
            state = self.fail(state, Reason(Cause.CONTACT_LOST, f"contact lost {state.losses} times"))
        elif lost_for * 1e3 >= self.parameters.loss_ms:
            state = replace(state, phase=Phase.APPROACH, turn=None)
        return state, output

    def _retract(self, state: TaskState, measurement: Measurement) -> tuple[TaskState, TaskOutput]:
        """Back by what is asked for, and at least to the depth of the start. Up to there the tool has been before;
        beyond it something may be in the way, and the steps are those of an approach.
        """
        parameters, commanded = self.parameters, measurement.commanded
        turn = commanded if state.turn is None else state.turn
        goal = min(turn - parameters.retract_mm * 1e-3, 0.0)
        step = self.way(parameters.retract_speed_mm_s, measurement.dt)
        stiffness = max(parameters.expected_stiffness_n_m, state.stiffness or 0.0)
        escape = escape_way(measurement, self.force_limit_n, stiffness, self.escape_mm_s)
        if commanded > _ROUNDING:
            depth = max(commanded - max(step, escape), 0.0)
        else:
            careful = min(step, self.careful_step(measurement.position - commanded, measurement.dt))
            depth = max(commanded - max(careful, escape), goal)
        aside = way_back(measurement, state.yielded, step, self.friction_share)
        state = replace(state, turn=turn, travel=state.travel - aside, yielded=state.yielded + aside)
        output = _output(state, depth, Phase.RETRACT)
        # A command that the supervisor held back at the workspace's border does not count as arrived.
        if commanded <= goal + _ROUNDING:
            state = replace(state, phase=Phase.END)
        return state, output


def _output(state: TaskState, depth: float, phase: Phase, command: Command | None = None) -> TaskOutput:
    return TaskOutput(
        phase,
        Target(depth, state.travel, state.across),
        state.in_contact,
        command,
        state.losses,
        state.reason,
        state.failed,
    )


_ROUNDING = 1e-9
"""Slack for sums of steps, m."""

_SLOWEST = 0.2e-3
"""Speed of the approach whatever the stiffness, m/s. Chosen: 0.036 mm in a cycle of 180 ms, less than a step of the
robot's position.
"""
