"""Charts drawn with matplotlib, with the same description, colours and scales as in a browser (`charts.js`)."""

import math
import re
from collections.abc import Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hil_bridge.show.pages.assets import asset
from hil_bridge.show.pages.description import Chart, Charts, Limit, Mark, Series, Span, Values

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array: TypeAlias = NDArray[np.float64]

STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 10.0,
    "axes.grid": True,
    "grid.color": "#d8d8d8",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.fontsize": 9.0,
}
"""Style of every picture."""
GREY = "#606060"
ROOM_FROM = 0.5
"""Share of a limit from which a chart extends its range to include the limit. Chosen: a distant line would flatten
the values.
"""
_ROOM = 0.08
"""Margin above and below the values, as a share of their span. The value is the same in `charts.js`."""
_TITLE_ENTRIES_MAX = 3
"""Maximum number of legend entries next to the title; above this number, the title is above the legend. Chosen."""
_LOUD = ("stop", "fault", "note")
_SPANS_MAX = 200
"""Maximum number of spans that are drawn. Chosen: the borders of more spans would cover the curves."""
_LETTER_PX = 7.6
_DOTS_MOST = 400
"""Maximum number of samples that are drawn as dots. Chosen: more dots would merge."""


def y_range(chart: Chart, low: float, high: float) -> tuple[float, float]:
    """Return the y range of a chart whose values lie between `low` and `high`; `charts.js` has the same rule."""
    if chart.log:
        return 10.0 ** math.floor(math.log10(low)), 10.0 ** math.ceil(math.log10(high * 1.0001))
    for limit in chart.limits:
        if limit.shown or _near(limit, low, high):
            low, high = min(low, limit.value), max(high, limit.value)
    if chart.zero:
        low, high = min(low, 0.0), max(high, 0.0)
    least = max(chart.least_span - (high - low), abs(high) * 0.1 or 1.0 if high == low else 0.0)
    if least > 0.0:
        low, high = low - least / 2, high + least / 2
    room = (high - low) * _ROOM
    return (
        0.0 if chart.zero and low == 0.0 else low - room,
        0.0 if chart.zero and high == 0.0 else high + room,
    )


def _near(limit: Limit, low: float, high: float) -> bool:
    share = ROOM_FROM * limit.value
    return limit.kind == "limit" and (high >= share if limit.value > 0.0 else low <= share)


def paint(ax: "Axes", chart: Chart, charts: Charts) -> None:
    """Draw one chart. Only the first chart of a page shows the names of spans and the texts of marks."""
    first = chart is charts.charts[0]
    _paint_spans(ax, [one for one in charts.spans if one.axis == chart.axis], named=first)
    drawn: list[Array] = []
    for band in chart.bands:
        x, low, high = (_values(charts.sources[band.source], name) for name in ("x", band.low, band.high))
        ax.fill_between(
            x, low, high, color=colour(band.colour), alpha=0.5, lw=0.4, label=band.label, zorder=1.5
        )
        drawn += [low, high]
    for series in chart.series:
        x, y = (_values(charts.sources[series.source], name) for name in ("x", series.column))
        _paint_series(ax, series, x, y)
        drawn.append(y)
    for limit in chart.limits:
        shade = colour("target" if limit.kind == "target" else "limit")
        text = f"{limit.label} {limit.value:.5g}"
        ax.axhline(limit.value, color=shade, lw=1.1, ls=":" if limit.kind == "target" else "--", zorder=1.8)
        ax.annotate(
            text,
            (1.0, limit.value),
            xycoords=ax.get_yaxis_transform(),
            xytext=(-4, 2),
            textcoords="offset points",
            ha="right",
            color=shade,
            fontsize=8.5,
            annotation_clip=True,
            parse_math=False,
        )
    _paint_marks(ax, [one for one in charts.marks if one.axis == chart.axis], named=first)
    limits = "".join(f" · {limit.label} {limit.value:.5g}" for limit in chart.limits)
    entries = len(chart.series) + len(chart.bands)
    heading, pad = chart.title + limits.replace("-", "−"), 20.0 if entries > _TITLE_ENTRIES_MAX else 6.0
    title = ax.set_title(heading, loc="left", pad=pad, fontsize=10.5, fontweight="bold")
    title.set_parse_math(False)
    ax.set_ylabel(chart.unit)
    if chart.log:
        ax.set_yscale("log")
    _set_range(ax, chart, drawn)
    if entries > 1:
        ax.legend(loc="lower right", bbox_to_anchor=(1.0, 0.985), borderaxespad=0.0, ncols=5, frameon=False)


