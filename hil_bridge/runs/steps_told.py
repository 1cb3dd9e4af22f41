"""The steps of a program in the record and in words."""

from hil_bridge.control.course.task import Task, TaskState
from hil_bridge.control.program.legs import Leg
from hil_bridge.control.program.program import Program
from hil_bridge.control.program.state import Done
from hil_bridge.recording.records import StepRecord

STEP_EVENT = "step"
"""Kind of the events that tell that a step has ended."""
_IN_STEP = ", in step "


def step_record(leg: Leg, done: Done) -> StepRecord:
    """Record of a step that has ended."""
    criterion = getattr(leg.step, "criterion", None)
    return StepRecord(
        done.ended,
        done.leg + 1,
        leg.label,
        done.began,
        done.way,
        done.force_mean,
        done.within,
        None if criterion is None else criterion.for_percent / 100,
        done.passed,
        getattr(leg.step, "name", ""),
        done.found or (),
        done.text,
        done.resumable,
    )


def under_way(task: Task | Program, state: TaskState | None) -> Leg | None:
    """The step under way; None before the first, behind the last, and without a program."""
    course = None if state is None else state.course
    if course is None or course.began is None or not isinstance(task, Program):
        return None
    leg: Leg = task.row.legs[course.leg]
    return leg


def in_step(leg: Leg | None, cause: str) -> str:
    """Why a run stopped, with the step in which it did."""
    return cause if leg is None or _IN_STEP in cause else f"{cause}{_IN_STEP}{leg.label}"


def cut_step(leg: Leg, state: TaskState, now: float, cause: str) -> StepRecord:
    """Record of the step that was under way when an error ended the run."""
    course = state.course
    tally = course.tally
    way = state.travel - course.base if leg.way is not None else 0.0
    mean = tally.force / tally.total if tally.total else None
    cut = Done(course.leg, course.began, now, way, mean, passed=False, text=cause, resumable=tally.good)
    return step_record(leg, cut)


def told_step(leg: Leg, done: Done) -> str:
    """A step that has ended, in one line."""
    parts = [f"{done.ended - done.began:.1f} s"]
    if done.way:
        parts.append(f"{done.way * 1e3:.1f} mm")
    if done.force_mean is not None and leg.way is not None:
        parts.append(f"{done.force_mean:.2f} N on average")
    if done.found is not None:
        x, y, z = (part * 1e3 for part in done.found)
        parts.append(f"{leg.step.name} at {x:.2f} {y:.2f} {z:.2f} mm")
    if done.text:
        parts.append(done.text)
    verdict = "done" if done.passed else "FAILED"
    return f"step {leg.label} {verdict}: {', '.join(parts)}"
