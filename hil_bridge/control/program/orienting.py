"""The orientation that a step wants, and the way to it: no faster than the guard allows. Pure."""

import math

from msgspec.structs import replace

from hil_bridge.control.geometry.turning import brought, tip_tool, yaw_tool
from hil_bridge.control.program.facing import Facing, inward
from hil_bridge.control.program.felt import WorkFrame
from hil_bridge.control.program.legs import Leg
from hil_bridge.control.program.state import CourseState
from hil_bridge.control.words.paths import Place
from hil_bridge.control.words.steps import Move
from protocol.geometry import Quaternion

_BELOW = 0.999
"""Share of the turning speed that is used: rounding must not make the guard clamp."""


def heading_of(leg: Leg, course: CourseState) -> Place:
    """Direction of the path at the commanded place, unit vector in x and y."""
    if leg.way is None:
        return course.facing.heading
    return leg.way.headings[leg.way.piece(course.local)]


def turn_tool(course: CourseState, leg: Leg, frame: WorkFrame, facing: Facing, dt: float) -> CourseState:
    """State with the orientation that the leg wants, as far as it may be turned in one sample."""
    if course.home is None or (wanted := _choose_orientation(course, leg, frame, facing)) is None:
        return course
    rate = math.radians(leg.limits.turn_deg_s) * _BELOW
    return replace(course, turned=brought(course.turned or course.home, wanted, rate * dt))


def _choose_orientation(course: CourseState, leg: Leg, frame: WorkFrame, facing: Facing) -> Quaternion | None:
    """The orientation that a leg wants in the end; None where it leaves the tool as it is."""
    assert course.home is not None
    if isinstance(leg.step, Move):
        return course.home if course.turned is not None else None
    match getattr(leg.step, "orientation", "fixed"):
        case "along-path" if leg.way is not None:
            return yaw_tool(course.home, frame.approach, leg.way.headings[0], heading_of(leg, course))
        case "normal" if math.degrees(course.facing.sigma) <= facing.uncertain_deg:
            a, t, b = inward(course.facing.fall)
            x, y, z = (
                a * i + t * j + b * k for i, j, k in zip(frame.approach, frame.x, frame.y, strict=True)
            )
            return tip_tool(course.home, (x, y, z))
        case _:
            return None
