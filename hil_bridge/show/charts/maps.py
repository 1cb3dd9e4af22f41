"""Maps of the catalogue: the path of a program from above, and the material removed from the surface."""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hil_bridge.control.analysis.merit import RISE_FRACTION
from hil_bridge.record.analysis.strokes import TRACK
from hil_bridge.record.reader import Recording
from hil_bridge.record.records import CycleRecord, TruthRecord
from hil_bridge.record.removed_map import RemovedMap
from hil_bridge.show.charts.cell import recorded_settings
from hil_bridge.show.charts.sources import Array, column
from hil_bridge.show.charts.surface import touches
from hil_bridge.show.pages.description import Grid, Map, Range, Scale, Spot, Trace

_LEAST_SPAN_MM = 4.0
"""Smallest extent of a map along each axis, mm. Chosen."""
_ROOM = 0.06
"""Margin around the path, as a share of its extent. Chosen."""
_SCALED_PERCENT = 95.0
"""Percentage of the samples whose error is within the colour scale, excluding the rise after contact. Chosen."""
_LEAST_ERROR = 0.05
"""Smallest end of the colour scale, as a share of the target force. Chosen."""
_CUT_MM = 2.0
"""Distance above which two samples are not connected, mm. Chosen."""
_LABELS = "x from the start point, mm", "y, mm"
_OWN_LABELS = "path coordinate, mm", "left of the path, mm"
"""Labels of the axes in the work frame, and on a surface that is turned otherwise."""
_PIECES_MOST = 3000
"""Maximum number of coloured segments; a longer path is decimated. Chosen: three per pixel."""
_PLACES_MOST = 4000
"""Maximum number of points of the path on the map of removed material. Chosen: as many as segments."""


def maps_of(recording: Recording) -> list[Map]:
    """Return all maps for which the recording has data."""
    return [one for one in (path_map(recording), removed_map(recording)) if one is not None]


def path_map(recording: Recording) -> Map | None:
    """Return the path of a program, coloured by force error; None if there is no program, force control or motion."""
    cycles = recording.cycles
    pressing = np.array([_presses(cycle) for cycle in cycles])
    if not (any(cycle.step for cycle in cycles) and pressing.any()):
        return None
    x, y = (1e3 * column(cycles, name) for name in ("travel_commanded", "across_commanded"))
    if not (np.ptp(x) > 0.0 or np.ptp(y) > 0.0):
        return None
    most = _largest_error(cycles, pressing)
    along, across = _box(x, y)
    return Map(
        "path",
        "Path from above, coloured by force error",
        *_LABELS,
        along,
        across,
        Scale("sign", -most, most, "N"),
        (
            Trace(np.where(pressing, np.nan, x).tolist(), y.tolist(), "quiet", dashed=True),
            _trace_force(cycles, (x, y)),
        ),
        _strokes(recording, (x, y)),
    )


def removed_map(recording: Recording) -> Map | None:
    """Return the depth of removed material and the path of the tool in contact, or None if no map was recorded."""
    if recording.removed is None:
        return None
    in_frame = _in_work_frame(recording, recording.removed)
    removed, labels = (in_frame, _LABELS) if in_frame is not None else (recording.removed, _OWN_LABELS)
    depths, step = removed.depths, removed.spacing_m * 1e3
    rows, columns = depths.shape
    along, across = (1e3 * place for place in removed.corner_m)
    return Map(
        "removed",
        "Removed depth, and path of the tool on it",
        *labels,
        (along - step / 2, along + (rows - 0.5) * step),
        (across - step / 2, across + (columns - 0.5) * step),
        Scale("amount", 0.0, max(float(depths.max()), 1e-9), "µm"),
        _trace_touch(recording.truths, removed),
        grid=Grid(depths.T.tolist()),
    )


def _in_work_frame(recording: Recording, removed: RemovedMap) -> RemovedMap | None:
    """Return the map in the work frame, as the path from above; None if the surface is turned otherwise."""
    config = recorded_settings(recording)
    if config is None or not recording.cycles:
        return None
    (x, y, _), origin = config.frame.travel, config.frame.origin_mm
    start = recording.cycles[0].sample.position if origin is None else [1e-3 * one for one in origin]
    return removed.turned_to((x, y), (start[0], start[1]))


