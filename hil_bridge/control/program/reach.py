"""Check that the paths of a program stay within the workspace, made before any motion. Pure."""

from collections.abc import Iterator
from operator import itemgetter

from hil_bridge.control.course.intent import Phase
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.geometry.work_frame import WorkFrame
from hil_bridge.control.program.leg import Row
from hil_bridge.control.program.program import Program
from hil_bridge.errors import StepError
from protocol.geometry import Vector


def corners(row: Row, frame: WorkFrame, start: Vector) -> Iterator[tuple[str, Vector]]:
    """Yield the corners of all paths at the depth of the start, base frame, m, each with the label of its step.

    The corners of a move lie at the safe height. The corner of a retract is its end point after the deepest
    approach.

    A path whose start is known only during the run is omitted. The path of a run without steps is omitted as well:
    it ends by time, or at the border, along which it continues.
    """
    if not row.written:
        return
    origin = frame.origin or start
    depth = sum((s - o) * n for s, o, n in zip(start, origin, frame.approach, strict=True))
    touched = 0.0
    for leg, place in zip(row.legs, row.places, strict=True):
        if leg.step.phase is Phase.APPROACH:
            touched = leg.stroke.parameters.approach_depth_limit_mm * 1e-3
        places, height = leg.step.places(leg, place)
        if leg.step.phase is Phase.RETRACT:
            height = max(height - touched, 0.0)
        deep = depth - height
        for x, y in places:
            a, b, c = (
                o + deep * n + x * t + y * s
                for o, n, t, s in zip(origin, frame.approach, frame.x, frame.y, strict=True)
            )
            yield leg.label, (a, b, c)


def check_workspace(row: Row, frame: WorkFrame, start: Vector, limits: Limits) -> None:
    """Raise ConfigError for the first path that leaves the workspace. `start` is the position of the tool, base
    frame, m.
    """
    for label, (x, y, z) in corners(row, frame, start):
        for axis, value, low, high in zip(
            "xyz", (x, y, z), limits.workspace_min_m, limits.workspace_max_m, strict=True
        ):
            if not low <= value <= high:
                raise StepError(
                    f"it leads to {x:.3f} {y:.3f} {z:.3f} m in the base frame, outside the box of "
                    f"limits.workspace_…_m: {axis} may be {low:g} … {high:g}",
                    label,
                )


def outermost(row: Row, frame: WorkFrame, start: Vector) -> list[tuple[str, Vector]]:
    """Return the outermost corners of each step in each direction of the base frame, without duplicates."""
    corners_found: dict[Vector, str] = {}
    by_step: dict[str, list[Vector]] = {}
    for label, place in corners(row, frame, start):
        by_step.setdefault(label, []).append(place)
    for label, places in by_step.items():
        for axis in range(3):
            for choose in (min, max):
                corners_found.setdefault(choose(places, key=itemgetter(axis)), label)
    return [(label, place) for place, label in corners_found.items()]


def directions_across(program: Program) -> tuple[Vector, ...]:
    """Return the directions in which a program moves across the approach, as unit vectors in the base frame. If
    there are many, or they are known only during the run, return both axes of the work frame.
    """
    frame, headings = program.frame, set()
    for leg in program.row.legs:
        if leg.way is not None:
            headings |= set(leg.way.headings)
        if leg.phase is Phase.MOVE or leg.works_aside:
            headings |= {(1.0, 0.0), (0.0, 1.0)}
    if len(headings) > 2:
        headings = {(1.0, 0.0), (0.0, 1.0)}
    directions = []
    for h, k in sorted(headings):
        x, y, z = (h * u + k * v for u, v in zip(frame.x, frame.y, strict=True))
        directions.append((x, y, z))
    return tuple(directions)
