"""Whether the paths of a program stay where the tool may be; before anything moves. Pure."""

from collections.abc import Iterator
from operator import itemgetter

from hil_bridge.control.course.limits import Limits
from hil_bridge.control.program.felt import WorkFrame
from hil_bridge.control.program.legs import Row
from hil_bridge.control.words.steps import Approach, Move, Retract
from hil_bridge.errors import StepError
from protocol.geometry import Vector


def corners(row: Row, frame: WorkFrame, start: Vector) -> Iterator[tuple[str, Vector]]:
    """Corners of all paths at the depth of the start, base frame, m, with the label of their step. Those of a move lie
    at the safe height, and a retract ends where it would after the deepest approach.

    Paths that begin where only the run knows are left out.
    """
    origin = frame.origin or start
    depth = sum((s - o) * n for s, o, n in zip(start, origin, frame.approach, strict=True))
    touched = 0.0
    for leg, place in zip(row.legs, row.places, strict=True):
        deep = depth
        if isinstance(leg.step, Approach):
            touched = leg.stroke.parameters.approach_depth_limit_mm * 1e-3
        if isinstance(leg.step, Move):
            deep -= leg.stroke.parameters.safe_height_mm * 1e-3
            ends = [leg.step.to_mm] if place is None else [place, leg.step.to_mm]
            places = [(x * 1e-3, y * 1e-3) for x, y in ends]
        elif isinstance(leg.step, Retract) and place is not None:
            deep += min(touched - leg.stroke.parameters.retract_mm * 1e-3, 0.0)
            places = [(place[0] * 1e-3, place[1] * 1e-3)]
        elif leg.way is not None and place is not None:
            places = [(place[0] * 1e-3 + x, place[1] * 1e-3 + y) for x, y in leg.way.points]
        else:
            continue
        for x, y in places:
            a, b, c = (
                o + deep * n + x * t + y * s
                for o, n, t, s in zip(origin, frame.approach, frame.x, frame.y, strict=True)
            )
            yield leg.label, (a, b, c)


def check_workspace(row: Row, frame: WorkFrame, start: Vector, limits: Limits) -> None:
    """Raise ConfigError for the first path that leaves the workspace; the tool stands at `start`, base frame, m."""
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
    """The corners that lie farthest out in each direction of the base frame, of each step; each place once."""
    found: dict[Vector, str] = {}
    by_step: dict[str, list[Vector]] = {}
    for label, place in corners(row, frame, start):
        by_step.setdefault(label, []).append(place)
    for label, places in by_step.items():
        for axis in range(3):
            for choose in (min, max):
                found.setdefault(choose(places, key=itemgetter(axis)), label)
    return [(label, place) for place, label in found.items()]
