"""The axis across the path: yielding to a force, or pressing with one. Pure."""

from msgspec.structs import replace

from hil_bridge.control.course.task import Task
from hil_bridge.control.program.state import CourseState
from hil_bridge.control.types import Measurement, as_answer
from hil_bridge.control.words.steps import Track

_YIELD_S = 0.3
"""Chosen: time constant with which the tool yields."""


def beside(
    stroke: Task, step: Track, course: CourseState, measurement: Measurement, left: tuple[float, float]
) -> CourseState:
    """State after one sample; `left` is the force to the left of the path, N, and the reported way to the left, m."""
    force = left[0]
    farthest, before = step.across_mm * 1e-3, course.aside
    quickest = stroke.way(stroke.parameters.approach_speed_mm_s, measurement.dt)
    memory = course.memory
    if step.across == "compliant":
        wanted = before + min(measurement.dt / _YIELD_S, 1.0) * (-force / step.across_n_mm * 1e-3 - before)
    else:
        wanted, memory = _pressing(stroke, step, course, measurement, left)
    wanted = min(max(wanted, before - quickest), before + quickest)
    return replace(course, aside=min(max(wanted, -farthest), farthest), memory=memory)


def _pressing(
    stroke: Task, step: Track, course: CourseState, measurement: Measurement, left: tuple[float, float]
) -> tuple[float, object]:
    """The way to the left by the run's controller, which presses sideways, and the controller's state."""
    side = 1.0 if step.across_n > 0 else -1.0
    force, reported = side * left[0], side * left[1]
    before = side * course.aside
    if force < stroke.parameters.contact_threshold_n and course.memory is None:
        ahead = before - reported
        return side * (before + stroke.careful_step(ahead, measurement.dt)), None
    memory = stroke.controller.initial() if course.memory is None else course.memory
    seen = Measurement(
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
    memory, command = as_answer(stroke.controller.step(memory, seen, abs(step.across_n)))
    return side * command.position, memory
