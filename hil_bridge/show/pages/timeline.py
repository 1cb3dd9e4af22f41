"""Time line in a page: numbered moments above lanes with intervals, as SVG without scripts, and the list of moments.

The drawing is as wide as the page, on a phone too: positions along the axis are percentages. The names of the lanes
are in the margin on its left, for which the style sheet leaves room.
"""

from collections.abc import Iterator, Sequence
from enum import StrEnum
from html import escape

from msgspec import Struct

from hil_bridge.show.pages.svg import number, round_numbers

_NAMES_PX = 118
"""Width of the names of the lanes, px; the same in the style sheet."""
_PHONE_PX = 240.0
"""Width for which labels and marks are spaced. Chosen: a phone."""
_APART = {"narrow": 9.2, "wide": 3.4}
"""Smallest distance between two numbers, % of the width, by the width of the page. Chosen: 22 px on a phone and on a
page of 640 px.
"""
_EDGE = 4.6
"""Distance of the first and the last number from the edges, % of the width. Chosen: half a number on a phone."""
_BEFORE_PX = 112.0
"""Width for which the labels before 0 s are spaced. Chosen: one or two round numbers for any length."""
_MARGIN = 0.02
"""Margin of the axis beyond the first and the last time, as a share of its length. Chosen."""
_LEAST = 0.4
"""Smallest width of an interval, % of the width. Chosen."""
_TOP_PX, _LABEL_PX, _LANE_PX, _AXIS_PX = 46, 18, 30, 22
"""Heights of the numbers, of a label below the lanes, of a lane, and of the axis, px."""
_DECIMALS = 3
"""Decimal places of times in s."""


class Tone(StrEnum):
    """Meaning of a moment or an interval, which selects its colour and height."""

    PLAIN = "plain"
    GOOD = "good"
    WARN = "warn"
    BAD = "bad"
    FAULT = "fault"


_BARS = {
    Tone.PLAIN: (12, 6),
    Tone.GOOD: (12, 6),
    Tone.WARN: (10, 10),
    Tone.BAD: (8, 14),
    Tone.FAULT: (8, 14),
}
"""Distance from the top of the lane, and height, by the meaning of an interval, px: not only the colour differs."""

_KEY = {
    Tone.GOOD: "in order",
    Tone.WARN: "tolerated",
    Tone.BAD: "mistake",
    Tone.FAULT: "fault",
}
"""Meanings of the colours."""


class Moment(Struct, frozen=True):
    """Moment with its description."""

    at: float
    """Time, s."""
    text: str
    tone: Tone = Tone.PLAIN


class Interval(Struct, frozen=True):
    """Interval of a lane. An interval without a lane is shaded across all lanes."""

    lane: str
    begin: float
    end: float
    tone: Tone = Tone.PLAIN
    label: str = ""
    """Label of an interval across all lanes, below them."""


class TimeLine(Struct, frozen=True):
    """Moments and intervals, with times in s relative to an event."""

    moments: Sequence[Moment]
    intervals: Sequence[Interval]
    zero: str
    """Name of the event at 0 s."""


def timeline(line: TimeLine) -> str:
    """Render the drawing, and the numbered list of its moments; empty without moments."""
    moments = sorted(line.moments, key=lambda one: one.at)
    if not moments:
        return ""
    rows = "".join(
        f'<li class="{one.tone}"><b>{count}</b><span>{_time(one.at)}</span><span>{escape(one.text)}</span></li>'
        for count, one in enumerate(moments, 1)
    )
    drawn = _Drawing(line).render(moments)
    return f'<figure class="timeline">{drawn}{_key(line)}<ol>{rows}</ol></figure>'


def _key(line: TimeLine) -> str:
    """Render the meaning of the colours, and the label of the axis."""
    tones = {one.tone for one in line.intervals}
    items = "".join(
        f'<span class="{tone}"><i></i>{text}</span>' for tone, text in _KEY.items() if tone in tones
    )
    return f"<figcaption>{items}<span>time from {escape(line.zero)}</span></figcaption>"


def _time(at: float) -> str:
    """Format a time with its sign."""
    rounded = round(at, _DECIMALS) + 0.0
    return "0 s" if not rounded else f"{rounded:+.{_DECIMALS}f} s".replace("-", "−")


