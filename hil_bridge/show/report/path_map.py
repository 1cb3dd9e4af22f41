"""The path of a program from above, with the error of the force on it."""

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hil_bridge.control.analysis.merit import RISE_FRACTION
from hil_bridge.record.analysis.strokes import TRACK
from hil_bridge.record.reader import Recording
from hil_bridge.record.records import CycleRecord
from hil_bridge.show.charts.sources import Array, column
from hil_bridge.show.pages.svg import (
    COOLWARM,
    Frame,
    Range,
    dot,
    drawing,
    hexadecimal,
    scale_bar,
    scale_colours,
    text,
)

WIDTH_PX = 1000
_MAP_PX = (160, 620)
"""Least and most height of the path."""
_LEFT, _RIGHT, _TOP, _BELOW = 60, 110, 26, 40
"""Room around it, px."""
_LEAST_SPAN_MM = 4.0
"""Chosen: no direction of the path is drawn with less room than this."""
_ROOM = 0.06
"""Chosen: share of the path that is left free around it."""
_SHOWN_PERCENT = 95.0
"""Chosen: share of the samples whose error lies within the colours. The rise after a touch does not count."""
_LEAST_ERROR = 0.05
"""Chosen: the colours reach at least so far, as a share of the wanted force."""
_CUT_MM = 2.0
"""Chosen: samples farther apart than this are not joined."""
_PIECES_MOST = 3000
"""Coloured pieces; of a longer path only some samples are joined. Chosen: three to a pixel."""


def presses(cycle: CycleRecord) -> bool:
    """Whether the force was controlled."""
    return cycle.phase == TRACK and math.isfinite(cycle.force)


def path_map(recording: Recording) -> str:
    """The drawing; empty where nothing was pressed on, or the tool stayed in its place."""
    cycles = recording.cycles
    x, y = (1e3 * column(cycles, name) for name in ("travel_commanded", "across_commanded"))
    pressing = np.array([presses(cycle) for cycle in cycles])
    if not (pressing.any() and (np.ptp(x) > 0.0 or np.ptp(y) > 0.0)):
        return ""
    box = _box(x, y)
    width = WIDTH_PX - _LEFT - _RIGHT
    height = float(np.clip(width * (box[1][1] - box[1][0]) / (box[0][1] - box[0][0]), *_MAP_PX))
    frame = Frame((_LEFT, _TOP, width, height), *_equal(box, width / height))
    frame.axes("x from the start point, mm", "y, mm")
    frame.parts.append(
        text((_LEFT, 15), "path from above, and error of the force on it", colour="text", bold=True)
    )
    free = np.where(pressing, np.nan, x)
    frame.path(zip(free.tolist(), y.tolist(), strict=True), "quiet", 1.0, dashed=True)
    most = _largest_error(recording, pressing)
    _colour(frame, recording, (x, y), most)
    _number_strokes(frame, recording, (x, y))
    bar = scale_bar((WIDTH_PX - _RIGHT + 12, _TOP, height), COOLWARM, (-most, most), "N")
    return drawing(
        (WIDTH_PX, _TOP + height + _BELOW),
        [*frame.parts, bar],
        "The path from above; its colour is the force less the wanted force",
    )


def _colour(frame: Frame, recording: Recording, places: tuple[Array, Array], most: float) -> None:
    """The path, each piece in the colour of its error."""
    cycles = recording.cycles
    error = column(cycles, "force") - column(cycles, "force_reference")
    chosen = [k for k, cycle in enumerate(cycles) if presses(cycle)]
    chosen = chosen[:: max(1, -(-len(chosen) // _PIECES_MOST))]
    apart = max(_CUT_MM, 3.0 * _spacing(places, chosen))
    colours = scale_colours((error / most + 1.0) / 2.0, COOLWARM)
    x, y = places
    for before, after in pairwise(chosen):
        if np.hypot(x[after] - x[before], y[after] - y[before]) < apart:
            ends = ((float(x[k]), float(y[k])) for k in (before, after))
            frame.path(ends, hexadecimal(colours[before]), 3.5)


def _spacing(places: tuple[Array, Array], chosen: list[int]) -> float:
    """Usual distance between two samples, mm."""
    if len(chosen) < 2:
        return 0.0
    x, y = (values[chosen] for values in places)
    return float(np.median(np.hypot(np.diff(x), np.diff(y))))


def _largest_error(recording: Recording, pressing: NDArray[np.bool_]) -> float:
    """Error at the end of the colours, N."""
    cycles = recording.cycles
    risen, found = False, []
    for cycle in cycles:
        risen = presses(cycle) and (risen or cycle.force >= RISE_FRACTION * cycle.force_reference)
        if risen:
            found.append(abs(cycle.force - cycle.force_reference))
    wanted = float(np.max(np.abs(column(cycles, "force_reference")[pressing])))
    shown = float(np.percentile(found, _SHOWN_PERCENT)) if found else 0.0
    return max(shown, _LEAST_ERROR * wanted, 1e-3)


def _box(x: Array, y: Array) -> tuple[Range, Range]:
    """Least and most x, least and most y that are shown, mm."""
    edges = []
    widest = max(float(np.ptp(x)), float(np.ptp(y)))
    for values in (x, y):
        span = max(float(np.ptp(values)), _LEAST_SPAN_MM, 0.04 * widest)
        middle = (float(values.min()) + float(values.max())) / 2
        half = span / 2 + _ROOM * max(span, 0.25 * widest)
        edges.append((middle - half, middle + half))
    return edges[0], edges[1]


def _equal(box: tuple[Range, Range], ratio: float) -> tuple[Range, Range]:
    """The box widened to the ratio of width to height, so that both scales are equal."""
    (left, right), (low, high) = box
    width = max(right - left, (high - low) * ratio)
    height = width / ratio
    x, y = (left + right) / 2, (low + high) / 2
    return (x - width / 2, x + width / 2), (y - height / 2, y + height / 2)


def _number_strokes(frame: Frame, recording: Recording, places: tuple[Array, Array]) -> None:
    """A dot with the step's number where each track and hold begins; of a repeat, at its first pass alone."""
    seen: set[str] = set()
    first = {cycle.step: place for place, cycle in reversed(list(enumerate(recording.cycles)))}
    for step in recording.steps:
        label = step.label.split(" ", 1)[0]
        presses_here = any(word in step.label for word in ("(track", "(hold"))
        if not presses_here or label in seen or step.step not in first:
            continue
        seen.add(label)
        x, y = (float(values[first[step.step]]) for values in places)
        frame.parts.append(dot((frame.x(x), frame.y(y)), 4, "text"))
        frame.parts.append(text((frame.x(x) + 7, frame.y(y) - 7), label, colour="text", bold=True))
