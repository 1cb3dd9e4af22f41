"""Maps drawn with matplotlib, with the same description and colours as on pages (`pages/maps.py`)."""

from typing import TYPE_CHECKING

import numpy as np

from hil_bridge.show.charts.painter import sheet_colour
from hil_bridge.show.pages.description import Map, Trace, room_of
from hil_bridge.show.pages.svg import PALETTES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap


def paint_map(ax: "Axes", drawn: Map, width_px: float) -> None:
    """Draw one map within the given width."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    scale, palette = drawn.scale, _palette(drawn.scale.palette)
    _, _, y = room_of(drawn, width_px)
    if drawn.grid is not None:
        ax.imshow(
            np.array(drawn.grid.rows, dtype=np.float64),
            cmap=palette,
            vmin=scale.low,
            vmax=scale.high,
            origin="lower",
            extent=(*drawn.x, *drawn.y),
            interpolation="nearest",
        )
    for trace in drawn.traces:
        _paint_trace(ax, trace, drawn)
    for spot in drawn.spots:
        ax.plot([spot.x], [spot.y], "o", color=sheet_colour("text"), ms=5)
        ax.annotate(
            spot.text,
            (spot.x, spot.y),
            xytext=(6, 5),
            textcoords="offset points",
            fontweight="bold",
            parse_math=False,
        )
    ax.set_xlim(*drawn.x)
    ax.set_ylim(*y)
    ax.set_aspect("equal", anchor="W")
    ax.grid(drawn.grid is None)
    ax.set_xlabel(drawn.x_label)
    ax.set_ylabel(drawn.y_label)
    ax.set_title(drawn.title, loc="left", fontsize=10.5, fontweight="bold").set_parse_math(False)
    figure = ax.get_figure(root=True)
    assert figure is not None
    values = ScalarMappable(Normalize(scale.low, scale.high), palette)
    figure.colorbar(values, ax=ax, label=scale.unit, fraction=0.05, pad=0.02)


def _paint_trace(ax: "Axes", trace: Trace, drawn: Map) -> None:
    from matplotlib.collections import LineCollection

    places = np.column_stack([np.array(values, dtype=np.float64) for values in (trace.x, trace.y)])
    if not trace.values:
        line_style = "--" if trace.dashed else "-"
        ax.plot(*places.T, line_style, color=sheet_colour(trace.colour), lw=trace.width * 0.85)
        return
    pieces = np.stack([places[:-1], places[1:]], axis=1)
    finite = np.isfinite(pieces).all(axis=(1, 2))
    lines = LineCollection(
        list(pieces[finite]),
        cmap=_palette(drawn.scale.palette),
        linewidths=trace.width * 0.85,
        capstyle="round",
    )
    lines.set_array(np.array(trace.values, dtype=np.float64)[:-1][finite])
    lines.set_clim(drawn.scale.low, drawn.scale.high)
    ax.add_collection(lines)


def _palette(name: str) -> "Colormap":
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list(
        name, [tuple(part / 255 for part in stop) for stop in PALETTES[name]]
    )
