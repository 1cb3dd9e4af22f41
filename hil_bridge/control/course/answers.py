"""The answer of a decision: the program's where the force swings, and words for a retraction that is held."""

from msgspec.structs import replace

from hil_bridge.control.course.intent import Intent
from hil_bridge.control.course.oscillation import Advice
from hil_bridge.control.course.verdict import Clamp, Observation, Verdict
from hil_bridge.control.types import Measurement
from hil_bridge.errors.causes import Cause, Reason


def calm(intent: Intent, measurement: Measurement, advice: Advice) -> Intent:
    """Return the program's answer with the detector's factor on the change of command."""
    change = intent.target.depth - measurement.commanded
    depth = measurement.commanded + advice.factor * change
    return replace(intent, target=replace(intent.target, depth=depth))


def explain_halt(verdict: Verdict, seen: Observation) -> Reason:
    """Why a retraction continues no farther."""
    if not isinstance(verdict, Clamp) or verdict.is_for(Cause.WORKSPACE):
        return Reason(Cause.RETRACT_BORDER, "the workspace ends before the tool is retracted")
    return seen.sample.fault or Reason(
        Cause.RETRACT_BLIND, "the sensor tells no force to retract the tool by"
    )
