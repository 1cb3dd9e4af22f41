"""State diagram: boxes at given positions, curved arrows between them, and a label on each arrow."""

import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import NamedTuple

from tools.svg import Point, draw_arrow, draw_box, draw_picture

BOX = 78.0, 22.0
"""Half of the width and half of the height of a state's box."""
LINE = 15.0
"""Distance between the lines of a label."""
Curve = tuple[Point, Point, Point]
"""Start, control point and end of a curved arrow."""


class Bend(NamedTuple):
    """Shape of an arrow that is not straight."""

    aside: float = 0.0
    """Offset of the arrow's middle, to the right of its direction."""
    label: float = 0.5
    """Position of the arrow's label, as a share of its path."""


class Layout(NamedTuple):
    """Positions of all parts of a picture."""

    size: Point
    places: Mapping[str, Point]
    """Centre of each state's box."""
    bends: Mapping[tuple[str, str], Bend]
    """Arrows that are not straight, or whose label is not in the middle of the arrow."""


def draw_states(title: str, arrows: Mapping[tuple[str, str], Sequence[str]], layout: Layout) -> str:
    """Draw arrows between states with the lines of their labels. Raises KeyError for a state without a position."""
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
    """Return the point where the line from the centre of a box to another point leaves the box."""
    across, along = towards[0] - middle[0], towards[1] - middle[1]
    share = min(
        half / abs(part) if part else math.inf for half, part in zip(BOX, (across, along), strict=True)
    )
    return middle[0] + across * share, middle[1] + along * share


def _on(curve: Curve, share: float) -> Point:
    """Return the point of a curve at this share of its parameter, 0 … 1."""
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
