"""The trade-off of two figures: the points of which none is better in both, as a table and as a picture."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from hil_bridge.errors import ConfigError
from hil_bridge.lab.drawing import Line, Panel, draw
from hil_bridge.lab.tuning.evaluating import Worth
from hil_bridge.lab.tuning.space import Space
from hil_bridge.record.analysis.figures import FIGURES
from hil_bridge.show.picture_files import drawing_library

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
    first, second = axes
    good = [one for one in tried if one.feasible]
    shown = {
        "points tried": good,
        "front": front(tried, first, second),
        "defaults": [defaults],
        "chosen": [] if best is None else [best],
    }
    lines = [
        Line(second, label, [{name: one.mean(name) for name in axes} for one in points], label == "front")
        for label, points in shown.items()
    ]
    title = f"{len(tried)} points, {len(tried) - len(good)} of them failed"
    return draw([Panel(title, (first, FIGURES[first].title), FIGURES[second].title, lines)], 1, kind)