def _paint_series(ax: "Axes", series: Series, x: Array, y: Array) -> None:
    style: dict[str, Any] = {"color": colour(series.colour), "label": series.label, "zorder": 2.5}
    width = series.width * 0.85
    match series.style:
        case "points":
            ax.plot(x, y, ls="none", marker="v", ms=6, mfc="none", **style)
        case "bars":
            ax.vlines(x, 0.0, y, lw=width, **style)
        case "step":
            ax.step(x, y, where="post", lw=width, ls="--" if series.dashed else "-", **style)
        case _:
            marker = "." if np.isfinite(y).sum() <= _DOTS_MOST else ""
            ax.plot(x, y, lw=width, ls="--" if series.dashed else "-", marker=marker, ms=4, **style)


def _set_range(ax: "Axes", chart: Chart, drawn: Sequence[Array]) -> None:
    known = [values[np.isfinite(values) & ((values > 0.0) | (not chart.log))] for values in drawn]
    values = np.concatenate(known) if known else np.empty(0)
    if values.size:
        ax.set_ylim(*y_range(chart, float(values.min()), float(values.max())))


def _paint_spans(ax: "Axes", spans: Sequence[Span], named: bool) -> None:
    extent = max((span.end for span in spans), default=0.0) - min((span.begin for span in spans), default=0.0)
    if len(spans) > _SPANS_MAX:
        return
    figure = ax.get_figure(root=True)
    wide = figure.get_size_inches()[0] * figure.dpi if figure else 1.0
    for span in spans:
        shade, alpha = _translucent(f"--span-{span.kind or 'other'}")
        ax.axvspan(span.begin, span.end, color=shade, alpha=alpha, lw=0, zorder=0)
        share = (span.end - span.begin) / (extent or 1.0)
        names = (span.text, span.short or span.text)
        fitting = [name for name in names if (len(name) + 1) * _LETTER_PX / wide <= share]
        if named and span.kind != "fault" and fitting:
            ax.text(
                (span.begin + span.end) / 2,
                0.985,
                fitting[0],
                transform=ax.get_xaxis_transform(),
                ha="center",
                va="top",
                color=GREY,
                parse_math=False,
            )


def _paint_marks(ax: "Axes", marks: Sequence[Mark], named: bool) -> None:
    row, middle = 0, sum(ax.get_xlim()) / 2
    for mark in marks:
        loud = mark.kind in _LOUD
        shade = _css().get(f"--mark-{mark.kind}", GREY)
        ax.axvline(mark.x, color=shade, lw=1.6 if loud else 0.7, ls="-" if loud else ":", zorder=1.9)
        if not (named and loud) or row > 4:
            continue
        late = mark.x > middle
        ax.annotate(
            mark.text if len(mark.text) < 90 else f"{mark.text[:89]}…",
            (mark.x, 0.04 + 0.09 * row),
            xycoords=ax.get_xaxis_transform(),
            xytext=(-6 if late else 6, 0),
            textcoords="offset points",
            ha="right" if late else "left",
            va="bottom",
            color=shade,
            fontsize=9,
            fontweight="bold",
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.0},
            parse_math=False,
        )
        row += 1


def _values(source: Mapping[str, Values], name: str) -> Array:
    return np.array(source.get(name, [math.nan] * len(source["x"])), dtype=np.float64)


def colour(name: str) -> str:
    """Return a colour of the light style sheet for a number from `1` to `8`, or for a role."""
    return _css().get(f"--c{name}" if name.isdecimal() else f"--c-{name}", _css()["--c1"])


def sheet_colour(name: str) -> str:
    """Return a colour of the light style sheet by the name of its variable; `#rrggbb` is returned unchanged."""
    return name if name.startswith("#") else _css()[f"--{name}"]


def _translucent(variable: str) -> tuple[str, float]:
    """Return a colour without its alpha channel, and its opacity, 0 … 1."""
    shade = _css().get(variable, _css()["--span-other"])
    return shade[:7], int(shade[7:9] or "ff", 16) / 255


@cache
def _css() -> Mapping[str, str]:
    """Return the colour variables of the light style sheet."""
    return dict(re.findall(r"(--[\w-]+):\s*(#[0-9a-f]+);", asset("pages.css").partition("@media")[0]))
