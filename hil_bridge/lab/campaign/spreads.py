"""How a campaign's figures are spread: bars over all runs, and below them a strip for each cell of the matrix."""

import math
import statistics
from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape

from hil_bridge.lab.campaign.criteria import BOUNDS
from hil_bridge.lab.campaign.digest import NUMBERS, runs_by_cell, values_of
from hil_bridge.lab.campaign.plan import Plan
from hil_bridge.lab.campaign.store import Done
from hil_bridge.record.analysis.figures import FIGURES

BINS = 40
"""Bars of a distribution. Chosen."""
CELLS_MOST = 24
"""Cells that have a strip, those with the largest values. Chosen: two screens of a phone."""
_WIDTH, _HEIGHT, _FOOT = 320, 90, 16
"""Of a distribution's bars, and of the line of text below them, px. Chosen."""
_STRIP = 27
"""Height of a cell's strip with its name, px."""


def distributions(plan: Plan, runs: Sequence[Done]) -> str:
    """A picture of each figure, those with a criterion first. Figures that are the same in all runs share a line."""
    wanted = {one.figure: one.wanted for one in plan.criteria}
    cells = runs_by_cell(plan, runs)
    parts, same = [], []
    for key in sorted(NUMBERS, key=lambda key: key not in wanted):
        values = values_of(key, runs)
        if not values:
            continue
        if values[0] == values[-1] and math.isfinite(values[0]) and len(values) > 1:
            same.append(f"{FIGURES[key].words} {FIGURES[key].text(values[0])}")
            continue
        by_cell = {cell: found for cell, of_cell in cells.items() if (found := values_of(key, of_cell))}
        parts.append(_distribution(key, values, by_cell, _bounds(wanted.get(key))))
    if not parts and not same:
        return "<p>none</p>"
    alike = f"<p>The same in all runs that have it: {escape('; '.join(same))}.</p>" if same else ""
    return f'<div class="figures">{"".join(parts)}</div>{alike}'


def _bounds(wanted: object) -> Mapping[str, float]:
    return (
        {name: float(wanted[name]) for name in BOUNDS if name in wanted} if isinstance(wanted, dict) else {}
    )


def _distribution(
    key: str, values: Sequence[float], by_cell: Mapping[str, Sequence[float]], bounds: Mapping[str, float]
) -> str:
    one, finite = FIGURES[key], [value for value in values if math.isfinite(value)]
    title = f"<strong>{escape(one.title)}</strong> <code>{key}</code><br>{escape(one.how)}"
    endless = len(values) - len(finite)
    if not finite:
        return f"<figure><figcaption>{title}<br>{endless} runs, all without an end</figcaption></figure>"
    low, high = finite[0], finite[-1]
    median, late = statistics.median(finite), finite[math.ceil(0.99 * len(finite)) - 1]
    counts = f"{len(finite)} runs" + (f", and {endless} without an end" if endless else "")
    wanted = "".join(f"; wanted {_in_words(word, bound)}" for word, bound in bounds.items())
    numbers = f"median {median:.4g}, 99 % ≤ {late:.4g}, least {low:.4g}, largest {high:.4g}{wanted}"
    return (
        f"<figure><figcaption>{title}</figcaption>{_Picture(key, finite, bounds).draw(by_cell)}"
        f"<figcaption>{counts}: {numbers}{_left_out(by_cell)}</figcaption></figure>"
    )


def _left_out(by_cell: Mapping[str, Sequence[float]]) -> str:
    return f"; {len(by_cell) - CELLS_MOST} cells with lower values have no strip" * (
        len(by_cell) > CELLS_MOST
    )


def _in_words(word: str, bound: float) -> str:
    return f"{word.replace('_', ' ')} {bound:g}"


