"""The page of a campaign, which needs nothing beside itself."""

import math
import shlex
import statistics
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from html import escape

from hil_bridge.campaign.criteria import FIGURES
from hil_bridge.campaign.plan import Case, Plan
from hil_bridge.campaign.store import Done, Store
from hil_bridge.report.markup import cells, pairs, table

WORST = 50
"""Runs that are listed, worst first. Chosen: a person reads no more."""
BINS = 24
"""Bars of a distribution. Chosen."""
_CSS = """
body { font: 15px/1.5 system-ui, "DejaVu Sans", sans-serif; color: #222; background: #fff;
       max-width: 1200px; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; margin-bottom: .3rem; } h2 { font-size: 1.15rem; margin: 2rem 0 .5rem; }
table { border-collapse: collapse; } .scroll { overflow: auto; max-height: 45rem; }
th, td { text-align: left; padding: .2rem .8rem .2rem 0; border-bottom: 1px solid #ddd; vertical-align: top; }
th { color: #555; } code { font-size: 13px; } p { max-width: 52rem; }
table.matrix td.count { text-align: right; padding: .2rem .6rem; font-variant-numeric: tabular-nums; }
td.pass { background: #d9efe6; } td.fail { background: #f6d5c3; font-weight: 600; } td.none { color: #888; }
td.value { text-align: right; font-variant-numeric: tabular-nums; font-weight: 600; }
svg { display: block; } svg rect { fill: #0072B2; }
"""
_PLOTTED = tuple(name for name in FIGURES if name not in ("outcome", "retracted"))


