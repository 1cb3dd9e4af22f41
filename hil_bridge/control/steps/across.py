"""The axis across the path: yielding to a force, pressing with one, or where the controller leads; and the turn about
it, where the controller tips the tool. Pure.
"""

import math
from typing import TYPE_CHECKING, Any

from hil_bridge.control.course.stroke import Order, Stroke, StrokeState
from hil_bridge.control.limiting import within
from hil_bridge.control.program.leg import Leg
from hil_bridge.control.program.state import ProgramState
from hil_bridge.control.types import ControllerFailed, Measurement, ask, begin

if TYPE_CHECKING:
    from hil_bridge.control.steps.track import Track

TURNED_SHARE = 0.999
"""Share of the guard's limits of turning that is used: rounding must not make the guard clamp."""
_YIELD_S = 0.3
"""Chosen: time constant with which the tool yields."""


def aside_by(
    leg: Leg, step: "Track", state: ProgramState, pressed: tuple[StrokeState, Order], dt: float
) -> float:
    """The way to the left of the path, m, with what the controller adds in this sample. `pressed` is what the stroke
    has made of it.

    It is no faster than the travel: what the guard cuts off would be made up for while the tool retracts.
    """
    stroke, order = pressed
    command = order.command
    if command is None or not stroke.in_contact:
        return state.aside
    most, farthest = leg.stroke.parameters.speed_mm_s * 1e-3 * dt, step.across_mm * 1e-3
    aside = state.aside + within(command.across, -most, most)
    return within(aside, -farthest, farthest)


def leaning(leg: Leg, before: float, pressed: tuple[StrokeState, Order], dt: float) -> float:
    """The angle by which the controller tips the tool towards the travel, rad, with what it adds in this sample to that
    before. `pressed` is what the stroke has made of it.

    It is no faster and no farther than the guard allows, so that nothing that was cut off is made up for later.
    """
    stroke, order = pressed
    command = order.command
    if command is None or not stroke.in_contact:
        return before
    most = math.radians(leg.limits.turn_deg_s) * TURNED_SHARE * dt
    farthest = math.radians(leg.limits.turn_total_deg) * TURNED_SHARE
    lean = before + within(command.turn, -most, most)
    return within(lean, -farthest, farthest)


def beside(
    stroke: Stroke, step: "Track", state: ProgramState, measurement: Measurement, left: tuple[float, float]
) -> tuple[Any, float]:
    """The controller's state across the path after one sample, and the way to the left of it, m.

    `left` is the force to the left of it, N, and the reported way there, m.
    """
    farthest, before = step.across_mm * 1e-3, state.aside
    quickest = stroke.way(stroke.parameters.approach_speed_mm_s, measurement.dt)
    memory = state.memory
    if step.across == "compliant":
        share = min(measurement.dt / _YIELD_S, 1.0)
        aside = before + share * (-left[0] / step.across_n_mm * 1e-3 - before)
    else:
        aside, memory = _press(stroke, step, state, measurement, left)
    aside = within(aside, before - quickest, before + quickest)
    return memory, within(aside, -farthest, farthest)


def _press(
    stroke: Stroke, step: "Track", state: ProgramState, measurement: Measurement, left: tuple[float, float]
) -> tuple[float, Any]:
    """The way to the left by the run's controller, which presses sideways, and the controller's state."""
    side = 1.0 if step.across_n > 0 else -1.0
    force, reported = side * left[0], side * left[1]
    before = side * state.aside
    if force < stroke.parameters.contact_threshold_n and state.memory is None:
        ahead = before - reported
        return side * (before + stroke.careful_step(ahead, measurement.dt)), None
    memory = begin(stroke.controller) if state.memory is None else state.memory
    sideways = Measurement(
        measurement.time,
        force,
        reported,
        before,
        force > stroke.parameters.loss_threshold_n,
        travel=measurement.travel,
        travel_next=measurement.travel,
        saturated=measurement.saturated,
        dt=measurement.dt,
    )
    memory, command = ask(stroke.controller, memory, sideways, abs(step.across_n))
    if not math.isfinite(command.position):
        raise ControllerFailed from ValueError(f"it commands {command.position} m across the path")
    return side * command.position, memory
