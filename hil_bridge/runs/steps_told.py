"""The steps of a program in the record and in words."""

from hil_bridge.control.program.legs import Leg
from hil_bridge.control.program.state import Done
from hil_bridge.recording.records import StepRecord

STEP_EVENT = "step"
"""Kind of the events that tell that a step has ended."""


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
