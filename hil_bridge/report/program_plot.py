"""A program in pictures: its path from above with the error of the force, its feed, and the normal that it found."""

import io
import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hil_bridge.analysis.strokes import TRACK
from hil_bridge.control.analysis.merit import RISE_FRACTION
from hil_bridge.recording.reader import Recording
from hil_bridge.recording.records import CycleRecord
from hil_bridge.report.plots import STYLE
from hil_bridge.report.step_marks import mark_steps

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array: TypeAlias = NDArray[np.float64]

WIDTH_PX = 1000
_TIME_PX = 230
"""Height of a picture over time."""
_MAP_PX = (260, 700)
"""Least and most height of the path from above."""
_BESIDE_MAP_PX, _BELOW_MAP_PX = 210, 110
"""Width and height that the labels and the scale of the path take."""
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
_DPI = 100
_BLUE, _PURPLE, _GREEN, _GREY = "#0072B2", "#CC79A7", "#009E73", "#b0b0b0"
FEED, SIGMA, NORMALS = "feed", "normal_sigma_deg", ("normal_x_deg", "normal_y_deg")
"""Names in a cycle's explanation."""


class Panel(NamedTuple):
    """One of the pictures."""

    height: int
    draw: Callable[["Axes"], None]
    timed: bool
    """Its horizontal axis is the time."""


def draw_program(recording: Recording, zero: float) -> tuple[bytes, tuple[int, int]] | None:
    """The pictures that there are, one above the other, as PNG, and their width and height; None where there is none.
    `zero` is the start of the times, s on the run's clock.
    """
    panels = _panels(recording, zero)
    if not panels:
        return None
    import matplotlib  # late, as for the picture
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    heights = [panel.height for panel in panels]
    size = WIDTH_PX, sum(heights)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(size[0] / _DPI, size[1] / _DPI), dpi=_DPI)
        figure.set_layout_engine("constrained", h_pad=0.08, w_pad=0.08)
        canvas = FigureCanvasAgg(figure)
        grid = figure.add_gridspec(len(heights), 1, height_ratios=heights)
        last = recording.cycles[-1].controlled_at - zero
        for row, panel in enumerate(panels):
            ax = figure.add_subplot(grid[row])
            panel.draw(ax)
            if panel.timed:
                mark_steps(ax, recording.steps, zero, named=row == 0 or not panels[row - 1].timed)
                ax.set_xlim(0.0, 1.005 * last if last > 0.0 else 1.0)
                ax.tick_params(labelbottom=row == len(panels) - 1)
                if row == len(panels) - 1:
                    ax.set_xlabel("time since the run began, s")
        buffer = io.BytesIO()
        canvas.print_png(buffer, metadata={"Software": None})  # type: ignore[no-untyped-call]
    return buffer.getvalue(), size


def _panels(recording: Recording, zero: float) -> list[Panel]:
    cycles = recording.cycles
    panels = []
    x, y = (1e3 * _column(cycles, name) for name in ("travel_commanded", "across_commanded"))
    pressing = np.array([presses(cycle) for cycle in cycles])
    if pressing.any() and (np.ptp(x) > 0.0 or np.ptp(y) > 0.0):
        box = _box(x, y)
        error = _column(cycles, "force") - _column(cycles, "force_reference")
        panels.append(
            Panel(_map_height(box), lambda ax: _draw_path(ax, recording, (x, y, error), pressing, box), False)
        )
    time = _column(cycles, "controlled_at") - zero
    told = [cycle.explanation.get(FEED) for cycle in cycles]
    if any(feed is not None for feed in told):
        # the feed is told where it is not whole
        tracks = {step.step for step in recording.steps if "(track" in step.label}
        feeds = np.array(
            [
                feed
                if feed is not None
                else 1.0
                if cycle.phase == TRACK and cycle.step in tracks
                else math.nan
                for cycle, feed in zip(cycles, told, strict=True)
            ]
        )
        panels.append(Panel(_TIME_PX, lambda ax: _draw_feed(ax, time, feeds), True))
    if any(SIGMA in cycle.explanation for cycle in cycles):
        panels.append(Panel(_TIME_PX, lambda ax: _draw_normal(ax, time, cycles), True))
        panels.append(Panel(_TIME_PX, lambda ax: _draw_sigma(ax, time, cycles), True))
    return panels


def presses(cycle: CycleRecord) -> bool:
    """Whether the force was controlled."""
    return cycle.phase == TRACK and math.isfinite(cycle.force)


def _column(cycles: Sequence[CycleRecord], name: str) -> Array:
    return np.array([getattr(cycle, name) for cycle in cycles], dtype=np.float64)


def _explained(cycles: Sequence[CycleRecord], name: str) -> Array:
    """A value of the explanation; NaN where it is not told or the force was not controlled."""
    return np.array(
        [cycle.explanation.get(name, math.nan) if presses(cycle) else math.nan for cycle in cycles]
    )


def _box(x: Array, y: Array) -> tuple[float, float, float, float]:
    """Least and most x, least and most y that are shown, mm."""
    edges = []
    widest = max(float(np.ptp(x)), float(np.ptp(y)))
    for values in (x, y):
        span = max(float(np.ptp(values)), _LEAST_SPAN_MM, 0.04 * widest)
        middle = (float(values.min()) + float(values.max())) / 2
        half = span / 2 + _ROOM * max(span, 0.25 * widest)
        edges += [middle - half, middle + half]
    return edges[0], edges[1], edges[2], edges[3]


