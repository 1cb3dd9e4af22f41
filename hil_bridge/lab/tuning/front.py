"""The trade-off of two figures: the points of which none is better in both, as a table and as a picture."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from hil_bridge.errors import ConfigError
from hil_bridge.lab.tuning.evaluating import Worth
from hil_bridge.lab.tuning.space import Space
from hil_bridge.record.analysis.figures import FIGURES
from hil_bridge.show.picture_files import drawing_library, save_figure

PICTURES = (".svg", ".png")


def front(tried: Sequence[Worth], first: str, second: str) -> list[Worth]:
    """The points that no other beats in both figures, by the first figure. Those that failed do not count."""
    found = [
        one for one in tried if one.feasible and one.mean(first) is not None and one.mean(second) is not None
    ]
    found.sort(key=lambda one: (one.mean(first), one.mean(second)))
    kept: list[Worth] = []
    least = float("inf")
    for one in found:
        value = one.mean(second)
        assert value is not None
        if value < least:
            kept.append(one)
            least = value
    return kept


def describe_front(points: Sequence[Worth], space: Space, first: str, second: str) -> Iterator[str]:
    """Lines for people."""
    yield "  ".join((f"{first:>22}", f"{second:>22}", *(f"{name:>18}" for name in space.names)))
    for one in points:
        figures = (f"{one.mean(name):.4g} ± {one.spread(name):.2g}" for name in (first, second))
        yield "  ".join((*(f"{text:>22}" for text in figures), *(f"{value:>18.4g}" for value in one.point)))


def check_picture(place: Path) -> None:
    """Raise ConfigError for a file that can hold no picture, and where matplotlib is not installed."""
    if place.suffix not in PICTURES:
        raise ConfigError(f"{place}: a picture's name ends in {' or '.join(PICTURES)}")
    drawing_library()


def picture(
    tried: Sequence[Worth], defaults: Worth, best: Worth | None, axes: tuple[str, str], kind: str
) -> bytes:
    """All points, the front, the defaults and the best, as SVG or PNG (`kind` without a dot)."""
    matplotlib = drawing_library()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    first, second = axes
    with matplotlib.rc_context({"svg.hashsalt": "hil-bridge", "font.size": 10.0}):
        figure = Figure(figsize=(7.0, 5.0), layout="constrained")
        FigureCanvasAgg(figure)
        plot = figure.add_subplot()
        good = [one for one in tried if one.feasible]
        _dots(plot, good, axes, _Look("points tried", "0.7", "o"))
        edge = front(tried, first, second)
        plot.plot(
            [one.mean(first) or 0.0 for one in edge],
            [one.mean(second) or 0.0 for one in edge],
            "o-",
            color="C0",
            zorder=4,
            label="front",
        )
        _dots(plot, [defaults], axes, _Look("defaults", "C3", "s"))
        _dots(plot, [] if best is None else [best], axes, _Look("chosen", "C2", "*"))
        plot.set_xlabel(FIGURES[first].title)
        plot.set_ylabel(FIGURES[second].title)
        plot.set_title(f"{len(tried)} points, {len(tried) - len(good)} of them failed")
        plot.legend()
        return save_figure(figure, kind, dpi=120)


class _Look(NamedTuple):
    label: str
    colour: str
    marker: str


def _dots(plot, points, axes, look) -> None:  # type: ignore[no-untyped-def]
    """Dots with the spread over the seeds."""
    known = [one for one in points if all(one.mean(name) is not None for name in axes)]
    if known:
        plot.errorbar(
            [one.mean(axes[0]) for one in known],
            [one.mean(axes[1]) for one in known],
            xerr=[one.spread(axes[0]) for one in known],
            yerr=[one.spread(axes[1]) for one in known],
            fmt=look.marker,
            color=look.colour,
            elinewidth=0.5,
            markersize=12.0 if look.marker == "*" else 6.0,
            zorder=2 if look.marker == "o" else 6,
            label=look.label,
        )
