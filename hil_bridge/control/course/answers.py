"""The answer of a decision: the task's where the force swings, and words for a retraction that is held."""

from msgspec.structs import replace

from hil_bridge.control.course.oscillation import Advice
from hil_bridge.control.course.task import TaskOutput
from hil_bridge.control.course.verdict import LEAVES, Clamp, Observation, Verdict
from hil_bridge.control.types import Measurement


def calmed(output: TaskOutput, measurement: Measurement, advice: Advice) -> TaskOutput:
    """The task's answer with the detector's factor on the change of command."""
    change = output.target.depth - measurement.commanded
    depth = measurement.commanded + advice.factor * change
    return replace(output, target=replace(output.target, depth=depth))


def held_back(verdict: Verdict, seen: Observation) -> str:
    """Why a retraction goes on no farther."""
    if isinstance(verdict, Clamp) and LEAVES not in verdict.reasons:
        return seen.fault or "the sensor tells no force to retract the tool by"
    return "the workspace ends before the tool is retracted"
