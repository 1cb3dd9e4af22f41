"""Shared parts of browser pages: uPlot charts, style, and self-contained documents."""

from hil_bridge.show.pages.assets import asset, cell_script, chart_script, style
from hil_bridge.show.pages.description import (
    Axis,
    Band,
    Chart,
    Charts,
    Layer,
    Limit,
    Mark,
    Series,
    Source,
    Span,
)
from hil_bridge.show.pages.document import cell_room, document, in_script, room, skeleton

__all__ = [
    "Axis",
    "Band",
    "Chart",
    "Charts",
    "Layer",
    "Limit",
    "Mark",
    "Series",
    "Source",
    "Span",
    "asset",
    "cell_room",
    "cell_script",
    "chart_script",
    "document",
    "in_script",
    "room",
    "skeleton",
    "style",
]
