"""Matrices on a campaign's page: faults by cell, and faults by phase."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from itertools import product
from typing import NamedTuple

from hil_bridge.lab.campaign.drawing import faults_of_cell
from hil_bridge.lab.campaign.plan import NO_FAULT, Plan, faults_of_table
from hil_bridge.lab.campaign.run_text import fault_of
from hil_bridge.lab.campaign.store import Done
from hil_bridge.show.report.markup import across

UPRIGHT_MOST = 8
"""Maximum number of columns with upright headings; above it, headings are vertical. Chosen: the width of a page."""
_LABEL_MOST = 16
"""Length of a heading up to which three fields are side by side on a phone, instead of two. Chosen."""
FIRST_PHASE = "connect"
"""Label of the phase for a fault that specifies no phase."""


class _Layout(NamedTuple):
    """Rows and columns of a matrix, with the number of the case in each of its fields."""

    corner: str
    rows: Sequence[str]
    columns: Sequence[str]
    numbers: Mapping[tuple[str, str], int]


def matrix(plan: Plan, runs: Sequence[Done]) -> str:
    """Render the number of passed runs of each case, and what the signs in it mean.

    With a single fault, the columns are the values of one axis; otherwise they are the cells or the faults, whichever
    fit a page.
    """
    done = Counter(run.number for run in runs)
    passed = Counter(run.number for run in runs if run.passed)
    layout = _layout_of(plan)

    def field(row: str, column: str) -> str:
        number = layout.numbers.get((row, column))
        if number is None or plan.cases[number].impossible:
            return f'<td class="none" title="impossible" data-title="{escape(column)}">·</td>'
        return _counts(passed[number], done[number], column)

    rows = [(row, [field(row, column) for column in layout.columns]) for row in layout.rows]
    note = "Runs that passed / runs."
    note += " · the cell does not support the fault." * (len(plan.possible) < len(plan.cases))
    note += " ? no run yet." * any(not case.impossible and not done[n] for n, case in enumerate(plan.cases))
    return f'{_table(layout.corner, layout.columns, rows)}<p class="quiet">{note}</p>'


def _layout_of(plan: Plan) -> _Layout:
    """Choose the rows and columns of the matrix."""
    faults = list(dict.fromkeys(map(fault_of, plan.cases)))
    cells = list(dict.fromkeys(case.cell for case in plan.cases))
    sizes = {len(axis): place for place, axis in enumerate(plan.axes) if len(axis) <= UPRIGHT_MOST}
    if len(plan.axes) > 1 and sizes and math.prod(map(len, plan.axes)) == len(plan.cases):
        place = sizes[max(sizes)]
        rows = [
            (", ".join((*labels[:place], *labels[place + 1 :])), labels[place])
            for labels in product(*plan.axes)
        ]
        corner = "" if faults == [NO_FAULT] else f"fault: {faults[0]}"
        numbers = {field: number for number, field in enumerate(rows)}
        return _Layout(corner, list(dict.fromkeys(row for row, _ in rows)), plan.axes[place], numbers)
    by_cell = {(case.cell, fault_of(case)): number for number, case in enumerate(plan.cases)}
    if len(cells) > UPRIGHT_MOST >= len(faults):
        return _Layout("cell", cells, faults, by_cell)
    heads = list(dict.fromkeys(case.head for case in plan.cases))
    titles = dict(zip(cells, heads if len(heads) == len(cells) > UPRIGHT_MOST else cells, strict=True))
    numbers = {(fault, titles[cell]): number for (cell, fault), number in by_cell.items()}
    return _Layout("fault and phase", faults, list(titles.values()), numbers)


def injections(plan: Plan, runs: Sequence[Done]) -> tuple[str, list[str]]:
    """Render the number of runs for which each fault was drawn in each phase, and how many of these runs passed.

    Rows are faults, and columns are phases. Returns the table, and the names of its empty fields.
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
    rows: list[tuple[str, Sequence[str]]] = []
    empty: list[str] = []
    for (target, title), possible in planned.items():
        name, fields = f"{target}: {title}", []
        for phase in phases:
            place = target, title, phase
            if phase not in possible:
                fields.append(f'<td class="none" title="not planned" data-title="{escape(phase)}">·</td>')
                continue
            fields.append(_counts(passed[place], done[place], phase))
            if not done[place]:
                empty.append(f"{name} in {phase}")
        rows.append((name, fields))
    return _table("fault", phases, rows), empty


def _table(corner: str, columns: Sequence[str], rows: Iterable[tuple[str, Sequence[str]]]) -> str:
    """Render a matrix. A matrix with one column is a list; headings above many columns are vertical, and such a matrix
    may scroll sideways.
    """
    few = len(columns) <= UPRIGHT_MOST
    heads = "".join(f"<th><span>{escape(name).replace('_', '_<wbr>')}</span></th>" for name in columns)
    body = "".join(f"<tr><th>{escape(name)}</th>{''.join(fields)}</tr>\n" for name, fields in rows)
    style = "matrix list" if len(columns) == 1 else "matrix few" if few else "matrix"
    style += " broad" * (len(columns) == 2 or max(map(len, columns)) > _LABEL_MOST)
    table = f'<table class="{style}"><thead><tr><th>{escape(corner)}</th>{heads}</tr></thead>\n{body}</table>'
    return table if few else across(table)


def _counts(passed: int, done: int, column: str) -> str:
    """Render one field of a matrix: the number of runs that passed, and the number of all runs."""
    style, text = ("pass" if passed == done else "fail", f"{passed}/{done}") if done else ("none", "?")
    return f'<td class="{style}" data-title="{escape(column)}">{text}</td>'


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