def page(store: Store) -> str:
    """The page as HTML, of what is kept so far."""
    plan, runs = store.plan(), list(store.runs())
    bad = [run for run in runs if not run.passed]
    lead = f"{len(runs)} of {plan.count} runs done: {len(runs) - len(bad)} passed, {len(bad)} failed."
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>Campaign {escape(plan.name)}</title>
<meta name="viewport" content="width=device-width, initial-scale=1"><style>{_CSS}</style></head><body>
<h1>Campaign {escape(plan.name)}</h1>
<p><strong>{lead}</strong></p>
{pairs(_facts(store, plan, runs))}
<h2>Criteria</h2>{_criteria(plan, runs)}
<h2>Runs that passed, of those done</h2>{_matrix(plan, runs)}
<h2>Worst runs first</h2>{_worst(store, plan, runs)}
<h2>How runs ended</h2>{_endings(runs)}
<h2>Distribution of the figures</h2>{_distributions(runs)}
<h2>Never exercised</h2>{_never(plan, runs)}
</body></html>
"""


def _facts(store: Store, plan: Plan, runs: Sequence[Done]) -> Iterator[tuple[str, str]]:
    yield "Code", store.fact("code")
    yield "Cases × seeds", f"{len(plan.possible)} × {len(plan.seeds)}"
    if plan.cases_per_seed:
        turns = Counter(case for case, _ in plan.runs())
        least, most = min(turns[case] for case in plan.possible), max(turns.values())
        told = (
            f"{least}"
            if least == most
            else f"{least} or {most}"
            if most == least + 1
            else f"{least} … {most}"
        )
        yield "Cases for each seed", f"{plan.cases_per_seed} in turn, so that each case has {told} seeds"
    sittings = store.sittings()
    count, wall_s = sum(one.runs for one in sittings), sum(one.wall_s for one in sittings)
    if wall_s > 0:
        core_s = sum(one.wall_s * one.workers for one in sittings)
        yield "Runs per second", f"{count / wall_s:.2f}, {count / core_s:.2f} for each process"
        yield "Time that was told", f"{count} runs in {wall_s:.0f} s, {len(sittings)} starts"
    simulated = sum(run.figures.get("duration_s") or 0.0 for run in runs)  # type: ignore[misc]
    if (busy_s := sum(run.wall_s for run in runs)) > 0:
        yield "Simulated time", f"{simulated:.0f} s, {simulated / busy_s:.1f} s in each second of a core"


def _criteria(plan: Plan, runs: Sequence[Done]) -> str:
    lines = []
    for criterion in plan.criteria:
        verdicts = Counter(criterion.judge(run.figures) for run in runs)
        lines.append((criterion.text, str(verdicts[True]), str(verdicts[False]), str(verdicts[None])))
    return cells(("criterion", "met", "not met", "did not concern the run"), lines, "narrow")


def _fault(case: Case) -> str:
    return f"{case.fault} {case.phase}".rstrip()


def _matrix(plan: Plan, runs: Sequence[Done]) -> str:
    """Cells of the matrix down, faults across."""
    done = Counter(run.number for run in runs)
    passed = Counter(run.number for run in runs if run.passed)
    faults = list(dict.fromkeys(map(_fault, plan.cases)))
    by_cell: dict[str, dict[str, int]] = {}
    for number, case in enumerate(plan.cases):
        by_cell.setdefault(case.cell, {})[_fault(case)] = number

    def row(cell: str, numbers: dict[str, int]) -> str:
        columns = [f"<td>{escape(cell)}</td>"]
        for fault in faults:
            number = numbers[fault]
            if plan.cases[number].impossible:
                columns.append('<td class="count none">cannot be</td>')
            elif not done[number]:
                columns.append('<td class="count none">no run</td>')
            else:
                style = "pass" if passed[number] == done[number] else "fail"
                columns.append(f'<td class="count {style}">{passed[number]}/{done[number]}</td>')
        return "".join(columns)

    head = "<tr>" + "".join(f"<th>{escape(text)}</th>" for text in ("cell", *faults)) + "</tr>"
    rows = (row(cell, numbers) for cell, numbers in by_cell.items())
    return f'<div class="scroll">{table(rows, "matrix", head)}</div>'


def _badness(run: Done) -> tuple[bool, int, float]:
    force = run.figures.get("force_true_max_n")
    return run.passed, -len(run.failed), -float(force) if isinstance(force, (int, float)) else 0.0


def _worst(store: Store, plan: Plan, runs: Sequence[Done]) -> str:
    """Failing runs by the number of criteria, then all by the true force, each with its command."""
    lines = []
    for run in sorted(runs, key=_badness)[:WORST]:
        case, force = plan.cases[run.number], run.figures.get("force_true_max_n")
        command = f"hil-bridge campaign rerun {shlex.quote(store.path.name)} {run.key}"
        recording = f"{store.folder.name}/{run.recording}" if run.recording else ""
        lines.append(
            f"<td>{'passed' if run.passed else escape('; '.join(run.failed))}</td>"
            f'<td class="value">{f"{force:.1f} N" if isinstance(force, float) else "–"}</td>'
            f"<td>{run.seed}</td><td>{escape(case.cell)}</td><td>{escape(_fault(case))}</td>"
            f"<td>{escape(f'{run.outcome}: {run.cause}' if run.cause else run.outcome)}</td>"
            f"<td><code>{escape(command)}</code> {escape(recording)}</td>"
        )
    titles = ("not met", "largest true force", "seed", "cell", "fault", "end", "repeat it with")
    head = "<tr>" + "".join(f"<th>{title}</th>" for title in titles) + "</tr>"
    return f'<div class="scroll">{table(lines, "wide", head)}</div>'


def _endings(runs: Iterable[Done]) -> str:
    counts = Counter(run.outcome for run in runs)
    return pairs((outcome, str(count)) for outcome, count in counts.most_common())


def _distributions(runs: Sequence[Done]) -> str:
    rows = []
    for name in _PLOTTED:
        values = sorted(
            float(value)
            for run in runs
            if isinstance(value := run.figures.get(name), (int, float)) and math.isfinite(value)
        )
        if not values:
            continue
        told = [values[0], statistics.median(values), values[round(0.99 * (len(values) - 1))], values[-1]]
        rows.append(
            f'<td>{name}<br>{escape(FIGURES[name])}</td><td class="value">{len(values)}</td>'
            + "".join(f'<td class="value">{value:.4g}</td>' for value in told)
            + f"<td>{_bars(values)}</td>"
        )
    titles = ("figure", "runs", "least", "median", "99 %", "largest", "from the least to the largest")
    return table(rows, "wide", "<tr>" + "".join(f"<th>{title}</th>" for title in titles) + "</tr>")


def _bars(values: Sequence[float]) -> str:
    """A small picture of how often each value came."""
    low, span = values[0], values[-1] - values[0]
    counts = [0] * BINS
    for value in values:
        counts[min(int((value - low) / span * BINS), BINS - 1) if span > 0 else 0] += 1
    top, bars = max(counts), []
    for place, count in enumerate(counts):
        if count:
            height = max(1.0, 36.0 * count / top)
            title = f"<title>{count} runs</title>"
            bars.append(
                f'<rect x="{place * 9}" y="{38 - height:.1f}" width="8" height="{height:.1f}">{title}</rect>'
            )
    return f'<svg width="{BINS * 9}" height="40" role="img">{"".join(bars)}</svg>'


def _never(plan: Plan, runs: Sequence[Done]) -> str:
    """Parts of the plan of which there are no results."""
    done, struck = Counter(run.number for run in runs), Counter[int]()
    for run in runs:
        if run.figures.get("struck"):
            struck[run.number] += 1
    lines: list[tuple[str, str, str, str]] = []
    for number, case in enumerate(plan.cases):
        if case.impossible:
            why = f"this cell cannot have it: {case.impossible}"
        elif not done[number]:
            why = "no run yet"
        elif case.table != "{}" and not struck[number]:
            why = f"the fault struck in none of {done[number]} runs"
        elif case.table != "{}" and struck[number] < done[number]:
            why = f"the fault struck in {struck[number]} of {done[number]} runs only"
        else:
            continue
        lines.append((case.cell, case.fault, case.phase, why))
    unjudged = [
        (criterion.text, "", "", "this criterion concerned no run")
        for criterion in plan.criteria
        if runs and all(criterion.judge(run.figures) is None for run in runs)
    ]
    return cells(("cell", "fault", "phase", "why"), unjudged + lines, "wide")
