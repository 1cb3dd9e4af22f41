"""The orientation that a step wants, and the way to it: no faster than the guard allows. Pure."""

import math

from msgspec.structs import replace

from hil_bridge.control.course.facing import Facing, inward
from hil_bridge.control.geometry.turning import brought, tip_tool, yaw_tool
from hil_bridge.control.geometry.ways import Place
from hil_bridge.control.program.felt import WorkFrame
from hil_bridge.control.program.leg import Leg
from hil_bridge.control.program.state import ProgramState
from hil_bridge.control.steps.across import TURNED_SHARE
from protocol.geometry import Quaternion, product, turn_about


def heading_of(leg: Leg, state: ProgramState) -> Place:
    """Direction of the path at the commanded place, unit vector in x and y."""
    if leg.way is None:
        return state.facing.heading
    return leg.way.headings[leg.way.piece(state.local)]


def turn_tool(state: ProgramState, leg: Leg, frame: WorkFrame, facing: Facing, dt: float) -> ProgramState:
    """State with the orientation that the leg wants, as far as it may be turned in one sample."""
    if state.home is None or (wanted := _choose_orientation(state, leg, frame, facing)) is None:
        return state
    rate = math.radians(leg.limits.turn_deg_s) * TURNED_SHARE
    return replace(state, turned=brought(state.turned or state.home, wanted, rate * dt))


def _choose_orientation(state: ProgramState, leg: Leg, frame: WorkFrame, facing: Facing) -> Quaternion | None:
    """The orientation that a leg wants in the end; None where it leaves the tool as it is."""
    assert state.home is not None
    if leg.step.turns_home:
        return state.home if state.turned is not None else None
    match leg.step.orientation:
        case "along-path" if leg.way is not None:
            return yaw_tool(state.home, frame.approach, leg.way.headings[0], heading_of(leg, state))
        case "normal" if math.degrees(state.facing.sigma) <= facing.uncertain_deg:
            a, t, b = inward(state.facing.fall)
            x, y, z = (
                a * i + t * j + b * k for i, j, k in zip(frame.approach, frame.x, frame.y, strict=True)
            )
            return tip_tool(state.home, (x, y, z))
        case "led" if state.lean or state.turned is not None:
            x, y, z = frame.y
            return product(turn_about((-x, -y, -z), state.lean), state.home)
        case _:
            return None
