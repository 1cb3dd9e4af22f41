"""SVG drawings in a page, without scripts. Colours are style sheet variables, for light and dark pages."""

import math
import struct
import zlib
from base64 import b64encode
from collections.abc import Iterable, Sequence
from html import escape
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hil_bridge.show.pages.description import Range

VIRIDIS = ((68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37))
"""Sequential palette, distinguishable in greyscale. Source: the colour map viridis, at five points."""
COOLWARM = ((59, 76, 192), (141, 176, 254), (221, 221, 221), (244, 152, 122), (180, 4, 38))
"""Diverging palette. Source: the colour map of K. Moreland, at five points."""
PALETTES = {"amount": VIRIDIS, "sign": COOLWARM}
"""Colour palettes by their names in `description.Scale`."""
Interval: TypeAlias = tuple[float, float, float]
"""Least value, median, and largest value."""
_LEAST_PX = 45.0


class Frame:
    """Rectangle of a drawing with scales of its own, and the elements in the rectangle."""

    def __init__(self, place: tuple[float, float, float, float], x: Range, y: Range) -> None:
        """`place` is left, top, width and height, px. `x` and `y` are the displayed ranges; y points upwards."""
        self.left, self.top, self.width, self.height = place
        self.x_range, self.y_range = x, y
        self.parts: list[str] = []

    def x(self, value: float) -> float:
        """Convert a value on the x axis to px."""
        low, high = self.x_range
        return self.left + self.width * (value - low) / (high - low)

    def y(self, value: float) -> float:
        """Convert a value on the y axis to px."""
        low, high = self.y_range
        return self.top + self.height * (high - value) / (high - low)

    def axes(self, x_label: str, y_label: str) -> None:
        """Draw grid lines at round numbers, with labels."""
        bottom = self.top + self.height
        for value in round_numbers(*self.x_range, self.width):
            at = self.x(value)
            self.parts.append(line((at, self.top), (at, bottom), "grid"))
            self.parts.append(text((at, bottom + 15), number(value), "middle"))
        for value in round_numbers(*self.y_range, self.height):
            at = self.y(value)
            self.parts.append(line((self.left, at), (self.left + self.width, at), "grid"))
            self.parts.append(text((self.left - 6, at + 4), number(value), "end"))
        self.parts.append(text((self.left + self.width / 2, bottom + 36), x_label, "middle"))
        middle = self.top + self.height / 2
        self.parts.append(
            f'<text transform="translate({self.left - 40:.1f} {middle:.1f}) rotate(-90)" text-anchor="middle"'
            f' style="fill:var(--quiet)">{escape(y_label)}</text>'
        )

    def path(
        self, places: Iterable[tuple[float, float]], colour: str, width: float, dashed: bool = False
    ) -> None:
        """Draw a line through points in the units of the frame; a NaN point interrupts the line."""
        commands, joined = [], False
        for x, y in places:
            if not (math.isfinite(x) and math.isfinite(y)):
                joined = False
                continue
            commands.append(f"{'L' if joined else 'M'}{self.x(x):.1f} {self.y(y):.1f}")
            joined = True
        dash = ' stroke-dasharray="5 4"' if dashed else ""
        self.parts.append(
            f'<path d="{"".join(commands)}" fill="none" stroke-width="{width:g}" stroke-linecap="round"{dash}'
            f' style="stroke:{shade(colour)}"/>'
        )


def drawing(size: tuple[float, float], parts: Iterable[str], label: str) -> str:
    """Render the complete drawing; `label` describes it to a screen reader."""
    width, height = size
    return (
        f'<svg viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}" height="{height:.0f}" role="img"'
        f' font-size="12" font-family="system-ui, sans-serif" aria-label="{escape(label)}">'
        f"{''.join(parts)}</svg>"
    )


def shade(colour: str) -> str:
    """Return a CSS colour for the name of a style sheet variable; `#rrggbb` is returned unchanged."""
    return colour if colour.startswith("#") else f"var(--{colour})"


def line(begin: tuple[float, float], end: tuple[float, float], colour: str, width: float = 1.0) -> str:
    """Draw a straight line between two points, px."""
    return (
        f'<line x1="{begin[0]:.1f}" y1="{begin[1]:.1f}" x2="{end[0]:.1f}" y2="{end[1]:.1f}"'
        f' stroke-width="{width:g}" style="stroke:{shade(colour)}"/>'
    )


def box(place: tuple[float, float, float, float], colour: str, title: str = "") -> str:
    """Draw a filled rectangle with left, top, width and height in px. The title is the tooltip of the rectangle."""
    left, top, width, height = place
    inside = f"<title>{escape(title)}</title>" if title else ""
    return (
        f'<rect x="{left:.1f}" y="{top:.1f}" width="{max(width, 0.5):.1f}" height="{height:.1f}"'
        f' style="fill:{shade(colour)}">{inside}</rect>'
    )


