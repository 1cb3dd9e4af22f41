"""Picture of a run: stacked charts, with the figures below."""

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from msgspec import structs

from hil_bridge.errors import ConfigError
from hil_bridge.record.analysis.summary import Summary, target_force_text
from hil_bridge.record.reader import Recording
from hil_bridge.show.charts.map_painter import paint_map
from hil_bridge.show.charts.maps import maps_of
from hil_bridge.show.charts.painter import GREY, STYLE, paint
from hil_bridge.show.charts.run import run_charts
from hil_bridge.show.pages.description import Chart, Charts
from hil_bridge.show.picture_files import drawing_library, save_figure
from hil_bridge.show.report.figures import Row, figure_tables

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.gridspec import GridSpec

WIDTH_PX = 1400
_FIGURES_PX, _TITLE_PX, _MAPS_PX, _AXIS_PX = 330, 60, 460, 40
_DPI = 100


def draw(recording: Recording, summary: Summary, kind: str = "png") -> bytes:
    """Render the picture as PNG or PDF. Equal recordings give equal bytes with the same matplotlib version.

    Raises ConfigError if matplotlib is not installed.
    """
    matplotlib = drawing_library()
    charts = run_charts(recording)
    maps = maps_of(recording)
    with matplotlib.rc_context(STYLE):
        maps_px = [_MAPS_PX] if maps else []
        figure, grid = _figure(charts.charts, [*maps_px, _FIGURES_PX], _TITLE_PX)
        title = recording.foreign.file if recording.foreign else _title(summary)
        figure.suptitle(title, fontsize=15, fontweight="bold", parse_math=False)
        _paint_charts(figure, grid, charts)
        heights = charts.charts
        for place, drawn in enumerate(maps):
            map_grid = grid[len(heights)].subgridspec(1, len(maps))
            paint_map(figure.add_subplot(map_grid[place]), drawn, WIDTH_PX / len(maps))
        _draw_tables(figure.add_subplot(grid[-1]), figure_tables(recording, summary))
        return save_figure(figure, kind)


def plot(recording: Recording, names: Sequence[str] = ()) -> "Figure":
    """Return the stacked charts of a run, either all or those with these ids, as a matplotlib figure.

    Raises ConfigError for an id that no chart of this run has, and if matplotlib is not installed.
    """
    matplotlib = drawing_library()
    charts = run_charts(recording)
    there = {chart.id: chart for chart in charts.charts}
    for name in names:
        if name not in there:
            raise ConfigError(f"unknown chart {name!r}; this run has {', '.join(there)}")
    chosen = structs.replace(charts, charts=[there[name] for name in names or there])
    with matplotlib.rc_context(STYLE):
        figure, grid = _figure(chosen.charts, [], 0)
        _paint_charts(figure, grid, chosen)
    return figure


def _figure(charts: Sequence[Chart], more_px: Sequence[int], title_px: int) -> tuple["Figure", "GridSpec"]:
    """Create a figure with one row per chart, and below them rows of these heights, px."""
    from hil_bridge.show.report.run_figure import RunFigure

    ratios = [*(chart.height_px + _AXIS_PX for chart in charts), *more_px]
    figure = RunFigure((WIDTH_PX / _DPI, (sum(ratios) + title_px) / _DPI), _DPI)
    return figure, figure.add_gridspec(len(ratios), 1, height_ratios=ratios)


def _paint_charts(figure: "Figure", grid: "GridSpec", charts: Charts) -> None:
    """Draw the charts in the first rows of the grid, over one time axis."""
    first = figure.add_subplot(grid[0])
    rows = range(1, len(charts.charts))
    axes = [first, *(figure.add_subplot(grid[row], sharex=first) for row in rows)]
    ends = [span.end for span in charts.spans]
    xs = [x for source in charts.sources.values() for x in (source["x"][0], source["x"][-1]) if source["x"]]
    ends += [x for x in xs if x is not None]
    if ends and max(ends) > 0.0:
        first.set_xlim(0.0, 1.005 * max(ends))
    for ax, chart in zip(axes, charts.charts, strict=True):
        paint(ax, chart, charts)
        ax.tick_params(labelbottom=ax is axes[-1])
    axis = charts.axes["time"]
    axes[-1].set_xlabel(f"{axis.label}, {axis.unit}")


def _title(summary: Summary) -> str:
    target, what = target_force_text(summary), summary.controller or "run"
    if target:
        what += f" at {target}"
    text = f"{what} – {summary.outcome}" + (f": {summary.text}" if summary.text else "")
    return textwrap.shorten(text, 110, placeholder=" …")


def _draw_tables(ax: "Axes", tables: Sequence[tuple[str, Sequence[Row]]]) -> None:
    ax.axis("off")
    lines = max(len(rows) for _, rows in tables) + 1
    for at, (title, rows) in zip((0.0, 0.51), tables, strict=True):
        ax.text(at, 1.0, title, transform=ax.transAxes, va="top", fontweight="bold", parse_math=False)
        for number, row in enumerate(rows, start=1):
            y = 1.0 - number / lines
            place: dict[str, Any] = {"transform": ax.transAxes, "va": "top", "parse_math": False}
            ax.text(at, y, row.label, **place)
            ax.text(at + 0.262, y, row.value, ha="right", fontweight="bold", **place)
            ax.text(at + 0.272, y, row.explanation, color=GREY, size=7.5, **place)
