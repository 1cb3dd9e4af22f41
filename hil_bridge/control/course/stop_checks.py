"""The checks of one cycle that stop a run, in the order in which they are asked. Pure.

`CHECKS` lists each with the causes that it can find; the rows of these causes in the table of causes describe what is
measured and by which settings.
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

STANDS_M = 1e-3
"""Largest error of a reported position that still counts as true, m. Chosen: some steps of a coarse robot."""
_FASTER = 1.5
"""Chosen: how many times the path velocity a reported position may move at, for two answers are not evenly spaced."""
_CONSISTENT = 1e-5
"""Largest difference between a request's depth and its position, m. Chosen: far above what rounding makes of
metres, far below what a force would show.
"""


class Cycle(Struct, frozen=True, gc=False):
    """What the checks of one cycle compare."""

    limits: Limits
    state: SupervisorState
    """The state behind the cycle before."""
    seen: Observation
    request: Request
    slip: float
    """Difference between the request's depth and its position, m."""
    still: float
    """Time of the cycles without a new frame, this one included, s."""
    pressed: tuple[float, float] | None
    """Force, N, and depth, m, from which a pressing tool has had no answer; None while it does not press."""
    speed: float
    """Path velocity of the robot, m/s."""
    presses_aside: bool
    """The tool may press against what is beside its way."""


def check_input(cycle: Cycle) -> Reason | None:
    """Stop for a value that is not finite, and for a fault that a device reports."""
    seen, sample = cycle.seen, cycle.seen.sample
    # A sum is finite only if all its parts are. The places are in the slip.
    of_forces = (
        sample.force
        + sample.resultant
        + seen.against
        + sample.peak_force
        + sample.peak_resultant
        + sample.peak_moment
        + sample.sensor_at
    )
    of_pose = sample.now + seen.depth + (sample.tilt or 0.0) + sample.gap + seen.dt
    if not math.isfinite(of_forces + of_pose + cycle.slip):
        cause = Cause.COMMAND_NOT_A_NUMBER
        if not math.isfinite(of_forces):
            cause = Cause.FORCE_NOT_A_NUMBER
        elif not math.isfinite(of_pose):
            cause = Cause.POSE_NOT_A_NUMBER
        return Reason(cause, "a measurement or command is not a number")
    return sample.fault


def check_forces(cycle: Cycle) -> Reason | None:
    """Stop for a force or moment beyond its limit."""
    limits, seen, sample = cycle.limits, cycle.seen, cycle.seen.sample
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
        seen.against > limits.against_travel_n
        and (wall := beyond_friction(seen.against, force, limits.friction_share)) > limits.against_travel_n
    ):
        text = (
            f"a force of {seen.against:.1f} N against the travel is {wall:.1f} N more than friction, allowed are "
            f"{limits.against_travel_n:g} N: something stands in the way"
        )
        return Reason(Cause.WALL, text)
    if seen.aside and (stop := _check_aside(cycle)):
        return stop
    if sample.saturated:
        return Reason(Cause.SATURATED, "the force sensor is at the end of its range")
    if -force > limits.pull_limit_n:
        text = (
            f"a pull of {-force:.1f} N is beyond {limits.pull_limit_n:g} N: "
            "a surface does not pull, so the sensor or its zero is wrong, or the tool hangs on to something"
        )
        return Reason(Cause.PULL, text)
    return None


def _check_aside(cycle: Cycle) -> Reason | None:
    """Stop for a force across the approach on axes that nothing verified."""
    limits, seen, hidden = cycle.limits, cycle.seen, cycle.seen.sample.hidden or 0.0
    if hidden > HIDDEN_N:
        text = f"the moments show {hidden:.1f} N across the approach, the force axes do not: one is dead or wrong"
        return Reason(Cause.DEAD_AXIS, text)
    allowed = limits.force_limit_n if cycle.presses_aside else limits.against_travel_n
    if (
        seen.aside > allowed
        and (beyond := beyond_friction(seen.aside, seen.sample.force, limits.friction_share)) > allowed
    ):
        text = (
            f"a force of {seen.aside:.1f} N across the approach is {beyond:.1f} N more than friction, allowed are "
            f"{allowed:g} N; no weight has verified its direction"
        )
        return Reason(Cause.WALL, text)
    return None


