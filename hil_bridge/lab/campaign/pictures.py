"""Pictures of a campaign's page: the matrix, and how often each figure had each value."""

import math
import statistics
from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape

from hil_bridge.lab.campaign.criteria import BOUNDS, Criterion
from hil_bridge.lab.campaign.drawing import faults_of_cell
from hil_bridge.lab.campaign.plan import Plan, faults_of_table
from hil_bridge.lab.campaign.store import Done
from hil_bridge.lab.campaign.telling import fault_of
from hil_bridge.record.analysis.figures import FIGURES, JUDGED, WORDS

BINS = 40
"""Bars of a distribution. Chosen."""
_WIDTH, _HEIGHT, _FOOT = 320, 90, 16
"""Of a distribution's bars, and of the line of text below them. Chosen."""
FIRST_PHASE = "connect"
"""Phase of a fault that names none."""
PLOTTED = tuple(name for name in JUDGED if name not in WORDS)
"""Figures that are numbers."""


def matrix(plan: Plan, runs: Sequence[Done]) -> str:
    """Faults down, cells of the matrix across: how many runs of each case passed."""
    done = Counter(run.number for run in runs)
    passed = Counter(run.number for run in runs if run.passed)
    cells = list(dict.fromkeys((case.cell, case.head) for case in plan.cases))
    by_fault: dict[str, dict[str, int]] = {}
    for number, case in enumerate(plan.cases):
        by_fault.setdefault(fault_of(case), {})[case.cell] = number

    def field(number: int | None) -> str:
        if number is None or plan.cases[number].impossible:
            return '<td class="none" title="cannot be">·</td>'
        if not done[number]:
            return '<td class="none" title="no run yet">?</td>'
        if passed[number] == done[number]:
            return f'<td class="pass">{done[number]}</td>'
        return f'<td class="fail">{passed[number]}/{done[number]}</td>'

    apart = len({head for _, head in cells}) == len(cells)
    heads = "".join(
        f'<th title="{escape(cell)}"><span>{escape(head if apart else cell)}</span></th>'
        for cell, head in cells
    )
    rows = "".join(
        f"<tr><th>{escape(fault)}</th>{''.join(field(numbers.get(cell)) for cell, _ in cells)}</tr>\n"
        for fault, numbers in by_fault.items()
    )
    return f'<div class="scroll"><table class="matrix"><tr><th>fault and phase</th>{heads}</tr>\n{rows}</table></div>'


def injections(plan: Plan, runs: Sequence[Done]) -> tuple[str, list[str]]:
    """Faults down, phases across: in how many runs each was planned, and how many of these passed; and the names of
    the empty fields.
    """
    done: Counter[tuple[str, str, str]] = Counter()
    passed: Counter[tuple[str, str, str]] = Counter()
    for run in runs:
        for fault in faults_of_table(run.table):
            place = fault["on"], fault["fault"], fault.get("phase", "") or FIRST_PHASE
            done[place] += 1
            passed[place] += run.passed
    planned = drawn_faults(plan)
    phases = list(dict.fromkeys(phase for names in planned.values() for phase in names))
    rows, empty = [], []
    for (target, title), possible in planned.items():
        name, fields = f"{target}: {title}", []
        for phase in phases:
            place = target, title, phase
            if phase not in possible:
                fields.append('<td class="none" title="not planned">·</td>')
            elif not done[place]:
                fields.append('<td class="none" title="no run yet">?</td>')
                empty.append(f"{name} in {phase}")
            elif passed[place] == done[place]:
                fields.append(f'<td class="pass">{done[place]}</td>')
            else:
                fields.append(f'<td class="fail">{passed[place]}/{done[place]}</td>')
        rows.append(f"<tr><th>{escape(name)}</th>{''.join(fields)}</tr>\n")
    heads = "".join(f"<th>{escape(phase)}</th>" for phase in phases)
    table = f'<table class="matrix"><tr><th>fault</th>{heads}</tr>\n{"".join(rows)}</table>'
    return f'<div class="scroll">{table}</div>', empty


def drawn_faults(plan: Plan) -> dict[tuple[str, str], list[str]]:
    """Phases in which each fault may be drawn, by its target and its name; over all cells."""
    assert plan.draw is not None
    planned: dict[tuple[str, str], list[str]] = {}
    for config in dict.fromkeys(case.config for case in plan.cases):
        for fault in faults_of_cell(plan.draw, config):
            phases = fault.get("phase", "")
            names = phases if isinstance(phases, list) else [phases]
            told = planned.setdefault((fault["on"], fault["fault"]), [])
            told += [name or FIRST_PHASE for name in names if (name or FIRST_PHASE) not in told]
    return planned


