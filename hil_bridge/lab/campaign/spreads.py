"""How a campaign's figures are spread: bars over all runs."""

import math
import statistics
from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape

from hil_bridge.lab.campaign.criteria import BOUNDS
from hil_bridge.lab.campaign.digest import NUMBERS, values_of
from hil_bridge.lab.campaign.plan import Plan
from hil_bridge.lab.campaign.store import Done
from hil_bridge.record.analysis.figures import FIGURES

BINS = 40
"""Bars of a distribution. Chosen."""
_WIDTH, _HEIGHT, _FOOT = 320, 90, 16
"""Of a distribution's bars, and of the line of text below them, px. Chosen."""


def distributions(plan: Plan, runs: Sequence[Done]) -> str:
    """A picture of each figure, those with a criterion first. Figures that are the same in all runs share a line."""
    wanted = {one.figure: one.wanted for one in plan.criteria}
    parts, same = [], []
    for key in sorted(NUMBERS, key=lambda key: key not in wanted):
        values = values_of(key, runs)
        if not values:
            continue
        if values[0] == values[-1] and math.isfinite(values[0]) and len(values) > 1:
            same.append(f"{FIGURES[key].words} {FIGURES[key].text(values[0])}")
            continue
        parts.append(_distribution(key, values, _bounds(wanted.get(key))))
    if not parts and not same:
        return "<p>none</p>"
    alike = f"<p>The same in all runs that have it: {escape('; '.join(same))}.</p>" if same else ""
    return f'<div class="figures">{"".join(parts)}</div>{alike}'


def _bounds(wanted: object) -> Mapping[str, float]:
    return (
        {name: float(wanted[name]) for name in BOUNDS if name in wanted} if isinstance(wanted, dict) else {}
    )


def _distribution(key: str, values: Sequence[float], bounds: Mapping[str, float]) -> str:
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
        f"<figure><figcaption>{title}</figcaption>{_Picture(key, finite, bounds).draw()}"
        f"<figcaption>{counts}: {numbers}</figcaption></figure>"
    )


def _in_words(word: str, bound: float) -> str:
    return f"{word.replace('_', ' ')} {bound:g}"


class _Picture:
    """Bars and bounds. Colours come from classes: a live page allows no style of its own."""

    def __init__(self, key: str, values: Sequence[float], bounds: Mapping[str, float]) -> None:
        """A bound that lies not far beyond the values widens the picture to it."""
        low, high = values[0], values[-1]
        span = high - low or abs(high) or 1.0
        self._near = {word: b for word, b in bounds.items() if low - span < b < high + span}
        self._low = min([low, *self._near.values()])
        self._high = max([high, *self._near.values()])
        self._span = self._high - self._low or 1.0
        self._key, self._values = key, values

    def draw(self) -> str:
        """The picture."""
        height = _HEIGHT + _FOOT
        parts = self._bars()
        for word, bound in self._near.items():
            at = self._x(bound)
            parts.append(f'<line x1="{at:.1f}" x2="{at:.1f}" y1="0" y2="{height}"/>')
            side, anchor = (at - 4, "end") if at > _WIDTH / 2 else (at + 4, "start")
            text = _in_words(word, bound)
            parts.append(f'<text class="bound" x="{side:.1f}" y="10" text-anchor="{anchor}">{text}</text>')
        label = f"distribution of {self._key}, over all runs"
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
