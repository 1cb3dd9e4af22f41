"""Maps as SVG inside a page, with the same description as in pictures (`charts/map_painter.py`)."""

from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from hil_bridge.show.pages.description import Map, Trace, room_of
from hil_bridge.show.pages.svg import (
    PALETTES,
    Frame,
    dot,
    drawing,
    hexadecimal,
    image,
    scale_bar,
    scale_colours,
    text,
)

WIDTH_PX = 1000
_LEFT, _RIGHT, _TOP, _BELOW = 60, 110, 26, 44
"""Margins of a map, px."""
_SMALLEST = 0.8
"""Smallest size of a map beside another one, as a share of its full size. Chosen: its text stays legible."""


def map_row(maps: Iterable[Map]) -> str:
    """Render maps side by side where the page has room for them, otherwise one below the other."""
    fields = []
    for drawn in maps:
        width = _LEFT + room_of(drawn, WIDTH_PX - _LEFT - _RIGHT)[0] + _RIGHT
        style = f"flex: 1 1 {_SMALLEST * width:.0f}px; max-width: {width:.0f}px"
        fields.append(f'<div class="map" style="{style}">{map_svg(drawn)}</div>')
    return f'<div class="maps">{"".join(fields)}</div>' if fields else ""


def map_svg(drawn: Map) -> str:
    """Draw a map as SVG."""
    width, height, y = room_of(drawn, WIDTH_PX - _LEFT - _RIGHT)
    frame = Frame((_LEFT, _TOP, width, height), drawn.x, y)
    frame.axes(drawn.x_label, drawn.y_label)
    frame.parts.append(text((_LEFT, 15), drawn.title, colour="text", bold=True))
    scale = drawn.scale
    palette, low, high = PALETTES[scale.palette], scale.low, scale.high
    if drawn.grid is not None:
        shares = (np.array(drawn.grid.rows, dtype=np.float64) - low) / (high - low)
        top, bottom = (frame.y(value) for value in reversed(drawn.y))
        frame.parts.append(image(scale_colours(shares[::-1], palette), (_LEFT, top, width, bottom - top)))
    for trace in drawn.traces:
        _draw(frame, trace, drawn)
    for spot in drawn.spots:
        place = frame.x(spot.x), frame.y(spot.y)
        frame.parts.append(dot(place, 4, "text"))
        frame.parts.append(text((place[0] + 7, place[1] - 7), spot.text, colour="text", bold=True))
    bar = scale_bar((_LEFT + width + 12, _TOP, height), palette, (low, high), scale.unit)
    size = _LEFT + width + _RIGHT, _TOP + height + _BELOW
    return drawing(size, [*frame.parts, bar], drawn.title)


def _draw(frame: Frame, trace: Trace, drawn: Map) -> None:
    places = [
        (np.nan if x is None else x, np.nan if y is None else y)
        for x, y in zip(trace.x, trace.y, strict=True)
    ]
    if not trace.values:
        frame.path(places, trace.colour, trace.width, trace.dashed)
        return
    low, high = drawn.scale.low, drawn.scale.high
    shares = (np.array(trace.values, dtype=np.float64) - low) / (high - low)
    colours = scale_colours(np.nan_to_num(shares), PALETTES[drawn.scale.palette])
    for number, ends in enumerate(pairwise(places)):
        if np.isfinite(ends).all():
            frame.path(ends, hexadecimal(colours[number]), trace.width)
