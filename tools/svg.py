"""Boxes and arrows as SVG, for light and dark pages."""

from collections.abc import Sequence
from html import escape

Point = tuple[float, float]

STYLE = """\
  .band { fill: #f6f8fa; stroke: #d0d7de } .box { fill: #ffffff; stroke: #57708f }
  .real { fill: #fff1e5; stroke: #bc4c00 } .title { font: 600 14px ui-monospace, monospace; fill: #59636e }
  .name { font: 600 13px system-ui, sans-serif; text-anchor: middle; fill: #1f2328 }
  .small { font: 11px system-ui, sans-serif; text-anchor: middle; fill: #59636e }
  .label { font: 12px system-ui, sans-serif; text-anchor: middle; fill: #1f2328; stroke: #ffffff; stroke-width: 4px;
    paint-order: stroke }
  .arrow { fill: none; stroke: #0969da; stroke-width: 1.4 } .dashed { stroke-dasharray: 4 3 } .head { fill: #0969da }
  @media (prefers-color-scheme: dark) {
    .band { fill: #151b23; stroke: #3d444d } .box { fill: #0d1117; stroke: #7d94b3 }
    .real { fill: #2b1d12; stroke: #f0883e } .title, .small { fill: #9198a1 } .name { fill: #f0f6fc }
    .label { fill: #f0f6fc; stroke: #131416 } .arrow { stroke: #4493f8 } .head { fill: #4493f8 } }"""
HEAD = (
    '<defs><marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
    '<path class="head" d="M0 0 L8 4 L0 8 z"/></marker></defs>'
)


def draw_picture(title: str, size: Point, parts: Sequence[str]) -> str:
    """Return the SVG picture with these parts. The first part is in the background."""
    begin = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size[0]:g} {size[1]:g}" role="img" '
        f'aria-label="{escape(title)}">'
    )
    return "\n".join([begin, f"<style>\n{STYLE}\n</style>", HEAD, *parts, "</svg>\n"])


def draw_box(corner: Point, size: Point, title: str, note: str = "", look: str = "box") -> str:
    """Return a box, given by its upper left corner, with a title and a smaller note below the title."""
    (x, y), (width, height) = corner, size
    middle, line = x + width / 2, y + height / 2
    parts = [
        f'<rect class="{look}" x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}" rx="6"/>',
        draw_text("name", (middle, line - 4 if note else line + 5), title),
    ]
    return "".join([*parts, draw_text("small", (middle, line + 13), note)] if note else parts)


def draw_text(look: str, place: Point, text: str) -> str:
    """Return a line of text."""
    return f'<text class="{look}" x="{place[0]:g}" y="{place[1]:g}">{escape(text)}</text>'


def draw_arrow(points: Sequence[Point], dashed: bool = False, curved: bool = False) -> str:
    """Return an arrow along these points. A curved arrow has a start, a control point and an end."""
    (x, y), *rest = points
    way = " ".join(f"{'' if curved else 'L'}{u:.1f} {v:.1f}" for u, v in rest)
    look = "arrow dashed" if dashed else "arrow"
    return f'<path class="{look}" d="M{x:.1f} {y:.1f} {"Q" if curved else ""}{way}" marker-end="url(#head)"/>'
