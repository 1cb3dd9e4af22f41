"""A sample of the stroke by itself: into the surface, or out of it. Pure."""

from msgspec.structs import replace

from hil_bridge.control.program.leg import Leg
from hil_bridge.control.program.state import ProgramState
from hil_bridge.control.steps.seam import Taken
from hil_bridge.control.types import Measurement


def take_stroke(leg: Leg, state: ProgramState, measurement: Measurement) -> Taken:
    """One sample of a leg that the stroke takes alone."""
    stroke, order = leg.stroke.step(state.stroke, measurement)
    return Taken(replace(state, stroke=stroke), order, trouble=stroke.trouble)
