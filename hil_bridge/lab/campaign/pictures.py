"""Matrices on a campaign's page: faults by cell, and faults by phase."""

from collections import Counter
from collections.abc import Sequence
from html import escape

from hil_bridge.lab.campaign.drawing import faults_of_cell
from hil_bridge.lab.campaign.plan import Plan, faults_of_table
from hil_bridge.lab.campaign.run_text import fault_of
from hil_bridge.lab.campaign.store import Done

UPRIGHT_MOST = 8
"""Maximum number of columns with upright headings; above it, headings are vertical. Chosen: the width of a page."""
FIRST_PHASE = "connect"
"""Label of the phase for a fault that specifies no phase."""


def matrix(plan: Plan, runs: Sequence[Done]) -> str:
    """Render the number of passed runs of each case, with faults as rows and cells of the matrix as columns; with a
    single fault and more cells than upright headings, the other way round.
    """
    done = Counter(run.number for run in runs)
    passed = Counter(run.number for run in runs if run.passed)
    cells = list(dict.fromkeys((case.cell, case.head) for case in plan.cases))
    by_fault: dict[str, dict[str, int]] = {}
    for number, case in enumerate(plan.cases):
        by_fault.setdefault(fault_of(case), {})[case.cell] = number

    def field(number: int | None) -> str:
        if number is None or plan.cases[number].impossible:
            return '<td class="none" title="impossible">·</td>'
        return _counts(passed[number], done[number])

    if len(by_fault) == 1 and len(cells) > UPRIGHT_MOST:
        ((fault, numbers),) = by_fault.items()
        rows = "".join(f"<tr><th>{escape(cell)}</th>{field(numbers.get(cell))}</tr>\n" for cell, _ in cells)
        return _scrolled("matrix few", f"<th>cell</th><th>{escape(fault)}</th>", rows)
    few = len(cells) <= UPRIGHT_MOST
    brief = not few and len({head for _, head in cells}) == len(cells)
    heads = "".join(
        f'<th title="{escape(cell)}"><span>{escape(head if brief else cell).replace("_", "_<wbr>")}</span></th>'
        for cell, head in cells
    )
    rows = "".join(
        f"<tr><th>{escape(fault)}</th>{''.join(field(numbers.get(cell)) for cell, _ in cells)}</tr>\n"
        for fault, numbers in by_fault.items()
    )
    return _scrolled("matrix few" if few else "matrix", f"<th>fault and phase</th>{heads}", rows)


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
    rows, empty = [], []
    for (target, title), possible in planned.items():
        name, fields = f"{target}: {title}", []
        for phase in phases:
            place = target, title, phase
            if phase not in possible:
                fields.append('<td class="none" title="not planned">·</td>')
                continue
            fields.append(_counts(passed[place], done[place]))
            if not done[place]:
                empty.append(f"{name} in {phase}")
        rows.append(f"<tr><th>{escape(name)}</th>{''.join(fields)}</tr>\n")
    heads = "".join(f"<th>{escape(phase)}</th>" for phase in phases)
    return _scrolled("matrix", f"<th>fault</th>{heads}", "".join(rows)), empty


def _scrolled(style: str, head: str, rows: str) -> str:
    """Render a matrix that scrolls sideways."""
    return f'<div class="scroll"><table class="{style}"><tr>{head}</tr>\n{rows}</table></div>'


def _counts(passed: int, done: int) -> str:
    """Render one field of a matrix: the number of runs that passed, and the number of all runs."""
    if not done:
        return '<td class="none" title="no run yet">?</td>'
    return f'<td class="{"pass" if passed == done else "fail"}">{passed}/{done}</td>'


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
