"""Orientation that a step requests, and the rotation towards it within the allowed speed. Pure."""

import math

from hil_bridge.control.course.facing import Facing, inward
from hil_bridge.control.geometry.turning import rotate_towards, tip_tool, yaw_tool
from hil_bridge.control.geometry.ways import Place
from hil_bridge.control.geometry.work_frame import WorkFrame
from hil_bridge.control.program.leg import Leg
from hil_bridge.control.program.state import ProgramState
from hil_bridge.control.steps.across import TURNED_SHARE
from protocol.geometry import Quaternion, product, turn_about


def heading_of(leg: Leg, state: ProgramState) -> Place:
    """Return the direction of the path at the commanded point, as a unit vector in x and y."""
    if leg.way is None:
        return state.course.facing.heading
    return leg.way.headings[leg.way.piece(state.step.local)]


def turn_tool(
    state: ProgramState, leg: Leg, frame: WorkFrame, facing: Facing, dt: float
) -> Quaternion | None:
    """Return the orientation to command, rotated towards the orientation of the leg as far as one sample allows;
    None to keep the current orientation.
    """
    home, turned = state.course.home, state.course.turned
    if home is None or (goal := _choose_orientation(state, leg, frame, facing)) is None:
        return turned
    rate = math.radians(leg.limits.turn_deg_s) * TURNED_SHARE
    return rotate_towards(turned or home, goal, rate * dt)


def _choose_orientation(state: ProgramState, leg: Leg, frame: WorkFrame, facing: Facing) -> Quaternion | None:
    """Return the orientation that a leg requests; None if it keeps the current orientation."""
    course, lean = state.course, state.step.lean
    home, turned = course.home, course.turned
    assert home is not None
    if leg.step.turns_home:
        return home if turned is not None else None
    match leg.step.orientation:
        case "along-path" if leg.way is not None:
            return yaw_tool(home, frame.approach, leg.way.headings[0], heading_of(leg, state))
        case "normal" if math.degrees(course.facing.sigma) <= facing.uncertain_deg:
            a, t, b = inward(course.facing.fall)
            x, y, z = (
                a * i + t * j + b * k for i, j, k in zip(frame.approach, frame.x, frame.y, strict=True)
            )
            return tip_tool(home, (x, y, z))
        case "led" if lean or turned is not None:
            x, y, z = frame.y
            return product(turn_about((-x, -y, -z), lean), home)
        case _:
            return None