def _presses(cycle: CycleRecord) -> bool:
    """Return whether the force was controlled in a cycle."""
    return cycle.phase == TRACK and math.isfinite(cycle.force)


def _trace_force(cycles: Sequence[CycleRecord], places: tuple[Array, Array]) -> Trace:
    """Return the parts of the path where the force was controlled; each segment has its force error, N."""
    error = column(cycles, "force") - column(cycles, "force_reference")
    chosen = [k for k, cycle in enumerate(cycles) if _presses(cycle)]
    chosen = chosen[:: max(1, -(-len(chosen) // _PIECES_MOST))]
    apart = max(_CUT_MM, 3.0 * _spacing(places, chosen))
    x, y = places
    rows = []
    for before, after in pairwise([*chosen, chosen[-1]]):
        rows.append((x[before], y[before], error[before]))
        if np.hypot(x[after] - x[before], y[after] - y[before]) >= apart:
            rows.append((math.nan, math.nan, math.nan))
    along, across, errors = np.array(rows).T.tolist()
    return Trace(along, across, width=3.5, values=errors)


def _spacing(places: tuple[Array, Array], chosen: list[int]) -> float:
    """Return the median distance between two successive samples, mm."""
    if len(chosen) < 2:
        return 0.0
    x, y = (values[chosen] for values in places)
    return float(np.median(np.hypot(np.diff(x), np.diff(y))))


def _largest_error(cycles: Sequence[CycleRecord], pressing: NDArray[np.bool_]) -> float:
    """Return the force error at the end of the colour scale, N."""
    risen = False
    errors = []
    for cycle in cycles:
        risen = _presses(cycle) and (risen or cycle.force >= RISE_FRACTION * cycle.force_reference)
        if risen:
            errors.append(abs(cycle.force - cycle.force_reference))
    target = float(np.max(np.abs(column(cycles, "force_reference")[pressing])))
    largest = float(np.percentile(errors, _SCALED_PERCENT)) if errors else 0.0
    return max(largest, _LEAST_ERROR * target, 1e-3)


def _box(x: Array, y: Array) -> tuple[Range, Range]:
    """Return the displayed ranges of x and y, mm."""
    edges = []
    widest = max(float(np.ptp(x)), float(np.ptp(y)))
    for values in (x, y):
        span = max(float(np.ptp(values)), _LEAST_SPAN_MM, 0.04 * widest)
        middle = (float(values.min()) + float(values.max())) / 2
        half = span / 2 + _ROOM * max(span, 0.25 * widest)
        edges.append((middle - half, middle + half))
    return edges[0], edges[1]


def _strokes(recording: Recording, places: tuple[Array, Array]) -> list[Spot]:
    """Return a spot with the number of the step at the start of each track and hold step.

    A step in a repeat gets a spot only in the first pass.
    """
    spots: dict[str, Spot] = {}
    first = {cycle.step: place for place, cycle in reversed(list(enumerate(recording.cycles)))}
    for step in recording.steps:
        if step.word in (TRACK, "hold") and step.step in first and step.number not in spots:
            x, y = (float(values[first[step.step]]) for values in places)
            spots[step.number] = Spot(x, y, step.number)
    return list(spots.values())


def _trace_touch(truths: Sequence[TruthRecord], removed: RemovedMap) -> list[Trace]:
    """Return the path of the tool in contact, on the map, mm. Gaps between two strokes are not drawn."""
    if not truths:
        return []
    places = 1e3 * _on_map(np.array([truth.position for truth in truths]), removed)
    places[:, ~np.array([touches(truth) for truth in truths])] = math.nan
    along, across = places[:, :: max(1, -(-places.shape[1] // _PLACES_MOST))].tolist()
    return [Trace(along, across, "#ffffff")]


def _on_map(positions: Array, removed: RemovedMap) -> Array:
    """Convert positions (n, 3) in the base frame to coordinates (2, n) on the map, all in m.

    The coordinates are the path coordinate and the distance to the left of the path.
    """
    from_corner = positions[:, :2] - np.array(removed.origin_m)
    dx, dy = removed.direction
    along, across = removed.corner_m
    return np.stack((along + from_corner @ np.array([dx, dy]), across + from_corner @ np.array([-dy, dx])))
