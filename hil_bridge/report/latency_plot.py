"""The hops between a force and the motion that answers it, laid end to end."""

import io
from itertools import cycle
from typing import TYPE_CHECKING

from hil_bridge.analysis.latency import Latency, Part
from hil_bridge.facts import Owner
from hil_bridge.report.plots import STYLE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LATENCY_SIZE_PX = (1060, 300)
_DPI = 100
_COLOURS = {
    Owner.DEVICE: "#56B4E9",
    Owner.BUS: "#0072B2",
    Owner.SOFTWARE: "#CC79A7",
    Owner.LINE: "#E69F00",
    Owner.ROBOT: "#009E73",
}
"""Okabe-Ito, as in the picture of the run."""
_NAMED = 0.02
"""Share of the axis from which a hop is named above itself."""
_INSIDE = 0.12
"""Share of the axis from which a hop's name finds room in it."""
_LEVELS = (0.44, 0.72, 1.0)
"""Heights of the names above, in turn: three neighbours do not cover each other."""
_WHOLE = -0.55
_MOST = 2.0
"""Largest part of the whole on the axis, in sums of medians: an outlier must not flatten the hops."""


def draw_latency(latency: Latency) -> bytes:
    """The figure as PNG."""
    import matplotlib  # late, as for the picture
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(LATENCY_SIZE_PX[0] / _DPI, LATENCY_SIZE_PX[1] / _DPI), dpi=_DPI)
        figure.set_layout_engine("constrained", h_pad=0.08, w_pad=0.08)
        canvas = FigureCanvasAgg(figure)
        ax = figure.add_subplot()
        end = sum(part.times.p50_s for part in latency.chain) * 1e3
        limit = 1.04 * max(end, min(latency.total.p99_s * 1e3, _MOST * end), 1e-3)
        _draw_chain(ax, latency, limit)
        _mark_whole(ax, latency, limit)
        ax.set_xlim(-0.02 * limit, limit)
        ax.set_ylim(-1.0, 1.35)
        ax.set_yticks([])
        ax.spines["left"].set_visible(False)
        ax.grid(axis="y", visible=False)
        ax.set_xlabel(f"{latency.name}: medians of the hops, ms")
        patches = [
            Patch(color=_COLOURS[owner], label=f"{owner} {seconds * 1e3:.1f} ms")
            for owner, seconds in by_owner(latency).items()
        ]
        ax.legend(
            handles=patches, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(patches), frameon=False
        )
        buffer = io.BytesIO()
        canvas.print_png(buffer, metadata={"Software": None})  # type: ignore[no-untyped-call]
    return buffer.getvalue()


def by_owner(latency: Latency) -> dict[Owner, float]:
    """Sum of the medians of each owner's hops, s, in order of appearance."""
    sums: dict[Owner, float] = {}
    for part in latency.chain:
        sums[part.hop.owner] = sums.get(part.hop.owner, 0.0) + part.times.p50_s
    return sums


def _draw_chain(ax: "Axes", latency: Latency, limit: float) -> None:
    """The hops at their medians, one behind the other."""
    begin, levels = 0.0, cycle(_LEVELS)
    for part in latency.chain:
        width = part.times.p50_s * 1e3
        ax.barh(
            0.0, width, left=begin, height=0.62, color=_COLOURS[part.hop.owner], edgecolor="white", lw=1.0
        )
        middle = begin + width / 2
        if width > _INSIDE * limit:
            ax.text(middle, 0.0, _words(part), ha="center", va="center", color="black")
        elif width > _NAMED * limit:
            ax.annotate(
                _words(part).replace("\n", " "),
                (middle, 0.32),
                xytext=(middle, next(levels)),
                ha="center",
                va="bottom",
                arrowprops={"arrowstyle": "-", "color": "#808080", "lw": 0.8},
            )
        begin += width


def _words(part: Part) -> str:
    return f"{part.hop.name.replace('_', ' ')}\n{part.times.p50_s * 1e3:.1f} ms"


def _mark_whole(ax: "Axes", latency: Latency, limit: float) -> None:
    """Percentiles of the whole below the hops; they are no sums of those of the hops."""
    whole = latency.total
    percentiles = {"p50": whole.p50_s * 1e3, "p90": whole.p90_s * 1e3, "p99": whole.p99_s * 1e3}
    low, high = percentiles["p50"], min(percentiles["p99"], limit)
    ax.plot([low, high], [_WHOLE, _WHOLE], color="#404040", lw=1.2)
    for at in percentiles.values():
        if at < limit:
            ax.plot([at], [_WHOLE], marker="|", ms=11, mew=1.6, color="#404040")
    left = low > limit / 2
    ax.annotate(
        "the whole: " + ", ".join(f"{name} {at:.0f}" for name, at in percentiles.items()) + " ms",
        (low, _WHOLE),
        xytext=(-10, 0) if left else (0, -14),
        textcoords="offset points",
        ha="right" if left else "left",
        va="center",
        color="#404040",
    )
