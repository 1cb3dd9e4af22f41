"""Responses of a decision: the program's response with a reduced gain while the force oscillates, and the
explanation of a halted retraction.
"""

from msgspec.structs import replace

from hil_bridge.control.course.intent import Intent
from hil_bridge.control.course.oscillation import Advice
from hil_bridge.control.course.verdict import Clamp, Observation, Verdict
from hil_bridge.control.types import Measurement
from hil_bridge.errors.causes import Cause, Reason


def calm(intent: Intent, measurement: Measurement, advice: Advice) -> Intent:
    """Return the program's response, with the change of the command multiplied by the oscillation detector's factor."""
    change = intent.target.depth - measurement.commanded
    depth = measurement.commanded + advice.factor * change
    return replace(intent, target=replace(intent.target, depth=depth))


def explain_halt(verdict: Verdict, observation: Observation) -> Reason:
    """Return a text that explains why a retraction stopped."""
    if not isinstance(verdict, Clamp) or verdict.is_for(Cause.WORKSPACE):
        return Reason(Cause.RETRACT_BORDER, "the workspace ends before the tool is retracted")
    return observation.sample.fault or Reason(
        Cause.RETRACT_BLIND, "the force needed to retract the tool is unknown"
    )
