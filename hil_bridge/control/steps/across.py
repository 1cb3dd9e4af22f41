"""Axis across the path, which yields to a force, presses with a force or follows the controller, and the rotation
by which the controller tilts the tool. Pure.
"""

import math
from typing import Any, Protocol

from hil_bridge.control.course.stroke import Order, Stroke, StrokeState
from hil_bridge.control.limiting import within
from hil_bridge.control.steps.plan import StepPlan
from hil_bridge.control.types import ControllerFailed, Measurement, ask, begin

TURNED_SHARE = 0.999
"""Share of the supervisor's rotation limits that is used, so that rounding does not cause clamping."""
_YIELD_S = 0.3
"""Time constant with which the tool yields, s. Chosen."""


class AcrossSettings(Protocol):
    """Settings of a step for the axis across its path. `Track` defines them."""

    @property
    def across(self) -> str: ...
    @property
    def across_n(self) -> float: ...
    @property
    def across_n_mm(self) -> float: ...
    @property
    def across_mm(self) -> float: ...


def aside_by(
    plan: StepPlan, step: AcrossSettings, aside: float, pressed: tuple[StrokeState, Order], dt: float
) -> float:
    """Return the distance to the left of the path, m: `aside` plus the motion that the controller adds in this
    sample.

    `pressed` is the result of the stroke. The motion is no faster than the travel. Otherwise, the tool would catch
    up on motion that the supervisor had clamped while it retracts.
    """
    stroke, order = pressed
    command = order.command
    if command is None or not stroke.in_contact:
        return aside
    most, farthest = plan.stroke.parameters.speed_mm_s * 1e-3 * dt, step.across_mm * 1e-3
    return within(aside + within(command.across, -most, most), -farthest, farthest)


def leaning(plan: StepPlan, before: float, pressed: tuple[StrokeState, Order], dt: float) -> float:
    """Return the angle by which the controller tilts the tool towards the travel after this sample, rad.

    `before` is the previous angle. `pressed` is the result of the stroke.

    The angle changes no faster and no farther than the supervisor allows, so that the tool does not catch up on
    clamped rotation later.
    """
    stroke, order = pressed
    command = order.command
    if command is None or not stroke.in_contact:
        return before
    most = math.radians(plan.limits.turn_deg_s) * TURNED_SHARE * dt
    farthest = math.radians(plan.limits.turn_total_deg) * TURNED_SHARE
    lean = before + within(command.turn, -most, most)
    return within(lean, -farthest, farthest)


def sideways_position(
    stroke: Stroke,
    step: AcrossSettings,
    before: tuple[float, Any],
    measurement: Measurement,
    left: tuple[float, float],
) -> tuple[float, Any]:
    """Return the distance to the left of the path after one sample, m, and the state of the controller across the
    path.

    `before` holds both values after the previous sample; the state is None before the first sample. `left` holds
    the force to the left, N, and the reported distance to the left, m.
    """
    aside, memory = before
    farthest, last = step.across_mm * 1e-3, aside
    quickest = stroke.way(stroke.parameters.approach_speed_mm_s, measurement.dt)
    if step.across == "compliant":
        share = min(measurement.dt / _YIELD_S, 1.0)
        aside = last + share * (-left[0] / step.across_n_mm * 1e-3 - last)
    else:
        aside, memory = _press(stroke, step, before, measurement, left)
    aside = within(aside, last - quickest, last + quickest)
    return within(aside, -farthest, farthest), memory


def _press(
    stroke: Stroke,
    step: AcrossSettings,
    before: tuple[float, Any],
    measurement: Measurement,
    left: tuple[float, float],
) -> tuple[float, Any]:
    """Return the distance to the left and the state of the run's controller, which presses sideways."""
    side, memory = 1.0 if step.across_n > 0 else -1.0, before[1]
    force, reported = side * left[0], side * left[1]
    last = side * before[0]
    if force < stroke.parameters.contact_threshold_n and memory is None:
        ahead = last - reported
        return side * (last + stroke.careful_step(ahead, measurement.dt)), None
    memory = begin(stroke.controller) if memory is None else memory
    sideways = Measurement(
        time=measurement.time,
        force=force,
        position=reported,
        commanded=last,
        in_contact=force > stroke.parameters.loss_threshold_n,
        travel=measurement.travel,
        travel_next=measurement.travel,
        saturated=measurement.saturated,
        dt=measurement.dt,
    )
    memory, command = ask(stroke.controller, memory, sideways, abs(step.across_n))
    if not math.isfinite(command.position):
        raise ControllerFailed from ValueError(f"it commands {command.position} m across the path")
    return side * command.position, memory