def _map_height(box: tuple[float, float, float, float]) -> int:
    """Height that shows the path with equal scales, within bounds."""
    left, right, low, high = box
    least, most = _MAP_PX
    wanted = round((WIDTH_PX - _BESIDE_MAP_PX) * (high - low) / (right - left)) + _BELOW_MAP_PX
    return min(max(wanted, least), most)


def _draw_path(
    ax: "Axes",
    recording: Recording,
    values: tuple[Array, Array, Array],
    pressing: NDArray[np.bool_],
    box: tuple[float, float, float, float],
) -> None:
    from matplotlib.collections import LineCollection

    x, y, error = values
    ax.plot(x, y, color=_GREY, lw=0.9, ls="--", zorder=1.5, label="in free space")
    places = np.stack((x, y), axis=1)
    joined = pressing[:-1] & pressing[1:] & (np.hypot(np.diff(x), np.diff(y)) < _CUT_MM)
    wanted = float(np.max(np.abs(_column(recording.cycles, "force_reference")[pressing])))
    risen = np.abs(error[_risen(recording.cycles)])
    shown = float(np.percentile(risen, _SHOWN_PERCENT)) if risen.size else 0.0
    most = max(shown, _LEAST_ERROR * wanted, 1e-3)
    lines = LineCollection(
        list(np.stack((places[:-1], places[1:]), axis=1)[joined]),
        cmap="coolwarm",
        linewidths=3.5,
        capstyle="round",
        zorder=2.0,
    )
    lines.set_array(error[:-1][joined])
    lines.set_clim(-most, most)
    ax.add_collection(lines)
    _number_strokes(ax, recording, x, y)
    ax.set_xlim(*box[:2])
    ax.set_ylim(*box[2:])
    ax.set_aspect("equal")
    ax.set_xlabel("x from the start point, mm")
    ax.set_ylabel("y, mm")
    ax.set_title("path from above, and error of the force on it", loc="left", fontsize=10)
    if not pressing.all():
        ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2, frameon=False)
    figure = ax.get_figure()
    assert figure is not None
    figure.colorbar(
        lines, ax=ax, label="force − wanted force, N", pad=0.015, fraction=0.05, aspect=14, extend="both"
    )


def _risen(cycles: Sequence[CycleRecord]) -> NDArray[np.bool_]:
    """Samples in which the force had come up to what was wanted since the touch."""
    risen, found = False, []
    for cycle in cycles:
        risen = presses(cycle) and (risen or cycle.force >= RISE_FRACTION * cycle.force_reference)
        found.append(risen)
    return np.array(found, dtype=np.bool_)


def _number_strokes(ax: "Axes", recording: Recording, x: Array, y: Array) -> None:
    """A dot with the step's number where each track begins, and at each hold; of a repeat, at its first pass alone."""
    seen: set[str] = set()
    first = {cycle.step: place for place, cycle in reversed(list(enumerate(recording.cycles)))}
    for step in recording.steps:
        number = step.label.split(" ", 1)[0]
        if (
            not any(word in step.label for word in ("(track", "(hold"))
            or number in seen
            or step.step not in first
        ):
            continue
        seen.add(number)
        place = first[step.step]
        ax.plot(x[place], y[place], marker="o", ms=6, color="black", mfc="white", zorder=3.0)
        ax.annotate(
            number,
            (x[place], y[place]),
            xytext=(6, 6),
            textcoords="offset points",
            fontweight="bold",
            zorder=3.0,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.8},
        )


def _draw_feed(ax: "Axes", time: Array, feeds: Array) -> None:
    ax.axhline(100.0, color="#808080", lw=0.8)
    ax.step(time, 100.0 * feeds, where="post", color=_PURPLE, lw=1.4)
    ax.set_ylim(min(0.0, 110.0 * float(np.nanmin(feeds))), 125.0)
    ax.set_ylabel("feed, %")
    ax.set_title("feed: share of the step's own speed along its path", loc="left", fontsize=10)


def _draw_normal(ax: "Axes", time: Array, cycles: Sequence[CycleRecord]) -> None:
    sigma = _explained(cycles, SIGMA)
    for name, axis, colour in zip(NORMALS, "xy", (_BLUE, _GREEN), strict=True):
        angle = _explained(cycles, name)
        ax.fill_between(time, angle - 2 * sigma, angle + 2 * sigma, color=colour, alpha=0.2, linewidth=0)
        ax.plot(time, angle, color=colour, lw=1.3, label=f"along {axis}")
    shown = np.concatenate([_explained(cycles, name) for name in NORMALS])
    low, high = float(np.nanmin(shown)), float(np.nanmax(shown))
    room = max(0.3 * (high - low), 1.0, 2.5 * float(np.nanmedian(sigma)))
    ax.set_ylim(low - room, high + room)
    ax.set_ylabel("angle, °")
    ax.set_title("estimated fall of the surface, ± 2 standard deviations", loc="left", fontsize=10)
    ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2, ncols=2, frameon=False)


def _draw_sigma(ax: "Axes", time: Array, cycles: Sequence[CycleRecord]) -> None:
    ax.plot(time, _explained(cycles, SIGMA), color=_PURPLE, lw=1.3)
    ax.set_ylim(bottom=0.0)
    ax.set_ylabel("standard\ndeviation, °")
    ax.set_title("uncertainty of the normal", loc="left", fontsize=10)