def check_sensor(cycle: Cycle) -> Reason | None:
    """Stop for a force that is too old, does not change, or comes from a dead axis."""
    limits, sample = cycle.limits, cycle.seen.sample
    age_ms = (sample.now - sample.sensor_at) * 1e3
    if not 0.0 <= age_ms <= limits.stale_after_ms:
        digits = 0 if age_ms - limits.stale_after_ms >= 1.0 else 2
        text = f"the newest force is {age_ms:.{digits}f} ms old, allowed are {limits.stale_after_ms:g} ms"
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
    """Stop for a reported pose that cannot be true, or is not where it was ordered to be."""
    limits, state, sample, tilt = cycle.limits, cycle.state, cycle.seen.sample, cycle.seen.sample.tilt
    if tilt is None:
        return None
    position = sample.position
    if state.reported is not None:
        at, before = state.reported
        moved = math.dist(before, position)
        if moved > (sample.now - at) * cycle.speed * _FASTER + STANDS_M:
            text = (
                f"the reported position jumped by {moved * 1e3:.1f} mm in {(sample.now - at) * 1e3:.0f} ms, "
                f"the robot moves at {cycle.speed * 1e3:g} mm/s"
            )
            return Reason(Cause.JUMP, text)
    apart = math.dist(position, state.position)
    if apart * 1e3 > limits.following_error_mm:
        text = (
            f"the reported position is {apart * 1e3:.1f} mm from the commanded one, "
            f"allowed are {limits.following_error_mm:g} mm"
        )
        return Reason(Cause.FOLLOWING, text)
    tilt_deg = math.degrees(tilt) if tilt else 0.0
    if tilt_deg > limits.tilt_deg and tilt_deg > limits.tilt_deg + math.degrees(state.lag):
        where = "start" if state.quaternion is None else "ordered orientation"
        text = f"the robot reports a tool turned by {tilt_deg:.1f}° from the {where}, allowed are {limits.tilt_deg:g}°"
        return Reason(Cause.TILT, text)
    if not (is_inside(limits, position) or is_nearly_inside(limits, position)):
        text = f"the robot reports {position} m, outside the box of limits.workspace_…_m"
        return Reason(Cause.OUTSIDE, text)
    return None


def check_course(cycle: Cycle) -> Reason | None:
    """Stop for what contradicts the cycle before: a force that does not answer a tool that goes deeper, a counter that
    goes back, a decision that took too long, and a request that is not where its depth is.
    """
    limits, seen, pressed, before = cycle.limits, cycle.seen, cycle.pressed, cycle.state.sensor_sequence
    gap, slip, (a, b, c) = seen.sample.gap, cycle.slip, cycle.request.direction
    if pressed is not None and (deeper_mm := (seen.depth - pressed[1]) * 1e3) > limits.unanswered_mm:
        text = f"the force stayed at {seen.sample.force:.2f} N while the tool went {deeper_mm:.1f} mm deeper"
        return Reason(Cause.UNANSWERED, text)
    if before is not None and seen.sample.sensor_sequence < before:
        text = f"the sensor's frame counter went back from {before} to {seen.sample.sensor_sequence}"
        return Reason(Cause.SEQUENCE, text)
    if gap * 1e3 > limits.cycle_deadline_ms:
        text = (
            f"no decision for {gap * 1e3:.0f} ms, allowed are {limits.cycle_deadline_ms:g} ms: "
            "the computer or the controller stood still"
        )
        return Reason(Cause.DEADLINE, text)
    if abs(slip) > _CONSISTENT or abs(math.hypot(a, b, c) - 1.0) > 1e-6:
        text = (
            f"requested depth and position differ by {abs(slip) * 1e3:.3f} mm, "
            "or the direction is no unit vector"
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
"""In the order of their priority: the first stop counts."""

_FINDERS = tuple(check.find for check in CHECKS)


def find_stop(cycle: Cycle) -> Reason | None:
    """Return the first stop of a cycle; None if there is none."""
    for find in _FINDERS:
        if (stop := find(cycle)) is not None:
            return stop
    return None


def is_inside(limits: Limits, position: Vector) -> bool:
    """Return whether a place, base frame, m, is in the box of the workspace."""
    (a, b, c), (x, y, z), (d, e, f) = limits.workspace_min_m, position, limits.workspace_max_m
    return a <= x <= d and b <= y <= e and c <= z <= f


def is_nearly_inside(limits: Limits, position: Vector) -> bool:
    """Return whether a place is inside, or as little outside as a reported position may be wrong."""
    corners = limits.workspace_min_m, position, limits.workspace_max_m
    return all(low - STANDS_M <= at <= high + STANDS_M for low, at, high in zip(*corners, strict=True))