class _Picture:
    """Bars and strips on one scale. Colours come from classes: a live page allows no style of its own."""

    def __init__(self, key: str, values: Sequence[float], bounds: Mapping[str, float]) -> None:
        """A bound that lies not far beyond the values widens the picture to it."""
        low, high = values[0], values[-1]
        span = high - low or abs(high) or 1.0
        self._near = {word: b for word, b in bounds.items() if low - span < b < high + span}
        self._low = min([low, *self._near.values()])
        self._high = max([high, *self._near.values()])
        self._span = self._high - self._low or 1.0
        self._key, self._values = key, values

    def draw(self, by_cell: Mapping[str, Sequence[float]]) -> str:
        """The picture; one cell alone has no strip, for the bars show it."""
        cells = sorted(by_cell, key=lambda cell: by_cell[cell][-1], reverse=True)[:CELLS_MOST]
        shown = [cell for cell in by_cell if cell in cells] if len(by_cell) > 1 else []
        height = _HEIGHT + _FOOT + _STRIP * len(shown)
        parts = self._bars()
        for place, cell in enumerate(shown):
            parts += self._strip(cell, by_cell[cell], _HEIGHT + _FOOT + _STRIP * place)
        for word, bound in self._near.items():
            at = self._x(bound)
            parts.append(f'<line x1="{at:.1f}" x2="{at:.1f}" y1="0" y2="{height}"/>')
            side, anchor = (at - 4, "end") if at > _WIDTH / 2 else (at + 4, "start")
            text = _in_words(word, bound)
            parts.append(f'<text class="bound" x="{side:.1f}" y="10" text-anchor="{anchor}">{text}</text>')
        label = f"distribution of {self._key}, over all runs and by cell"
        return f'<svg viewBox="0 0 {_WIDTH} {height}" role="img" aria-label="{label}">{"".join(parts)}</svg>'

    def _x(self, value: float) -> float:
        return (value - self._low) / self._span * _WIDTH

    def _bars(self) -> list[str]:
        """Bars from the least to the largest value, and the ends of the scale."""
        low, span = self._low, self._span
        counts = Counter(min(int((value - low) / span * BINS), BINS - 1) for value in self._values)
        top, width = max(counts.values()), _WIDTH / BINS
        parts = []
        for place, count in sorted(counts.items()):
            height = max(1.5, (_HEIGHT - 8) * count / top)
            first = low + place * span / BINS
            title = f"{count} runs from {first:.4g} to {first + span / BINS:.4g}"
            parts.append(
                f'<rect x="{place * width:.1f}" y="{_HEIGHT - height:.1f}" width="{width - 1:.1f}"'
                f' height="{height:.1f}"><title>{title}</title></rect>'
            )
        foot = _HEIGHT + _FOOT - 3
        parts.append(f'<path d="M0 {_HEIGHT}H{_WIDTH}"/><text x="0" y="{foot}">{low:.4g}</text>')
        parts.append(f'<text x="{_WIDTH}" y="{foot}" text-anchor="end">{self._high:.4g}</text>')
        return parts

    def _strip(self, cell: str, values: Sequence[float], top: float) -> list[str]:
        """Least to largest value as a thin line, the middle half as a bar, the median as a mark."""
        finite = [value for value in values if math.isfinite(value)]
        if not finite:
            return [f'<text x="0" y="{top + 13}">{escape(cell)}: without an end</text>']
        quarters = statistics.quantiles(finite, n=4, method="inclusive") if len(finite) > 1 else finite * 3
        first, median, third = map(self._x, quarters)
        middle = top + 20
        told = ", ".join(f"{name} {value:.4g}" for name, value in zip(_QUARTERS, quarters, strict=True))
        words = f"{cell}: {len(values)} runs, least {finite[0]:.4g}, {told}, largest {finite[-1]:.4g}"
        return [
            f'<g class="strip"><title>{escape(words)}</title>',
            f'<text x="0" y="{top + 12}">{escape(cell)}</text>',
            f'<path d="M{self._x(finite[0]):.1f} {middle}H{self._x(finite[-1]):.1f}"/>',
            f'<rect x="{first:.1f}" y="{middle - 4}" width="{max(third - first, 1.0):.1f}" height="8"/>',
            f'<path class="median" d="M{median:.1f} {middle - 6}v12"/></g>',
        ]


_QUARTERS = ("first quarter", "median", "third quarter")
