"""Distributions of a campaign's figures over all runs: histograms, or dots of few values."""

import math
import statistics
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from html import escape

from hil_bridge.errors.rounding import three_digits
from hil_bridge.lab.campaign.digest import FORCE, NUMBERS, values_of
from hil_bridge.lab.campaign.plan import Plan
from hil_bridge.lab.campaign.store import Done
from hil_bridge.record.analysis.figures import FIGURES
from hil_bridge.show.pages.svg import number
from hil_bridge.show.report.markup import fold

_COUNT_MOST = 1e6
"""Magnitude from which on a value is displayed with an exponent. Chosen."""
BINS_FEWEST, BINS_MOST = 5, 40
"""Least and greatest number of bars of a histogram; between them, it is twice the square root of the number of runs.
Chosen.
"""
FEW, FEWEST = 20, 5
"""Number of values from which a histogram replaces dots, and from which a figure without a criterion is not folded.
Chosen.
"""
FIRST_MOST = 6
"""Maximum number of figures that are not folded. Chosen: one screen of the page."""
_CROWD = 0.5
"""Share of the runs in one bar from which on the heights are logarithmic. Chosen."""
_DOT, _PILE = 8, 44
"""Diameter of a dot with the gap to the next, and height of the highest pile of dots, px. Chosen."""
_NOTHING = 1e-9
"""Magnitude below which a value is rounding, and is displayed as 0. Chosen."""
_WIDTH, _HEIGHT, _FOOT = 320, 90, 16
"""Width and height of a histogram, and height of the line of text below it, px. Chosen."""


def distributions(plan: Plan, runs: Sequence[Done]) -> str:
    """Render the distribution of each figure, beginning with the figures that have a criterion, the true force, and
    then those with the most information. Figures with one value in all runs share a line of text. Figures of very few
    runs are folded, and all beyond FIRST_MOST.
    """
    limits = {one.figure: one.limits for one in plan.criteria}
    missing = {one.figure: [run for run in runs if one.judge(run.figures) is False] for one in plan.criteria}
    first: list[str] = []
    more: list[str] = []
    same: list[str] = []
    known = {key: values for key in NUMBERS if (values := values_of(key, runs))}
    ranks = {key: (key not in limits, key != FORCE, -_information(values)) for key, values in known.items()}
    for key in sorted(known, key=ranks.__getitem__):
        values = known[key]
        if values[0] == values[-1] and math.isfinite(values[0]) and len(values) > 1:
            same.append(f"{FIGURES[key].words} {FIGURES[key].text(values[0])}")
            continue
        folded = len(first) == FIRST_MOST or (len(values) < FEWEST and key not in limits)
        (more if folded else first).append(
            _distribution(key, values, limits.get(key, {}), values_of(key, missing.get(key, ())))
        )
    if not first and not more and not same:
        return "<p>none</p>"
    alike = f"<p>The same in all runs that have it: {escape('; '.join(same))}.</p>" if same else ""
    others = f"<h2>{len(more)} more figures</h2>{_side_by_side(more)}" if more else ""
    return f"{_side_by_side(first)}{alike}{fold(others, 'distributions')}"


def _information(values: Sequence[float]) -> float:
    """Return the entropy of the histogram of values, bit."""
    finite = [value for value in values if math.isfinite(value)]
    if len(finite) < FEWEST or finite[0] == finite[-1]:
        return 0.0
    drawn = _drawn(finite)
    shares = [count / len(drawn) for count in _bins(drawn, drawn[0], drawn[-1] - drawn[0])[0].values()]
    return -sum(share * math.log2(share) for share in shares)


def _bins(values: Sequence[float], low: float, span: float) -> tuple[Counter[int], int]:
    """Return the number of values in each bar of a histogram, and the number of bars."""
    bins = min(max(math.ceil(2.0 * math.sqrt(len(values))), BINS_FEWEST), BINS_MOST)
    return Counter(min(int((value - low) / (span or 1.0) * bins), bins - 1) for value in values), bins


def _side_by_side(figures: Sequence[str]) -> str:
    return f'<div class="figures">{"".join(figures)}</div>' if figures else ""


def _distribution(
    key: str, values: Sequence[float], bounds: Mapping[str, float], bad: Sequence[float]
) -> str:
    one, finite = FIGURES[key], [value for value in values if math.isfinite(value)]
    title = f"<strong>{escape(one.title)}</strong><br>{escape(one.how)} <code>{key}</code>"
    endless = len(values) - len(finite)
    if not finite:
        return f"<figure><figcaption>{title}<br>{_runs(endless)}: {one.infinite}</figcaption></figure>"
    low, high = finite[0], finite[-1]
    drawn = _drawn(finite)
    median, late = statistics.median(finite), finite[math.ceil(0.99 * len(finite)) - 1]
    counts = _runs(len(finite)) + (f", and {endless} {one.infinite}" if endless else "")
    picture = _Picture(key, drawn, bounds, bad)
    allowed = "".join(f"; required: {_bound_text(word, bounds[word])}" for word in picture.far)
    named = [("median", median)] if len(finite) < FEW else [("median", median), ("99 % ≤", late)]
    outside = len(drawn) < len(finite) or any(not low <= bound <= high for bound in bounds.values())
    if outside:  # otherwise they are the ends of the axis
        named += [("least", low), ("largest", high)]
    beyond = f"; {len(finite) - len(drawn)} outside the axis" * (len(drawn) < len(finite))
    numbers = (
        ", ".join(f"{name} {_number(value, bounds.values())}" for name, value in named) + beyond + allowed
    )
    return (
        f"<figure><figcaption>{title}</figcaption>{picture.draw()}"
        f"<figcaption>{counts}: {numbers}</figcaption></figure>"
    )


