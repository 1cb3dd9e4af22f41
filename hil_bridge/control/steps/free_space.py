"""Steps in free space: to another place, along the surface until something pushes back, and a zero. Pure."""

import math
from typing import TYPE_CHECKING

from msgspec.structs import replace

from hil_bridge.control.course.intent import Phase
from hil_bridge.control.course.stroke import Order
from hil_bridge.control.program.leg import Leg
from hil_bridge.control.program.state import Felt, ProgramState
from hil_bridge.control.steps.seam import Taken
from hil_bridge.errors.causes import Cause, Reason
from protocol.geometry import angle_between

if TYPE_CHECKING:
    from hil_bridge.control.steps.move import Move
    from hil_bridge.control.steps.seek import Seek
    from hil_bridge.control.steps.zero import Zero

_ROUNDING = 1e-9
"""Slack for sums of steps, m."""
_THERE = 0.5e-3
"""Chosen: distance from the place at which the tool counts as arrived, m."""
_UNSURE_N = 5.0
"""Chosen: force across the approach from which it must be one against the way, N, where nothing verified the axes."""
_UNSURE_SHARE = 3.0
"""Chosen: how many times the force against the way it may be: a face that is met at less than 70°."""
_PATIENCE_S = 5.0
"""Chosen: time after the last order within which the tool must come to its place."""
_AS_AT_HOME = math.radians(0.5)
"""Chosen: turn from the orientation of the start at which the tool counts as turned back."""


def move(step: "Move", leg: Leg, state: ProgramState, felt: Felt) -> Taken:
    """Up to the safe height, across, and wait there until the tool has come."""
    task, measurement, now = leg.stroke, felt.measurement, felt.sample.now
    touch = step.contact_n or task.parameters.contact_threshold_n
    depth, force = measurement.commanded, max(math.hypot(*felt.force), felt.sample.hidden or 0.0)
    if force > touch:
        text = f"the tool touches something in free space, with {force:.1f} N"
        return Taken(state, Order(Phase.MOVE, depth), trouble=Reason(Cause.TOUCH, text))
    speed = min(step.speed_mm_s, task.parameters.retract_speed_mm_s)
    if depth > state.safe + _ROUNDING:
        way = task.way(speed, measurement.dt)
        if depth <= _ROUNDING:  # above the start something may be in the way
            way = min(way, task.careful_step(measurement.position - depth, measurement.dt))
        return Taken(replace(state, since=now), Order(Phase.MOVE, max(depth - way, state.safe)))
    assert state.start is not None
    x, y = (place * 1e-3 - start for place, start in zip(step.to_mm, state.start, strict=True))
    state, arrived = _towards(state, (x, y), task.way(step.speed_mm_s, measurement.dt))
    there = (
        arrived and math.dist(felt.place, state.at) <= _THERE and abs(measurement.position - depth) <= _THERE
    )
    turned = (
        state.home is None or state.turned is None or angle_between(state.turned, state.home) < _AS_AT_HOME
    )
    if not (arrived and turned):
        state = replace(state, since=now)
    return Taken(state, Order(Phase.MOVE, depth), there and turned, _absent(state, now))


def seek(step: "Seek", leg: Leg, state: ProgramState, felt: Felt) -> Taken:
    """Along one direction until something pushes back, then a little way back."""
    task, measurement, now = leg.stroke, felt.measurement, felt.sample.now
    order = Order(Phase.SEEK, measurement.commanded)
    assert leg.way is not None
    (h, k) = leg.way.headings[0]
    local, reported = (
        (x - state.origin[0]) * h + (y - state.origin[1]) * k for x, y in (state.at, felt.place)
    )
    if state.stage == 0:
        force = felt.against((h, k))
        if felt.aside > max(_UNSURE_N, _UNSURE_SHARE * force) and force < felt.aside:
            text = f"{felt.aside:.1f} N across the approach, {force:.1f} N against the way: an axis is dead or wrong"
            return Taken(state, order, trouble=Reason(Cause.DEAD_AXIS, text))
        if force > task.parameters.contact_threshold_n:
            back = max(reported - step.back_off_mm * 1e-3, 0.0)
            state = replace(state, stage=1, stage_at=back, since=now, found=(felt.sample.position, 1))
        elif local >= leg.way.length - _ROUNDING:
            text = f"nothing found within {step.at_most_mm:g} mm"
            return Taken(state, order, trouble=Reason(Cause.NOT_FOUND, text))
        else:
            way = min(
                task.way(task.parameters.speed_mm_s, measurement.dt),
                task.careful_step(local - reported, measurement.dt),
                leg.way.length - local,
            )
            state = replace(state, at=(state.at[0] + way * h, state.at[1] + way * k))
        return Taken(state, order)
    (x, y), goal = state.origin, state.stage_at
    state, arrived = _towards(
        state, (x + goal * h, y + goal * k), task.way(task.parameters.retract_speed_mm_s, measurement.dt)
    )
    there = arrived and math.dist(felt.place, state.at) <= _THERE
    if not arrived:
        state = replace(state, since=now)
    return Taken(state, order, there, _absent(state, now))


def zero(step: "Zero", leg: Leg, state: ProgramState, felt: Felt) -> Taken:
    """Stand still, then average what the sensor reads."""
    order, passed = Order(Phase.ZERO, felt.measurement.commanded), felt.sample.now - state.since
    if passed < step.settle_ms * 1e-3:
        return Taken(state, order)
    sums, count, newest = state.readings
    if felt.sample.sensor_sequence != newest and len(felt.wrench) == 6:
        raw = [value + zero for value, zero in zip(felt.wrench, state.zero or (0.0,) * 6, strict=True)]
        sums = tuple(a + b for a, b in zip(sums or (0.0,) * 6, raw, strict=True))
        state = replace(state, readings=(sums, count + 1, felt.sample.sensor_sequence))
        count += 1
    if passed < (step.settle_ms + step.for_ms) * 1e-3:
        return Taken(state, order)
    if not count:
        return Taken(state, order, trouble=Reason(Cause.NO_READING, "no force to take for zero"))
    mean = tuple(value / count for value in sums)
    before = state.zero or (0.0,) * 6
    force = math.hypot(*(new - old for new, old in zip(mean[:3], before[:3], strict=True)))
    if force > step.at_most_n:
        text = (
            f"{force:.1f} N would be taken for zero, allowed are {step.at_most_n:g} N: "
            "the tool touches something, or the sensor drifts"
        )
        return Taken(state, order, trouble=Reason(Cause.DRIFT, text))
    return Taken(replace(state, zero=mean), order, done=True)


def _absent(state: ProgramState, now: float) -> Reason | None:
    """Why the run must end although the tool was ordered to its place; None while it may still come."""
    if now - state.since <= _PATIENCE_S:
        return None
    text = "the tool does not come to its place: look at the position that the robot reports"
    return Reason(Cause.NOT_THERE, text)


def _towards(state: ProgramState, place: tuple[float, float], way: float) -> tuple[ProgramState, bool]:
    """The commanded place nearer to another one, and whether it is there."""
    (x, y), (u, v) = state.at, place
    left = math.hypot(u - x, v - y)
    if left <= way + _ROUNDING:
        return replace(state, at=(u, v)), True
    share, heading = way / left, ((u - x) / left, (v - y) / left)
    return replace(state, at=(x + (u - x) * share, y + (v - y) * share), heading=heading), False
