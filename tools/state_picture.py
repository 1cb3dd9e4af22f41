"""A state diagram: boxes at given places, curved arrows between them, a label on each arrow."""

import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import NamedTuple

from tools.svg import Point, draw_arrow, draw_box, draw_picture

BOX = 78.0, 22.0
"""Half the width and half the height of a state's box."""
LINE = 15.0
"""From one line of a label to the next."""
Curve = tuple[Point, Point, Point]
"""Begin, control point and end."""


class Bend(NamedTuple):
    """How an arrow leaves the straight line."""

    aside: float = 0.0
    """Of its middle to the right of its direction."""
    label: float = 0.5
    """Share of the path at which its label stands."""


class Layout(NamedTuple):
    """Where everything of a picture stands."""

    size: Point
    places: Mapping[str, Point]
    """Middle of each state's box."""
    bends: Mapping[tuple[str, str], Bend]
    """Arrows that are not straight, or whose label is not in the middle."""


def draw_states(title: str, arrows: Mapping[tuple[str, str], Sequence[str]], layout: Layout) -> str:
    """Draw arrows from state to state with the lines of their labels. Raises KeyError for a state without a place."""
    names = [name for name in layout.places if any(name in pair for pair in arrows)]
    x, y = layout.places[names[0]]
    parts = [
        f'<circle class="head" cx="{x - BOX[0] - 34:g}" cy="{y:g}" r="6"/>',
        draw_arrow([(x - BOX[0] - 28, y), (x - BOX[0], y)]),
    ]
    curves = {pair: _curve(layout, pair) for pair in arrows}
    parts += [draw_arrow(curve, curved=True) for curve in curves.values()]
    for name in names:
        x, y = layout.places[name]
        parts.append(draw_box((x - BOX[0], y - BOX[1]), (2 * BOX[0], 2 * BOX[1]), name))
    for pair, lines in arrows.items():
        parts.append(_label(lines, _on(curves[pair], layout.bends.get(pair, Bend()).label)))
    return draw_picture(title, layout.size, parts)


def _curve(layout: Layout, pair: tuple[str, str]) -> Curve:
    """Return a quadratic curve between the borders of two boxes."""
    (x, y), (u, v) = (layout.places[name] for name in pair)
    aside = 2.0 * layout.bends.get(pair, Bend()).aside / math.hypot(u - x, v - y)
    control = (x + u) / 2.0 - (v - y) * aside, (y + v) / 2.0 + (u - x) * aside
    return _border((x, y), control), control, _border((u, v), control)


def _border(middle: Point, towards: Point) -> Point:
    """Where the line from the middle of a box towards a point leaves the box."""
    across, along = towards[0] - middle[0], towards[1] - middle[1]
    share = min(
        half / abs(part) if part else math.inf for half, part in zip(BOX, (across, along), strict=True)
    )
    return middle[0] + across * share, middle[1] + along * share


def _on(curve: Curve, share: float) -> Point:
    """Return a point of a curve, at this share of its path."""
    a, b, c = (1.0 - share) ** 2, 2.0 * share * (1.0 - share), share**2
    x, y = (a * p + b * q + c * r for p, q, r in zip(*curve, strict=True))
    return x, y


def _label(lines: Sequence[str], middle: Point) -> str:
    x, top = middle[0], middle[1] + 4.0 - LINE * (len(lines) - 1) / 2.0
    rows = (
        f'<tspan x="{x:.1f}" y="{top + LINE * number:.1f}">{escape(line)}</tspan>'
        for number, line in enumerate(lines)
    )
    return f'<text class="label">{"".join(rows)}</text>'