def distributions(criteria: Sequence[Criterion], runs: Sequence[Done]) -> str:
    """A picture of each figure, with the bounds that the criteria set."""
    wanted = {criterion.figure: criterion.wanted for criterion in criteria}
    parts = []
    for name in PLOTTED:
        found = [float(value) for run in runs if isinstance(value := run.figures.get(name), (int, float))]
        values = sorted(filter(math.isfinite, found))
        if found:
            parts.append(_distribution(name, values, len(found) - len(values), _bounds(wanted.get(name))))
    return f'<div class="figures">{"".join(parts)}</div>' if parts else "<p>none</p>"


def _bounds(wanted: object) -> Mapping[str, float]:
    return (
        {name: float(wanted[name]) for name in BOUNDS if name in wanted} if isinstance(wanted, dict) else {}
    )


def _distribution(name: str, values: Sequence[float], endless: int, bounds: Mapping[str, float]) -> str:
    one = FIGURES[name]
    title = f"<strong>{escape(one.title)}</strong> <code>{name}</code><br>{escape(one.how)}"
    if not values:
        return f"<figure><figcaption>{title}<br>{endless} runs, all without an end</figcaption></figure>"
    low, high = values[0], values[-1]
    median, late = statistics.median(values), values[math.ceil(0.99 * len(values)) - 1]
    counts = f"{len(values)} runs" + (f", and {endless} without an end" if endless else "")
    wanted = "".join(f"; wanted {_in_words(word, bound)}" for word, bound in bounds.items())
    numbers = f"median {median:.4g}, 99 % ≤ {late:.4g}, least {low:.4g}, largest {high:.4g}{wanted}"
    return (
        f"<figure><figcaption>{title}</figcaption>"
        f"{_bars(name, values, bounds)}<figcaption>{counts}: {numbers}</figcaption></figure>"
    )


def _in_words(word: str, bound: float) -> str:
    return f"{word.replace('_', ' ')} {bound:g}"


def _bars(name: str, values: Sequence[float], bounds: Mapping[str, float]) -> str:
    """Bars from the least to the largest value. A bound that lies not far beyond them widens the picture to it."""
    low, high = values[0], values[-1]
    span = high - low or abs(high) or 1.0
    near = [bound for bound in bounds.values() if low - span < bound < high + span]
    low, high = min([low, *near]), max([high, *near])
    span = high - low or 1.0
    counts = Counter(min(int((value - low) / span * BINS), BINS - 1) for value in values)
    top, width = max(counts.values()), _WIDTH / BINS
    drawn = []
    for place, count in sorted(counts.items()):
        height = max(1.5, (_HEIGHT - 8) * count / top)
        first = low + place * span / BINS
        title = f"{count} runs from {first:.4g} to {first + span / BINS:.4g}"
        drawn.append(
            f'<rect x="{place * width:.1f}" y="{_HEIGHT - height:.1f}" width="{width - 1:.1f}" height="{height:.1f}">'
            f"<title>{title}</title></rect>"
        )
    for word, bound in bounds.items():
        if bound in near:
            at = (bound - low) / span * _WIDTH
            drawn.append(f'<line x1="{at:.1f}" x2="{at:.1f}" y1="0" y2="{_HEIGHT}"/>')
            side, anchor = (at - 4, "end") if at > _WIDTH / 2 else (at + 4, "start")
            text = _in_words(word, bound)
            drawn.append(f'<text class="bound" x="{side:.1f}" y="10" text-anchor="{anchor}">{text}</text>')
    foot = _HEIGHT + _FOOT - 3
    drawn.append(f'<path d="M0 {_HEIGHT}H{_WIDTH}"/><text x="0" y="{foot}">{low:.4g}</text>')
    drawn.append(f'<text x="{_WIDTH}" y="{foot}" text-anchor="end">{high:.4g}</text>')
    box = f"0 0 {_WIDTH} {_HEIGHT + _FOOT}"
    return f'<svg viewBox="{box}" role="img" aria-label="distribution of {name}">{"".join(drawn)}</svg>'
