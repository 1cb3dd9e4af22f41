"""Matrices on a campaign's page: faults by cell, and faults by phase."""

import math
import statistics
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from itertools import product
from typing import NamedTuple

from hil_bridge.lab.campaign.criteria import value_text
from hil_bridge.lab.campaign.digest import FORCE, most_missed, share_of_bound, values_of
from hil_bridge.lab.campaign.drawing import faults_of_cell
from hil_bridge.lab.campaign.plan import NO_FAULT, Plan, faults_of_table
from hil_bridge.lab.campaign.run_text import fault_of
from hil_bridge.lab.campaign.store import Done
from hil_bridge.record.analysis.figures import FIGURES
from hil_bridge.show.report.markup import across

UPRIGHT_MOST = 8
"""Maximum number of columns with upright headings and two values in a field; above it, headings are vertical. Chosen:
the width of a page.
"""
_LABEL_MOST = 16
"""Length of a heading up to which three fields are side by side on a phone, instead of two. Chosen."""
FIRST_PHASE = "connect"
"""Label of the phase for a fault that specifies no phase."""
_SHADES, _SHARE_MOST = 6, 3.0
"""Number of shades, as many as in the style sheet, and largest multiple of a bound that they distinguish. Chosen."""
_LEAST = {"pass": 0, "fail": 2}
"""Lightest shade of fields. Chosen: a failed case is visible at any value."""


class _Layout(NamedTuple):
    """Rows and columns of a matrix, with the number of the case in each of its fields."""

    corner: str
    over: str
    """Heading over all columns."""
    rows: Mapping[str, str]
    """Displayed text of each row, by its label in `numbers`."""
    columns: Mapping[str, str]
    numbers: Mapping[tuple[str, str], int]


class _Measure(NamedTuple):
    """Figure by which the fields of a matrix are shaded, by number of the case."""

    texts: Mapping[int, str]
    shares: Mapping[int, float]
    """Value as a share of its bound, or the reverse for a least value; empty without a bound."""
    words: str


def matrix(plan: Plan, runs: Sequence[Done]) -> str:
    """Render the number of passed runs of each case, shaded by the figure that most failed runs missed, or by the true
    force, and what the signs and the shades mean.

    With a single fault, the columns are the values of one axis; otherwise they are the cells or the faults, whichever
    fit a page.
    """
    by_case: dict[int, list[Done]] = {}
    for run in runs:
        by_case.setdefault(run.number, []).append(run)
    layout, measure = _layout_of(plan), _measure_of(plan, runs, by_case)
    top = min(max([1.0, *measure.shares.values()]), _SHARE_MOST)

    def field(row: str, column: str) -> str:
        number, title = layout.numbers.get((row, column)), layout.columns[column]
        if number is None or plan.cases[number].impossible:
            return f'<td class="none" title="impossible" data-title="{escape(title)}">·</td>'
        done = by_case.get(number, [])
        share = measure.shares[number] / top if number in measure.shares else None
        text = measure.texts.get(number, "") * (len(layout.columns) <= UPRIGHT_MOST)
        return _counts(sum(run.passed for run in done), len(done), title, text, share)

    rows = [(text, [field(row, column) for column in layout.columns]) for row, text in layout.rows.items()]
    note = f"Runs that passed / runs{measure.words}."
    faults = {*map(fault_of, plan.cases)}
    note += f" Fault of every case: {min(faults)}." * (len(faults) == 1 and faults != {NO_FAULT})
    note += " · the cell does not support the fault." * (len(plan.possible) < len(plan.cases))
    note += " ? no run yet." * any(
        plan.cases[n].impossible == "" for n in {*range(len(plan.cases))} - {*by_case}
    )
    styles = ["pass"] * any(run.passed for run in runs) + ["fail"] * any(not run.passed for run in runs)
    levels = ((style, level) for style in styles for level in range(_LEAST[style], _SHADES))
    shades = "".join(f'<i class="{style} l{level}"></i>' for style, level in levels)
    end = f"{top:.2g} × bound" if top > 1.0 else "bound"
    scale = f' <span class="shades">0 {shades} {end}</span>' if measure.shares else ""
    table = _table((layout.corner, layout.over), list(layout.columns.values()), rows)
    return f'{table}<p class="quiet small">{escape(note)}{scale}</p>'


def _measure_of(plan: Plan, runs: Sequence[Done], by_case: Mapping[int, Sequence[Done]]) -> _Measure:
    """Return the median of the figure that most failed runs missed if its bound is positive, otherwise the largest true
    force with the largest share of its bound.
    """
    missed = [most_missed(plan, runs)[1], *(one for one in plan.criteria if one.figure == FORCE)]
    criterion = next((one for one in missed if one and min(one.limits.values(), default=0.0) > 0.0), None)
    key = criterion.figure if criterion else FORCE
    sought, name = (max, "the") if key == FORCE else (statistics.median, "median of")
    values = {case: sought(known) for case, done in by_case.items() if (known := values_of(key, done))}
    texts = {
        case: value_text(key, value, plan.criteria) if math.isfinite(value) else FIGURES[key].infinite
        for case, value in values.items()
    }
    words = f", with {name} {FIGURES[key].words}"
    if criterion:
        ((word, bound), *_) = criterion.limits.items()
        least = word in ("above", "at_least")
        shares = {
            case: value / bound if not least else bound / value if value > 0.0 else _SHARE_MOST
            for case, value in values.items()
        }
        return _Measure(texts, shares, f"{words} (required: {criterion.required})")
    shares = {}
    for run in runs:
        if run.number in texts and (share := share_of_bound(run)):
            shares[run.number] = max(shares.get(run.number, 0.0), share)
    texts |= {case: f"{texts[case]} · {100.0 * share:.0f} %" for case, share in shares.items()}
    meaning = " and the largest share of its bound: what guard, robot and sensor permit, and its faults add"
    return _Measure(texts, shares, words + meaning * bool(shares))