class _Drawing:
    """Drawing of a time line. `x` values are percentages of the width, `y` values px."""

    def __init__(self, line: TimeLine) -> None:
        self._line = line
        times = [0.0, *(one.at for one in line.moments)]
        times += [at for one in line.intervals for at in (one.begin, one.end)]
        margin = _MARGIN * max(max(times) - min(times), 1e-3)
        self._low, self._high = min(times) - margin, max(times) + margin
        self._lanes = list(dict.fromkeys(one.lane for one in line.intervals if one.lane))
        self._end = _TOP_PX + _LANE_PX * len(self._lanes)
        self._bottom = self._end + _LABEL_PX * any(one.label for one in line.intervals)

    def render(self, moments: Sequence[Moment]) -> str:
        """Render the drawing; `moments` are in order of time."""
        marks = (
            f'<g class="{width}">{"".join(self._marks(moments, apart))}</g>'
            for width, apart in _APART.items()
        )
        parts = (*self._intervals(), *self._axis(), *marks, *self._names())
        label = f"Time line; 0 s is {self._line.zero}. The list below has its moments."
        return (
            f'<svg width="100%" height="{self._bottom + _AXIS_PX}" role="img" aria-label="{escape(label)}">'
            f"{''.join(parts)}</svg>"
        )

    def _x(self, at: float) -> float:
        return 100.0 * (at - self._low) / (self._high - self._low)

    def _intervals(self) -> Iterator[str]:
        """Yield the shaded intervals, then the bars of the lanes."""
        for one in sorted(self._line.intervals, key=lambda each: each.lane):
            top, height = _BARS[one.tone]
            place = _TOP_PX + _LANE_PX * self._lanes.index(one.lane) if one.lane else _TOP_PX
            top, height = (place + top, height) if one.lane else (place, self._bottom - _TOP_PX)
            begin, end = self._x(one.begin), self._x(one.end)
            yield (
                f'<rect class="{one.tone}{"" if one.lane else " across"}" x="{begin:.2f}%" y="{top}"'
                f' width="{max(end - begin, _LEAST):.2f}%" height="{height}"/>'
            )
            if one.label:
                yield f'<text x="{begin:.2f}%" dx="6" y="{self._bottom - 5}">{escape(one.label)}</text>'

    def _names(self) -> Iterator[str]:
        """Yield the names of the lanes, on the left of the drawing."""
        for row, lane in enumerate(self._lanes):
            yield f'<text x="-{_NAMES_PX}" y="{_TOP_PX + _LANE_PX * row + 19}">{escape(lane)}</text>'

    def _axis(self) -> Iterator[str]:
        """Yield the axis with labels at round times."""
        yield f'<line class="axis" x1="0" x2="100%" y1="{self._bottom}" y2="{self._bottom}"/>'
        ticks = self._ticks()
        for at in ticks:
            x, label = self._x(at), number(at) + " s" * (at == max(ticks))
            yield (
                f'<line class="axis" x1="{x:.2f}%" x2="{x:.2f}%" y1="{self._bottom}" y2="{self._bottom + 4}"/>'
                f'<text class="quiet" x="{x:.2f}%" y="{self._bottom + 17}" text-anchor="middle">{label}</text>'
            )

    def _ticks(self) -> list[float]:
        """Return round times that are not at the edges; one of them is negative if there is room for it."""
        ticks = round_numbers(self._low, self._high, _PHONE_PX)
        if min(ticks, default=0.0) >= 0.0 > self._low:
            before = round_numbers(0.0, -self._low, _BEFORE_PX)[-1]
            ticks += [-before] * (self._x(0.0) - self._x(-before) >= _APART["narrow"])
        return [at for at in ticks if 1.0 < self._x(at) < 99.0]

    def _marks(self, moments: Sequence[Moment], apart: float) -> Iterator[str]:
        """Yield a line across the lanes for each moment, and its number above."""
        places = [self._x(one.at) for one in moments]
        for count, (one, x, label) in enumerate(zip(moments, places, _spread(places, apart), strict=True), 1):
            yield (
                f'<g class="{one.tone}"><line x1="{label:.2f}%" x2="{x:.2f}%" y1="20" y2="{_TOP_PX - 8}"/>'
                f'<line x1="{x:.2f}%" x2="{x:.2f}%" y1="{_TOP_PX - 8}" y2="{self._end}"/>'
                f'<circle cx="{label:.2f}%" cy="11" r="10"/>'
                f'<text x="{label:.2f}%" y="15" text-anchor="middle">{count}</text></g>'
            )


def _spread(places: Sequence[float], apart: float) -> list[float]:
    """Move increasing places apart, so that their numbers do not overlap and none is beyond an edge."""
    apart = min(apart, (100.0 - 2.0 * _EDGE) / max(len(places) - 1, 1))
    moved: list[float] = []
    for place in places:
        moved.append(max(place, moved[-1] + apart if moved else _EDGE))
    for k in reversed(range(len(moved))):
        moved[k] = min(moved[k], moved[k + 1] - apart if k + 1 < len(moved) else 100.0 - _EDGE)
    return moved
