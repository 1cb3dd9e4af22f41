"""Line charts of the lab as files: panels in a common style, reproducible byte for byte."""

import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from hil_bridge.show.charts.painter import STYLE
from hil_bridge.show.picture_files import drawing_library, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Okabe-Ito colours: distinguishable with every common kind of colour blindness.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#8C6D31", "#808080")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", ".")
_WIDTH, _HEIGHT = 4.6, 3.4
"""Width and height of one panel, inches. Chosen."""
_STYLE: dict[Any, Any] = {
    **STYLE,
    "axes.titlesize": 10.5,
    "legend.frameon": False,
    "svg.hashsalt": "hil-bridge",
}


class Line(NamedTuple):
    """One line of a panel: the values of one column over rows."""

    column: str
    label: str
    rows: Sequence[Mapping[str, Any]]
    joined: bool = True
    """Whether the points are joined by a line."""


class Panel(NamedTuple):
    """One pair of axes with its lines."""

    title: str
    x: tuple[str, str]
    """Column with the x values of every line, and label of the x axis."""
    y_label: str
    lines: Sequence[Line]
    target: float | None = None
    """y value to be marked by a dashed line."""
    log: bool = False
    """Whether both axes are logarithmic."""


def lines_by(rows: Sequence[Mapping[str, Any]], key: str, column: str, label: str = "{}") -> list[Line]:
    """Return one line of `column` for each value of `key`. `label` is a format string for the value."""
    values = dict.fromkeys(row[key] for row in rows)
    return [Line(column, label.format(value), [row for row in rows if row[key] == value]) for value in values]


def draw(panels: Sequence[Panel], columns: int, kind: str = "png") -> bytes:
    """Draw the panels in `columns` columns, as `png`, `pdf` or `svg`.

    With the same version of matplotlib, identical panels give identical bytes.
    """
    matplotlib = drawing_library()  # imported late, because the command line imports this package
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = -(-len(panels) // columns)
    with matplotlib.rc_context(_STYLE):
        size = max(2, columns) * _WIDTH, rows * _HEIGHT + 0.8
        figure = Figure(figsize=size, dpi=100, layout="constrained")
        FigureCanvasAgg(figure)
        for ax, panel in zip(figure.subplots(rows, columns, squeeze=False).flat, panels, strict=True):
            _draw_panel(ax, panel)
        labels: dict[str, Any] = {}
        for ax in figure.axes:
            handles, names = ax.get_legend_handles_labels()
            labels |= dict(zip(names, handles, strict=True))
        figure.legend(labels.values(), list(labels), loc="outside lower center", ncols=3)
        drawn = save_figure(figure, kind)
    return _with_palette(drawn) if kind == "png" else drawn


def _with_palette(png: bytes) -> bytes:
    """Reduce the colours of a PNG to a palette.

    Line charts are stored with the documentation, and a palette reduces their size to a third.
    """
    from PIL import Image  # comes with matplotlib

    buffer = io.BytesIO()
    picture = Image.open(io.BytesIO(png)).convert("RGB").quantize(128, dither=Image.Dither.NONE)
    picture.save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def _draw_panel(ax: "Axes", panel: Panel) -> None:
    column, label = panel.x
    for place, line in enumerate(panel.lines):
        known = [row for row in line.rows if row[column] is not None and row[line.column] is not None]
        ax.plot(
            [row[column] for row in known],
            [row[line.column] for row in known],
            color=COLOURS[place % len(COLOURS)],
            marker=MARKERS[place % len(MARKERS)],
            ms=3.5,
            lw=1.2 if line.joined else 0.0,
            label=line.label,
        )
    if panel.target is not None:
        ax.axhline(panel.target, color="black", lw=1.0, ls="--")
    if panel.log:
        ax.set_xscale("log")
        ax.set_yscale("log", nonpositive="mask")
    ax.set_title(panel.title)
    ax.set_xlabel(label)
    ax.set_ylabel(panel.y_label)
