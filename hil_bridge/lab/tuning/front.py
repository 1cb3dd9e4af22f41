"""Trade-off of two figures: the Pareto front of the points, as a table and as a plot."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from hil_bridge.errors import ConfigError
from hil_bridge.lab.drawing import Line, Panel, draw
from hil_bridge.lab.tuning.evaluating import Evaluation
from hil_bridge.lab.tuning.space import Space
from hil_bridge.record.analysis.figures import FIGURES
from hil_bridge.show.picture_files import drawing_library

PICTURES = (".svg", ".png")


def front(tried: Sequence[Evaluation], first: str, second: str) -> list[Evaluation]:
    """Return the Pareto front of the feasible points, sorted by the first figure."""
    candidates = [
        one for one in tried if one.feasible and one.mean(first) is not None and one.mean(second) is not None
    ]
    candidates.sort(key=lambda one: (one.mean(first), one.mean(second)))
    optimal: list[Evaluation] = []
    least = float("inf")
    for one in candidates:
        value = one.mean(second)
        assert value is not None
        if value < least:
            optimal.append(one)
            least = value
    return optimal


def describe_front(points: Sequence[Evaluation], space: Space, first: str, second: str) -> Iterator[str]:
    """Yield the points as text, line by line."""
    yield "  ".join((f"{first:>22}", f"{second:>22}", *(f"{name:>18}" for name in space.names)))
    for one in points:
        figures = (f"{one.mean(name):.4g} ± {one.spread(name):.2g}" for name in (first, second))
        yield "  ".join((*(f"{text:>22}" for text in figures), *(f"{value:>18.4g}" for value in one.point)))


def check_picture(place: Path) -> None:
    """Check the file name of a plot. Raises ConfigError for a suffix that is not a picture format, and if
    matplotlib is not installed.
    """
    if place.suffix not in PICTURES:
        raise ConfigError(f"{place}: the file name of a picture must end in {' or '.join(PICTURES)}")
    drawing_library()


def picture(
    tried: Sequence[Evaluation],
    defaults: Evaluation,
    best: Evaluation | None,
    axes: tuple[str, str],
    kind: str,
) -> bytes:
    """Plot all points, the front, the defaults and the best point, as SVG or PNG. `kind` is the suffix without a
    dot.
    """
    first, second = axes
    good = [one for one in tried if one.feasible]
    groups = {
        "points tried": good,
        "front": front(tried, first, second),
        "defaults": [defaults],
        "chosen": [] if best is None else [best],
    }
    lines = [
        Line(second, label, [{name: one.mean(name) for name in axes} for one in points], label == "front")
        for label, points in groups.items()
    ]
    title = f"{len(tried)} points, {len(tried) - len(good)} of them failed"
    return draw([Panel(title, (first, FIGURES[first].title), FIGURES[second].title, lines)], 1, kind)