def _layout_of(plan: Plan) -> _Layout:
    """Choose the rows and columns of the matrix."""
    faults = list(dict.fromkeys(map(fault_of, plan.cases)))
    cells = list(dict.fromkeys(case.cell for case in plan.cases))
    axes = plan.axes or [
        tuple(dict.fromkeys(one)) for one in zip(*(cell.split(", ") for cell in cells), strict=False)
    ]
    sizes = {len(axis): place for place, axis in enumerate(axes) if len(axis) <= UPRIGHT_MOST}
    if len(axes) > 1 and sizes and [*map(", ".join, product(*axes))] == [case.cell for case in plan.cases]:
        place = sizes[max(sizes)]
        fields = [
            (", ".join((*labels[:place], *labels[place + 1 :])), labels[place]) for labels in product(*axes)
        ]
        corner, rows = _shortened(row for row, _ in fields)
        over, columns = _shortened(axes[place])
        return _Layout(corner, over, rows, columns, {field: number for number, field in enumerate(fields)})
    words, short = _shortened(cells)
    names = dict(zip(faults, faults, strict=True))
    if len(cells) > UPRIGHT_MOST >= len(faults):
        by_cell = {(case.cell, fault_of(case)): number for number, case in enumerate(plan.cases)}
        return _Layout(words or "cell", "fault and phase", short, names, by_cell)
    by_fault = {(fault_of(case), case.cell): number for number, case in enumerate(plan.cases)}
    return _Layout("fault and phase", words, names, short, by_fault)


def _shortened(labels: Iterable[str]) -> tuple[str, dict[str, str]]:
    """Return the words with which the parts of all labels begin, such as `robot, sensor`, and each label without them;
    no words, and the labels as they are, if they do not share them.
    """
    parts = {label: [part.partition(" ") for part in label.split(", ")] for label in labels}
    words = {", ".join(word for word, _, _ in one) for one in parts.values()}
    if len(words) != 1 or not all(rest for one in parts.values() for _, _, rest in one):
        return "", {label: label for label in parts}
    return words.pop(), {label: ", ".join(rest for _, _, rest in one) for label, one in parts.items()}


def injections(plan: Plan, runs: Sequence[Done]) -> str:
    """Render the number of runs for which each fault was drawn in each phase, and how many of these runs passed."""
    done: Counter[tuple[str, str, str]] = Counter()
    passed: Counter[tuple[str, str, str]] = Counter()
    for run in runs:
        for fault in faults_of_table(run.table):
            place = fault["on"], fault["fault"], fault.get("phase", "") or FIRST_PHASE
            done[place] += 1
            passed[place] += run.passed
    planned = drawn_faults(plan)
    phases = list(dict.fromkeys(phase for names in planned.values() for phase in names))
    rows: list[tuple[str, Sequence[str]]] = []
    for (target, title), possible in planned.items():
        fields = [
            _counts(passed[place], done[place], phase)
            if phase in possible
            else f'<td class="none" title="not planned" data-title="{escape(phase)}">·</td>'
            for phase in phases
            for place in [(target, title, phase)]
        ]
        rows.append((f"{target}: {title}", fields))
    return _table(("fault", "phase"), phases, rows)


def _table(heads: tuple[str, str], columns: Sequence[str], rows: Iterable[tuple[str, Sequence[str]]]) -> str:
    """Render a matrix below the headings of its rows and of all columns. A matrix with one column is a list; headings
    of many columns are vertical, and such a matrix may scroll sideways.
    """
    few, (corner, over) = len(columns) <= UPRIGHT_MOST, map(escape, heads)
    titles = "".join(f"<th><span>{escape(name).replace('_', '_<wbr>')}</span></th>" for name in columns)
    body = "".join(
        f'<tr><th data-title="{corner}">{escape(name)}</th>{"".join(fields)}</tr>\n' for name, fields in rows
    )
    style = "matrix list" if len(columns) == 1 else "matrix few" if few else "matrix"
    style += " broad" * (len(columns) == 2 or max(map(len, columns)) > _LABEL_MOST)
    left = f'<th rowspan="{1 + bool(over)}">{corner}</th>'
    top = f'{left}<th class="over" colspan="{len(columns)}">{over}</th></tr><tr>' if over else left
    table = f'<table class="{style}"><thead><tr>{top}{titles}</tr></thead>\n{body}</table>'
    return table if few else across(table)


def _counts(passed: int, done: int, column: str, value: str = "", shade: float | None = None) -> str:
    """Render one field of a matrix: the number of runs that passed, the number of all runs, and a value."""
    style, text = ("pass" if passed == done else "fail", f"{passed}/{done}") if done else ("none", "?")
    if done and shade is not None:
        style += f" l{max(math.ceil(min(shade, 1.0) * (_SHADES - 1)), _LEAST[style])}"
    more = f"<small>{escape(value)}</small>" if value else ""
    return f'<td class="{style}" data-title="{escape(column)}"><b>{text}</b>{more}</td>'


def drawn_faults(plan: Plan) -> dict[tuple[str, str], list[str]]:
    """Return the phases in which each fault may be drawn in any cell, by target and name."""
    assert plan.draw is not None
    planned: dict[tuple[str, str], list[str]] = {}
    for config in dict.fromkeys(case.config for case in plan.cases):
        for fault in faults_of_cell(plan.draw, config):
            phases = fault.get("phase", "")
            names = phases if isinstance(phases, list) else [phases]
            known = planned.setdefault((fault["on"], fault["fault"]), [])
            known += [name or FIRST_PHASE for name in names if (name or FIRST_PHASE) not in known]
    return planned
