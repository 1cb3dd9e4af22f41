"""Steps in free space: to another place, along the surface until something pushes back, and a zero. Pure.

Each takes one sample. It answers with the state, the depth wanted, whether the step ends, and trouble.
"""

import math
from typing import TypeAlias

from msgspec.structs import replace

from hil_bridge.control.course.task import TaskState
from hil_bridge.control.program.legs import Leg
from hil_bridge.control.program.state import CourseState, Felt
from hil_bridge.control.types import Measurement
from hil_bridge.errors.causes import Cause, Reason
from protocol.geometry import angle_between

Taken: TypeAlias = tuple[TaskState, float, bool, Reason | None]

_ROUNDING = 1e-9
"""Slack for sums of steps, m."""
_THERE = 0.5e-3
"""Chosen: distance from the place at which the tool counts as arrived, m."""
_PATIENCE_S = 5.0
"""Chosen: time after the last order within which the tool must come to its place."""
_AS_AT_HOME = math.radians(0.5)
"""Chosen: turn from the orientation of the start at which the tool counts as turned back."""


def move(leg: Leg, state: TaskState, measurement: Measurement, felt: Felt) -> Taken:
    """Up to the safe height, across, and wait there until the tool has come."""
    course = state.course
    step, task = leg.step, leg.stroke
    touch = step.contact_n or task.parameters.contact_threshold_n
    depth, force = measurement.commanded, math.hypot(*felt.force)
    if force > touch:
        text = f"the tool touches something in free space, with {force:.1f} N"
        return state, depth, False, Reason(Cause.TOUCH, text)
    speed = min(step.speed_mm_s, task.parameters.retract_speed_mm_s)
    if depth > course.safe + _ROUNDING:
        way = task.way(speed, measurement.dt)
        if depth <= _ROUNDING:  # above the start something may be in the way
            way = min(way, task.careful_step(measurement.position - depth, measurement.dt))
        lifted = replace(state, course=replace(course, since=felt.now))
        return lifted, max(depth - way, course.safe), False, None
    x, y = (place * 1e-3 - start for place, start in zip(step.to_mm, course.start, strict=True))
    course, arrived = _towards(course, (x, y), task.way(step.speed_mm_s, measurement.dt))
    there = (
        arrived and math.dist(felt.place, course.at) <= _THERE and abs(measurement.position - depth) <= _THERE
    )
    turned = (
        course.home is None
        or course.turned is None
        or angle_between(course.turned, course.home) < _AS_AT_HOME
    )
    if not (arrived and turned):
        course = replace(course, since=felt.now)
    return replace(state, course=course), depth, there and turned, _absent(course, felt)


def seek(leg: Leg, state: TaskState, measurement: Measurement, felt: Felt) -> Taken:
    """Along one direction until something pushes back, then a little way back."""
    course = state.course
    step, task, depth = leg.step, leg.stroke, measurement.commanded
    assert leg.way is not None
    (h, k) = leg.way.headings[0]
    local, reported = (
        (x - course.origin[0]) * h + (y - course.origin[1]) * k for x, y in (course.at, felt.place)
    )
    if course.stage == 0:
        force = felt.force[1] * h + felt.force[2] * k
        if force > task.parameters.contact_threshold_n:
            back = max(reported - step.back_off_mm * 1e-3, 0.0)
            course = replace(course, stage=1, stage_at=back, since=felt.now, found=(felt.position, 1))
        elif local >= leg.way.length - _ROUNDING:
            text = f"nothing found within {step.at_most_mm:g} mm"
            return state, depth, False, Reason(Cause.NOT_FOUND, text)
        else:
            way = min(
                task.way(task.parameters.speed_mm_s, measurement.dt),
                task.careful_step(local - reported, measurement.dt),
                leg.way.length - local,
            )
            course = replace(course, at=(course.at[0] + way * h, course.at[1] + way * k))
        return replace(state, course=course), depth, False, None
    (x, y), goal = course.origin, course.stage_at
    course, arrived = _towards(
        course, (x + goal * h, y + goal * k), task.way(task.parameters.retract_speed_mm_s, measurement.dt)
    )
    there = arrived and math.dist(felt.place, course.at) <= _THERE
    if not arrived:
        course = replace(course, since=felt.now)
    return replace(state, course=course), depth, there, _absent(course, felt)


def zero(leg: Leg, state: TaskState, measurement: Measurement, felt: Felt) -> Taken:
    """Stand still, then average what the sensor reads."""
    course, step = state.course, leg.step
    depth, passed = measurement.commanded, felt.now - course.since
    if passed < step.settle_ms * 1e-3:
        return state, depth, False, None
    sums, count, newest = course.readings
    if felt.sensor_sequence != newest and len(felt.wrench) == 6:
        raw = [value + zero for value, zero in zip(felt.wrench, course.zero or (0.0,) * 6, strict=True)]
        sums = tuple(a + b for a, b in zip(sums or (0.0,) * 6, raw, strict=True))
        course = replace(course, readings=(sums, count + 1, felt.sensor_sequence))
        count += 1
    if passed < (step.settle_ms + step.for_ms) * 1e-3:
        return replace(state, course=course), depth, False, None
    if not count:
        return state, depth, False, Reason(Cause.NO_READING, "no force to take for zero")
    mean = tuple(value / count for value in sums)
    before = course.zero or (0.0,) * 6
    force = math.hypot(*(new - old for new, old in zip(mean[:3], before[:3], strict=True)))
    if force > step.at_most_n:
        text = (
            f"{force:.1f} N would be taken for zero, allowed are {step.at_most_n:g} N: "
            "the tool touches something, or the sensor drifts"
        )
        return state, depth, False, Reason(Cause.DRIFT, text)
    return replace(state, course=replace(course, zero=mean)), depth, True, None


def _absent(course: CourseState, felt: Felt) -> Reason | None:
    """Why the run must end although the tool was ordered to its place; None while it may still come."""
    if felt.now - course.since <= _PATIENCE_S:
        return None
    text = "the tool does not come to its place: look at the position that the robot reports"
    return Reason(Cause.NOT_THERE, text)


def _towards(course: CourseState, place: tuple[float, float], way: float) -> tuple[CourseState, bool]:
    """The commanded place nearer to another one, and whether it is there."""
    (x, y), (u, v) = course.at, place
    left = math.hypot(u - x, v - y)
    if left <= way + _ROUNDING:
        return replace(course, at=(u, v)), True
    share = way / left
    return replace(course, at=(x + (u - x) * share, y + (v - y) * share)), False