def text(
    place: tuple[float, float], content: str, anchor: str = "start", colour: str = "quiet", bold: bool = False
) -> str:
    """Draw text; `anchor` is start, middle or end."""
    weight = ' font-weight="600"' if bold else ""
    return (
        f'<text x="{place[0]:.1f}" y="{place[1]:.1f}" text-anchor="{anchor}"{weight}'
        f' style="fill:{shade(colour)}">{escape(content)}</text>'
    )


def dot(place: tuple[float, float], radius: float, colour: str) -> str:
    """Draw a filled circle, px."""
    return f'<circle cx="{place[0]:.1f}" cy="{place[1]:.1f}" r="{radius:g}" style="fill:{shade(colour)}"/>'


def interval_plot(first: Interval | None, last: Interval | None, best: float | None, style: str) -> str:
    """Draw two values with their intervals on one axis that includes 0, and a line at the best value.

    An infinite value or end of an interval is an arrow at the end of the axis; None is not drawn. `style` is the class
    of the last value.
    """
    drawn = [(one, 5 + 12 * place) for place, one in enumerate((first, last)) if one is not None]
    known = [0.0, best or 0.0, *(value for one, _ in drawn for value in one if math.isfinite(value))]
    low, span = min(known), max(known) - min(known) or 1.0

    def x(value: float) -> str:
        """Return a place as a share of the width, which leaves room for marks and arrows at the ends."""
        return f"{min(2.0 + 86.0 * (value - low) / span, 99.0):.1f}%"

    parts = [f'<line class="best" x1="{x(best)}" x2="{x(best)}" y2="22"/>'] if best is not None else []
    for (least, value, most), y in drawn:
        mark = "" if math.isinf(value) else f'<circle cx="{x(value)}" cy="{y}" r="4"/>'
        if math.isinf(most):
            mark += f'<svg x="{x(most)}" y="{y}"><path d="M-8 -4l8 4l-8 4z"/></svg>'
        named = f"last {style}" if y > 5 else "first"
        interval = f'<line x1="{x(least)}" x2="{x(most)}" y1="{y}" y2="{y}"/>'
        parts.append(f'<g class="{named}">{interval}{mark}</g>')
    return f'<svg class="plot" aria-hidden="true">{"".join(parts)}</svg>'


def scale_colours(shares: NDArray[np.float64], stops: Sequence[tuple[int, int, int]]) -> NDArray[np.uint8]:
    """Return the colours (…, 3) on a scale for shares from 0 to 1."""
    at = np.linspace(0.0, 1.0, len(stops))
    parts = [np.interp(np.clip(shares, 0.0, 1.0), at, [stop[k] for stop in stops]) for k in range(3)]
    return np.stack(parts, axis=-1).round().astype(np.uint8)


def hexadecimal(colour: NDArray[np.uint8]) -> str:
    """Format a colour as `#rrggbb`."""
    return "#" + bytes(colour.tolist()).hex()


def image(pixels: NDArray[np.uint8], place: tuple[float, float, float, float]) -> str:
    """Draw pixels (rows, columns, 3) as sharp rectangles."""
    rows, columns, _ = pixels.shape
    raw = b"".join(b"\0" + pixels[row].tobytes() for row in range(rows))

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    png = (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", columns, rows, 8, 2, 0, 0, 0))
        + chunk(b"IDAT", zlib.compress(raw, 9))
        + chunk(b"IEND", b"")
    )
    left, top, width, height = place
    return (
        f'<image x="{left:.1f}" y="{top:.1f}" width="{width:.1f}" height="{height:.1f}" preserveAspectRatio="none"'
        f' style="image-rendering:pixelated" href="data:image/png;base64,{b64encode(png).decode()}"/>'
    )


def scale_bar(
    place: tuple[float, float, float], stops: Sequence[tuple[int, int, int]], ends: Range, unit: str
) -> str:
    """Draw the colour bar, with left, top and height in px. The unit is at its upper end."""
    left, top, height = place
    colours = scale_colours(np.linspace(1.0, 0.0, 64)[:, None], stops)
    low, high = ends
    labels = [
        (f"{number(high, 3)} {unit}", top + 9),
        (number((low + high) / 2, 3), top + height / 2 + 4),
        (number(low, 3), top + height),
    ]
    return image(colours, (left, top, 14, height)) + "".join(
        text((left + 20, y), label) for label, y in labels
    )


def round_numbers(low: float, high: float, room_px: float) -> list[float]:
    """Return as many round numbers between two values as fit."""
    if not high > low:
        return []
    rough = (high - low) / max(room_px / _LEAST_PX, 1.0)
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(power * factor for factor in (1, 2, 5, 10) if power * factor >= rough * 0.999)
    first = math.ceil(low / step - 1e-9)
    return [k * step for k in range(first, math.floor(high / step + 1e-9) + 1)]


def number(value: float, digits: int = 4) -> str:
    """Format a number with as few characters as possible."""
    return f"{value:.{digits}g}".replace("-", "−")