def _drawn(values: Sequence[float]) -> Sequence[float]:
    """Return the sorted values without the outermost hundredth at an end where it would take half of the axis."""
    cut = len(values) // 100
    first, last = values[cut], values[-1 - cut]
    span = last - first
    start = cut if first - values[0] > span > 0.0 else 0
    end = len(values) - cut if values[-1] - last > span > 0.0 else len(values)
    return values[start:end]


def _runs(count: int) -> str:
    return f"{count} run{'s' * (count > 1)}"


def _number(value: float, bounds: Iterable[float] = ()) -> str:
    """Format a value with three significant digits; a count, exactly."""
    value = 0.0 if abs(value) < _NOTHING else value
    if abs(value) >= _COUNT_MOST:
        return f"{value:.2e}".replace("-", "−")
    return number(value, 6) if value == round(value) else three_digits(value, bounds)


def _bound_text(word: str, bound: float) -> str:
    return f"{word.replace('_', ' ')} {bound:g}"


class _Picture:
    """Distribution as SVG, with bars or dots, and bounds. Colours come from CSS classes, since a live page forbids
    inline styles.
    """

    def __init__(
        self, key: str, values: Sequence[float], bounds: Mapping[str, float], bad: Sequence[float]
    ) -> None:
        """Create a picture. The axis is extended to a bound that is close to the range of the values. `bad` are the
        values that do not meet their criterion.
        """
        low, high = values[0], values[-1]
        span = high - low or abs(high) or 1.0
        self._near = {word: b for word, b in bounds.items() if low - span < b < high + span}
        self.far = tuple(word for word in bounds if word not in self._near)
        """Bounds that the picture does not draw."""
        self._bad = Counter(bad)
        self._pad = _DOT / 2 if len(values) < FEW else 0.0
        """Margin at both ends of the axis, px: the radius of a dot."""
        self._low = min([low, *self._near.values()])
        self._high = max([high, *self._near.values()])
        self._span = self._high - self._low or 1.0
        self._key, self._values = key, values
        self._room = (18 if self._near else 8) + 10 * (len(values) >= FEW)
        """Height above the tallest bar or pile, px; the labels of a bound and of the number of runs need more."""

    def draw(self) -> str:
        """Return the SVG."""
        marks, base = self._bars() if len(self._values) >= FEW else self._dots()
        height = base + _FOOT
        foot = height - 3
        parts = [
            *marks,
            f'<path d="M0 {base}H{_WIDTH}"/><text x="0" y="{foot}">{_number(self._low)}</text>',
            f'<text x="{_WIDTH}" y="{foot}" text-anchor="end">{_number(self._high)}</text>',
        ]
        for word, bound in self._near.items():
            at = self._x(bound)
            parts.append(f'<line x1="{at:.1f}" x2="{at:.1f}" y1="0" y2="{base}"/>')
            side, anchor = (at - 4, "end") if at > _WIDTH / 2 else (at + 4, "start")
            text = _bound_text(word, bound)
            parts.append(f'<text class="bound" x="{side:.1f}" y="10" text-anchor="{anchor}">{text}</text>')
        label = f"distribution of {self._key}, over all runs"
        return f'<svg viewBox="0 0 {_WIDTH} {height}" role="img" aria-label="{label}">{"".join(parts)}</svg>'

    def _x(self, value: float) -> float:
        return self._pad + (value - self._low) / self._span * (_WIDTH - 2.0 * self._pad)

    def _bars(self) -> tuple[list[str], int]:
        """Return the bars from the smallest to the largest value, and the height of the axis."""
        low, span = self._low, self._span
        counts, bins = _bins(self._values, low, span)
        top, width = max(counts.values()), _WIDTH / bins
        crowded = top > _CROWD * len(self._values)

        def height_of(count: int) -> float:
            share = math.log1p(count) / math.log1p(top) if crowded else count / top
            return max(1.5, (_HEIGHT - self._room) * share)

        parts = []
        marked = [10**power for power in range(1, int(math.log10(top)) + 1)] if crowded else [top]
        for count in marked:
            y = _HEIGHT - height_of(count)
            label = _runs(count) + ", logarithmic" * crowded if count == marked[-1] else f"{count}"
            parts.append(f'<path class="grid" d="M0 {y:.1f}H{_WIDTH}"/>')
            parts.append(f'<text x="{_WIDTH}" y="{y - 2:.1f}" text-anchor="end">{label}</text>')
        for place, count in sorted(counts.items()):
            height = height_of(count)
            first = low + place * span / bins
            title = f"{_runs(count)} from {_number(first)} to {_number(first + span / bins)}"
            parts.append(
                f'<rect x="{place * width:.1f}" y="{_HEIGHT - height:.1f}" width="{width - 1:.1f}"'
                f' height="{height:.1f}"><title>{title}</title></rect>'
            )
        return parts, _HEIGHT

    def _dots(self) -> tuple[list[str], int]:
        """Return a dot for each value, on top of dots that it would hide, and the height of the axis."""
        ends: list[float] = []  # place of the last dot of each row, px, the lowest row first
        dots = []
        for value in self._values:
            at = self._x(value)
            row = next((row for row, end in enumerate(ends) if at - end >= _DOT), len(ends))
            ends[row:] = [at, *ends[row + 1 :]]
            dots.append((value, at, row))
        base, step = self._room + _PILE, min(_DOT, _PILE / len(ends))
        parts = []
        for value, at, row in dots:
            y = base - _DOT / 2 - step * row
            style = ' class="bad"' * (self._bad[value] > 0)
            self._bad[value] -= 1
            parts.append(
                f'<circle{style} cx="{at:.1f}" cy="{y:.1f}" r="{_DOT / 2 - 0.5}">'
                f"<title>{_number(value)}</title></circle>"
            )
        return parts, base
