"""Checks of one cycle that stop a run, in order of evaluation. Pure.

`CHECKS` lists each group of checks with the causes that it can find. The rows of these causes in the table of
causes describe the measured quantity and the settings that apply.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

from msgspec import Struct

from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.sideways import HIDDEN_N
from hil_bridge.control.course.verdict import Observation, Request, SupervisorState
from hil_bridge.control.course.wall import beyond_friction
from hil_bridge.errors.causes import Cause, Reason
from protocol.geometry import Vector

POSITION_ERROR_M = 1e-3
"""Largest error of a reported position that is still accepted as true, m. Chosen: several steps of a coarse robot."""
_FASTER = 1.5
"""Largest speed of a reported position, in multiples of the path velocity. Chosen: two reports are not evenly
spaced.
"""
_CONSISTENT = 1e-5
"""Largest difference between the depth and the position of a request, m. Chosen: far above rounding errors, far
below a depth that a force would show.
"""


class Cycle(Struct, frozen=True, gc=False):
    """Input of the checks of one cycle."""

    limits: Limits
    state: SupervisorState
    """State after the previous cycle."""
    observation: Observation
    request: Request
    slip: float
    """Difference between the depth and the position of the request, m."""
    still: float
    """Accumulated time of the cycles without a new frame, including this one, s."""
    pressed: tuple[float, float] | None
    """Force, N, and depth, m, since which a pressing tool has caused no response; None while the tool does not
    press.
    """
    speed: float
    """Path velocity of the robot, m/s."""
    presses_aside: bool
    """Whether the tool may press against an obstacle next to its path."""


def check_input(cycle: Cycle) -> Reason | None:
    """Return a reason to stop if a value is not finite, or a device reports a fault."""
    observation, sample = cycle.observation, cycle.observation.sample
    # The sum is finite only if all its terms are. The positions are part of the slip.
    of_forces = (
        sample.force
        + sample.resultant
        + observation.against
        + sample.peak_force
        + sample.peak_resultant
        + sample.peak_moment
        + sample.sensor_at
    )
    of_pose = sample.now + observation.depth + (sample.tilt or 0.0) + sample.gap + observation.dt
    if not math.isfinite(of_forces + of_pose + cycle.slip):
        cause = Cause.COMMAND_NOT_A_NUMBER
        if not math.isfinite(of_forces):
            cause = Cause.FORCE_NOT_A_NUMBER
        elif not math.isfinite(of_pose):
            cause = Cause.POSE_NOT_A_NUMBER
        return Reason(cause, "a measurement or command is not a number")
    return sample.fault


def check_forces(cycle: Cycle) -> Reason | None:
    """Return a reason to stop if a force or moment exceeds its limit."""
    limits, observation, sample = cycle.limits, cycle.observation, cycle.observation.sample
    force, peak = sample.force, sample.peak_force
    if abs(force) > limits.force_limit_n or abs(peak) > limits.force_limit_n:
        most = force if abs(force) >= abs(peak) else peak
        size = f"of at least {abs(most):.1f}" if sample.saturated else f"{most:.1f}"
        return Reason(Cause.FORCE, f"contact force {size} N is beyond {limits.force_limit_n:g} N")
    if sample.resultant > limits.resultant_limit_n or sample.peak_resultant > limits.resultant_limit_n:
        resultant = max(sample.resultant, sample.peak_resultant)
        text = f"resultant force {resultant:.1f} N is beyond {limits.resultant_limit_n:g} N"
        return Reason(Cause.RESULTANT_FORCE, text)
    if sample.peak_moment > limits.moment_limit_nm:
        text = f"moment {sample.peak_moment:.2f} N·m is beyond {limits.moment_limit_nm:g} N·m"
        return Reason(Cause.MOMENT, text)
    if (
        observation.against > limits.against_travel_n
        and (wall := beyond_friction(observation.against, force, limits.friction_share))
        > limits.against_travel_n
    ):
        text = (
            f"a force of {observation.against:.1f} N against the travel is {wall:.1f} N more than friction, "
            f"allowed: at most {limits.against_travel_n:g} N: there is an obstacle"
        )
        return Reason(Cause.WALL, text)
    if observation.aside and (stop := _check_aside(cycle)):
        return stop
    if sample.saturated:
        return Reason(Cause.SATURATED, "the force sensor is at the end of its range")
    if -force > limits.pull_limit_n:
        text = (
            f"a pull of {-force:.1f} N is beyond {limits.pull_limit_n:g} N: "
            "a surface does not pull, so the sensor or its zero is wrong, or the tool is stuck to something"
        )
        return Reason(Cause.PULL, text)
    return None


def _check_aside(cycle: Cycle) -> Reason | None:
    """Return a reason to stop if there is a force across the approach on unverified axes."""
    limits, observation, hidden = cycle.limits, cycle.observation, cycle.observation.sample.hidden or 0.0
    if hidden > HIDDEN_N:
        text = f"the moments show {hidden:.1f} N across the approach, the force axes do not: one is dead or wrong"
        return Reason(Cause.DEAD_AXIS, text)
    allowed = limits.force_limit_n if cycle.presses_aside else limits.against_travel_n
    if (
        observation.aside > allowed
        and (beyond := beyond_friction(observation.aside, observation.sample.force, limits.friction_share))
        > allowed
    ):
        text = (
            f"a force of {observation.aside:.1f} N across the approach is {beyond:.1f} N more than friction, "
            f"allowed: at most {allowed:g} N; no weight has verified its direction"
        )
        return Reason(Cause.WALL, text)
    return None


def check_sensor(cycle: Cycle) -> Reason | None:
    """Return a reason to stop if the force is too old, does not change, or comes from a dead axis."""
    limits, sample = cycle.limits, cycle.observation.sample
    age_ms = (sample.now - sample.sensor_at) * 1e3
    if not 0.0 <= age_ms <= limits.stale_after_ms:
        digits = 0 if age_ms - limits.stale_after_ms >= 1.0 else 2
        text = (
            f"the newest force is {age_ms:.{digits}f} ms old, allowed: at most {limits.stale_after_ms:g} ms"
        )
        return Reason(Cause.FORCE_TOO_OLD, text)
    if sample.unchanged * 1e3 >= limits.frozen_after_ms:
        text = f"the force sensor repeated the same counts for {sample.unchanged:.1f} s"
        return Reason(Cause.SAME_COUNTS, text)
    if cycle.still * 1e3 >= limits.still_after_ms:
        return Reason(Cause.NO_NEW_FRAME, f"no new force for {cycle.still * 1e3:.0f} ms")
    if sample.dead_axis:
        return Reason(Cause.DEAD_AXIS, sample.dead_axis)
    return None


def check_pose(cycle: Cycle) -> Reason | None:
    """Return a reason to stop if the reported pose cannot be true, or does not match the orders."""
    limits, state, sample, tilt = (
        cycle.limits,
        cycle.state,
        cycle.observation.sample,
        cycle.observation.sample.tilt,
    )
    if tilt is None:
        return None
    position = sample.position
    if state.reported is not None:
        at, before = state.reported
        distance = math.dist(before, position)
        if distance > (sample.now - at) * cycle.speed * _FASTER + POSITION_ERROR_M:
            text = (
                f"the reported position jumped by {distance * 1e3:.1f} mm in {(sample.now - at) * 1e3:.0f} ms, "
                f"the robot moves at {cycle.speed * 1e3:g} mm/s"
            )
            return Reason(Cause.JUMP, text)
    apart = math.dist(position, state.position)
    if apart * 1e3 > limits.following_error_mm:
        text = (
            f"the reported position is {apart * 1e3:.1f} mm from the commanded one, "
            f"allowed: at most {limits.following_error_mm:g} mm"
        )
        return Reason(Cause.FOLLOWING, text)
    tilt_deg = math.degrees(tilt) if tilt else 0.0
    if tilt_deg > limits.tilt_deg and tilt_deg > limits.tilt_deg + math.degrees(state.lag):
        where = "start" if state.quaternion is None else "ordered orientation"
        text = (
            f"the robot reports a tool turned by {tilt_deg:.1f}° from the {where}, "
            f"allowed: at most {limits.tilt_deg:g}°"
        )
        return Reason(Cause.TILT, text)
    if not (is_inside(limits, position) or is_nearly_inside(limits, position)):
        text = f"the robot reports {position} m, outside the box of limits.workspace_…_m"
        return Reason(Cause.OUTSIDE, text)
    return None


def check_course(cycle: Cycle) -> Reason | None:
    """Return a reason to stop if the cycle contradicts the previous one: the force does not respond to a tool that
    moves deeper, a counter decreases, a decision took too long, or the position of a request does not match its
    depth.
    """
    limits, observation, pressed, before = (
        cycle.limits,
        cycle.observation,
        cycle.pressed,
        cycle.state.sensor_sequence,
    )
    gap, slip, (a, b, c) = observation.sample.gap, cycle.slip, cycle.request.direction
    if pressed is not None and (deeper_mm := (observation.depth - pressed[1]) * 1e3) > limits.unanswered_mm:
        text = f"the force stayed at {observation.sample.force:.2f} N while the tool went {deeper_mm:.1f} mm deeper"
        return Reason(Cause.UNANSWERED, text)
    if before is not None and observation.sample.sensor_sequence < before:
        text = f"the sensor's frame counter decreased from {before} to {observation.sample.sensor_sequence}"
        return Reason(Cause.SEQUENCE, text)
    if gap * 1e3 > limits.cycle_deadline_ms:
        text = (
            f"no decision for {gap * 1e3:.0f} ms, allowed: at most {limits.cycle_deadline_ms:g} ms: "
            "the computer or the controller stalled"
        )
        return Reason(Cause.DEADLINE, text)
    if abs(slip) > _CONSISTENT or abs(math.hypot(a, b, c) - 1.0) > 1e-6:
        text = (
            f"requested depth and position differ by {abs(slip) * 1e3:.3f} mm, "
            "or the direction is not a unit vector"
        )
        return Reason(Cause.INCONSISTENT, text)
    return None


class Check(NamedTuple):
    """One group of checks, and the causes that it can find."""

    find: Callable[[Cycle], Reason | None]
    causes: tuple[Cause, ...]


CHECKS = (
    Check(
        check_input,
        (
            Cause.FORCE_NOT_A_NUMBER,
            Cause.POSE_NOT_A_NUMBER,
            Cause.COMMAND_NOT_A_NUMBER,
            Cause.ROBOT_STATE,
            Cause.ORIENTATION,
            Cause.SENSOR_FAILED,
        ),
    ),
    Check(
        check_forces,
        (
            Cause.FORCE,
            Cause.RESULTANT_FORCE,
            Cause.MOMENT,
            Cause.WALL,
            Cause.SATURATED,
            Cause.PULL,
            Cause.DEAD_AXIS,
        ),
    ),
    Check(check_sensor, (Cause.FORCE_TOO_OLD, Cause.SAME_COUNTS, Cause.NO_NEW_FRAME, Cause.DEAD_AXIS)),
    Check(check_pose, (Cause.JUMP, Cause.FOLLOWING, Cause.TILT, Cause.OUTSIDE)),  # before the depth is used
    Check(check_course, (Cause.UNANSWERED, Cause.SEQUENCE, Cause.DEADLINE, Cause.INCONSISTENT)),
)
"""Groups of checks in order of priority. The first stop that they find counts."""

_FINDERS = tuple(check.find for check in CHECKS)


def find_stop(cycle: Cycle) -> Reason | None:
    """Return the reason of the first check that stops the cycle; None if no check does."""
    for find in _FINDERS:
        if (stop := find(cycle)) is not None:
            return stop
    return None


def is_inside(limits: Limits, position: Vector) -> bool:
    """Return whether a position (base frame, m) is inside the box of the workspace."""
    (a, b, c), (x, y, z), (d, e, f) = limits.workspace_min_m, position, limits.workspace_max_m
    return a <= x <= d and b <= y <= e and c <= z <= f


def is_nearly_inside(limits: Limits, position: Vector) -> bool:
    """Return whether a position is inside the workspace, or outside by no more than the error of a reported
    position.
    """
    corners = limits.workspace_min_m, position, limits.workspace_max_m
    return all(
        low - POSITION_ERROR_M <= at <= high + POSITION_ERROR_M
        for low, at, high in zip(*corners, strict=True)
    )
