"""The map of what the tool removed from an emulated surface, with the tool's path on it."""

import math
from collections.abc import Sequence

import numpy as np

from hil_bridge.record.records import TruthRecord
from hil_bridge.record.removed_map import RemovedMap
from hil_bridge.show.charts.sources import Array
from hil_bridge.show.charts.surface import touches
from hil_bridge.show.pages.svg import VIRIDIS, Frame, drawing, image, scale_bar, scale_colours, text

WIDTH_PX = 1000
_MAP_PX = (120, 520)
"""Least and most height of the map."""
_LEFT, _RIGHT, _TOP, _BELOW = 60, 110, 26, 40
"""Room around it, px."""
_PLACES_MOST = 4000
"""Places of the path that are drawn."""


def removed_drawing(removed: RemovedMap, truths: Sequence[TruthRecord]) -> str:
    """The drawing."""
    depths, step = removed.depths, removed.spacing_m * 1e3
    rows, columns = depths.shape
    along, across = (1e3 * place for place in removed.corner_m)
    x = along - step / 2, along + (rows - 0.5) * step
    y = across - step / 2, across + (columns - 0.5) * step
    width = WIDTH_PX - _LEFT - _RIGHT
    height = width * columns / rows
    if height > _MAP_PX[1]:  # equal scales
        width, height = _MAP_PX[1] * rows / columns, float(_MAP_PX[1])
    height = max(height, float(_MAP_PX[0]))
    frame = Frame((_LEFT, _TOP, width, height), x, y)
    most = max(float(depths.max()), 1e-9)
    pixels = scale_colours(depths.T[::-1] / most, VIRIDIS)
    title = "removed depth; the line is the path of the tool while it touched"
    frame.axes("path coordinate, mm", "left of the path, mm")
    frame.parts.append(text((_LEFT, 15), title, colour="text", bold=True))
    frame.parts.append(image(pixels, (_LEFT, _TOP, width, height)))
    if len(truths):
        touching = np.array([touches(truth) for truth in truths])
        places = _on_map(np.array([truth.position for truth in truths]), removed) * 1e3
        places[:, ~touching] = math.nan  # what lies between two strokes is not drawn
        thin = places[:, :: max(1, -(-places.shape[1] // _PLACES_MOST))]
        frame.path(thin.T.tolist(), "#ffffff", 1.0)
    bar = scale_bar((_LEFT + width + 12, _TOP, height), VIRIDIS, (0.0, most), "µm")
    return drawing(
        (WIDTH_PX, _TOP + height + _BELOW), [*frame.parts, bar], "What the tool removed from the surface"
    )


def _on_map(positions: Array, removed: RemovedMap) -> Array:
    """Path coordinate and distance to the left (2, n), m, of positions (n, 3) in the base frame, m."""
    from_corner = positions[:, :2] - np.array(removed.origin_m)
    dx, dy = removed.direction
    along, across = removed.corner_m
    return np.stack((along + from_corner @ np.array([dx, dy]), across + from_corner @ np.array([-dy, dx])))
