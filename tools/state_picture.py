"""A state diagram as an SVG: boxes at given places, curved arrows between them, a label on each arrow."""

import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import NamedTuple

Place = tuple[float, float]

BOX = 78.0, 22.0
"""Half the width and half the height of a state's box."""
LINE = 15.0
"""From one line of a label to the next."""
STYLE = """\
  .state { fill: #ffffff; stroke: #57708f } .name { font: 600 13px system-ui, sans-serif; fill: #1f2328 }
  .label { font: 12px system-ui, sans-serif; fill: #1f2328; stroke: #ffffff; stroke-width: 4px; paint-order: stroke }
  .arrow { fill: none; stroke: #0969da; stroke-width: 1.4 } .head { fill: #0969da } text { text-anchor: middle }
  @media (prefers-color-scheme: dark) { .state { fill: #0d1117; stroke: #7d94b3 } .name { fill: #f0f6fc }
    .label { fill: #f0f6fc; stroke: #131416 } .arrow { stroke: #4493f8 } .head { fill: #4493f8 } }"""
HEAD = (
    '<defs><marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
    '<path class="head" d="M0 0 L8 4 L0 8 z"/></marker></defs>'
)


class Bend(NamedTuple):
    """How an arrow leaves the straight line."""

    aside: float = 0.0
    """Of its middle to the right of its direction."""
    label: float = 0.5
    """Share of the way at which its label stands."""


class Layout(NamedTuple):
    """Where everything of a picture stands."""

    size: Place
    places: Mapping[str, Place]
    """Middle of each state's box."""
    bends: Mapping[tuple[str, str], Bend]
    """Arrows that are not straight, or whose label is not in the middle."""


def picture(title: str, arrows: Mapping[tuple[str, str], Sequence[str]], layout: Layout) -> str:
    """The SVG; of each arrow from a state to a state the lines of its label.

    Raises KeyError for a state without a place.
    """
    names = [name for name in layout.places if any(name in pair for pair in arrows)]
    begin = layout.places[names[0]]
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {layout.size[0]:g} {layout.size[1]:g}" role="img" '
        f'aria-label="{escape(title)}">',
        f"<style>\n{STYLE}\n</style>\n{HEAD}",
        f'<circle class="head" cx="{begin[0] - BOX[0] - 34:g}" cy="{begin[1]:g}" r="6"/>',
        _path(
            (begin[0] - BOX[0] - 28, begin[1]),
            (begin[0] - BOX[0] - 14, begin[1]),
            (begin[0] - BOX[0], begin[1]),
        ),
    ]
    curves = {pair: _curve(layout, pair) for pair in arrows}
    parts += [_path(*curve) for curve in curves.values()]
    parts += [_box(name, layout.places[name]) for name in names]
    parts += [
        _label(lines, _on(curves[pair], layout.bends.get(pair, Bend()).label))
        for pair, lines in arrows.items()
    ]
    return "\n".join([*parts, "</svg>\n"])


def _curve(layout: Layout, pair: tuple[str, str]) -> tuple[Place, Place, Place]:
    """Begin, control point and end of a quadratic curve between the borders of two boxes."""
    (x, y), (u, v) = (layout.places[name] for name in pair)
    length = math.hypot(u - x, v - y)
    aside = 2.0 * layout.bends.get(pair, Bend()).aside / length
    control = (x + u) / 2.0 - (v - y) * aside, (y + v) / 2.0 + (u - x) * aside
    return _border((x, y), control), control, _border((u, v), control)


def _border(middle: Place, towards: Place) -> Place:
    """Where the line from the middle of a box towards a point leaves the box."""
    across, along = towards[0] - middle[0], towards[1] - middle[1]
    share = min(
        half / abs(part) if part else math.inf for half, part in zip(BOX, (across, along), strict=True)
    )
    return middle[0] + across * share, middle[1] + along * share


def _on(curve: tuple[Place, Place, Place], share: float) -> Place:
    """A point of a curve, at this share of its way."""
    a, b, c = (1.0 - share) ** 2, 2.0 * share * (1.0 - share), share**2
    x, y = (a * p + b * q + c * r for p, q, r in zip(*curve, strict=True))
    return x, y


def _path(begin: Place, control: Place, end: Place) -> str:
    points = " ".join(f"{x:.1f} {y:.1f}" for x, y in (control, end))
    return f'<path class="arrow" d="M{begin[0]:.1f} {begin[1]:.1f} Q{points}" marker-end="url(#head)"/>'


def _box(name: str, middle: Place) -> str:
    x, y = middle
    return (
        f'<rect class="state" x="{x - BOX[0]:g}" y="{y - BOX[1]:g}" width="{2 * BOX[0]:g}" height="{2 * BOX[1]:g}" '
        f'rx="8"/><text class="name" x="{x:g}" y="{y + 4:g}">{escape(name)}</text>'
    )


def _label(lines: Sequence[str], middle: Place) -> str:
    x, top = middle[0], middle[1] + 4.0 - LINE * (len(lines) - 1) / 2.0
    rows = (
        f'<tspan x="{x:.1f}" y="{top + LINE * number:.1f}">{escape(line)}</tspan>'
        for number, line in enumerate(lines)
    )
    return f'<text class="label">{"".join(rows)}</text>'
