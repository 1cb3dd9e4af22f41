"""The page of a campaign, which needs nothing beside itself."""

import json
import shlex
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from html import escape

from hil_bridge.devices.kinds import EmulatedKinds
from hil_bridge.errors import BridgeError, ConfigError
from hil_bridge.lab.campaign.criteria import figure_text
from hil_bridge.lab.campaign.pictures import distributions, drawn_faults, injections, matrix
from hil_bridge.lab.campaign.plan import Plan
from hil_bridge.lab.campaign.store import Done, Store
from hil_bridge.lab.campaign.telling import describe_run, fault_of, faults_of_run, settings_of_run
from hil_bridge.record import read
from hil_bridge.record.analysis.why import why
from hil_bridge.show.pages import document
from hil_bridge.show.report.markup import cells, pairs, prose

WORST, OPEN = 30, 5
"""Failing runs that are told one by one, worst first, and those that need no click. Chosen: a person reads no more."""
HARDEST = 10
"""Passing runs that are told, the largest true force first. Chosen."""


def page(store: Store) -> str:
    """The page as HTML, of what is kept so far."""
    plan, runs = store.plan(), list(store.runs())
    bad = sum(not run.passed for run in runs)
    hunted = _render_hunt(store, plan)
    of_all = "" if hunted else f" of {plan.count}"
    lead = f"{len(runs)}{of_all} runs done: {len(runs) - bad} passed, {bad} failed."
    body = f"""<h1>Campaign {escape(plan.name)}</h1>
<p><strong>{lead}</strong></p>
{pairs(_facts(store, plan, runs), "facts")}
{hunted}
<h2>Criteria</h2><div class="scroll">{_criteria(plan, runs)}</div>
<h2>Worst runs first</h2>{_worst(store, plan, runs)}
<h2>Each case of the matrix</h2>
<p class="quiet">Number of runs where all passed; else how many passed, of how many. A dot is a fault that the cell
cannot have, a question mark a case without a run.</p>
{matrix(plan, runs)}
{_render_injections(plan, runs)}
<h2>How runs ended</h2>{_endings(runs)}
<h2>Distribution of the figures</h2>{distributions(plan.criteria, runs)}
<h2>Never exercised</h2>{_never(plan, runs)}"""
    return document(f"Campaign {plan.name}", body, charts=False)


def _facts(store: Store, plan: Plan, runs: Sequence[Done]) -> Iterator[tuple[str, str]]:
    yield "Code", store.fact("code")
    if not plan.cases_per_seed:
        yield "Cases × seeds", f"{len(plan.possible)} × {len(plan.seeds)}"
    else:
        yield "Cases and seeds", f"{len(plan.possible)} cases, {len(plan.seeds)} seeds"
        turns = Counter(case for case, _ in plan.runs())
        least, most = min(turns[case] for case in plan.possible), max(turns.values())
        told = (
            f"{least}"
            if least == most
            else f"{least} or {most}"
            if most == least + 1
            else f"{least} … {most}"
        )
        yield "Cases for each seed", f"{plan.cases_per_seed} in turn; seeds for each case: {told}"
    sittings = store.sittings()
    count, wall_s = sum(one.runs for one in sittings), sum(one.wall_s for one in sittings)
    if wall_s > 0:
        core_s = sum(one.wall_s * one.workers for one in sittings)
        yield "Runs per second", f"{count / wall_s:.2f}, {count / core_s:.2f} for each process"
        starts = "one start" if len(sittings) == 1 else f"{len(sittings)} starts"
        yield "Time", f"{count} runs in {wall_s:.0f} s, {starts}"
    simulated = sum(run.figures.get("duration_s") or 0.0 for run in runs)  # type: ignore[misc]
    if (busy_s := sum(run.wall_s for run in runs)) > 0:
        yield "Simulated time", f"{simulated:.0f} s, {simulated / busy_s:.1f} s in each second of a core"


def _criteria(plan: Plan, runs: Sequence[Done]) -> str:
    lines = []
    for criterion in plan.criteria:
        verdicts = Counter(criterion.judge(run.figures) for run in runs)
        lines.append((criterion.text, str(verdicts[True]), str(verdicts[False]), str(verdicts[None])))
    return cells(("criterion", "met", "not met", "did not concern the run"), lines, "narrow")


def _force(run: Done) -> float:
    force = run.figures.get("force_true_max_n")
    return float(force) if isinstance(force, (int, float)) else 0.0


def _worst(store: Store, plan: Plan, runs: Sequence[Done]) -> str:
    """Failing runs by the number of criteria, then by the true force; behind them passing ones by the true force."""
    failing = sorted(
        (run for run in runs if not run.passed), key=lambda run: (-len(run.failed), -_force(run))
    )
    told = "".join(_failing(store, plan, run) for run in failing[:OPEN])
    if more := "".join(_failing(store, plan, run) for run in failing[OPEN:WORST]):
        words = f"{len(failing) - OPEN} more that failed" + (
            f", the first {WORST - OPEN} of them" * (len(failing) > WORST)
        )
        told += f"<details><summary>{words}</summary>{more}</details>"
    hardest = sorted((run for run in runs if run.passed), key=_force, reverse=True)[:HARDEST]
    lines = [
        (
            f"{_force(run):.1f} N",
            f"{run.seed}",
            plan.cases[run.number].cell,
            faults_of_run(plan.cases[run.number], run),
            run.key,
        )
        for run in hardest
    ]
    passing = cells(("largest true force", "seed", "cell", "fault", "key"), lines, "wide")
    intro = f"<p>Of those that passed, these pressed the hardest; {_command(store, 'KEY')} repeats one.</p>"
    return f'{told or "<p>Every run met its criteria.</p>"}{intro}<div class="scroll">{passing}</div>'


def _command(store: Store, key: str) -> str:
    return f"<code>hil-bridge campaign rerun {escape(shlex.quote(store.path.name))} {key}</code>"


def _failing(store: Store, plan: Plan, run: Done) -> str:
    case = plan.cases[run.number]
    ended = f"{run.outcome}: {run.cause}" if run.cause else run.outcome
    return (
        f"<article><p><strong>Not met: {escape('; '.join(run.failed))}</strong><br>"
        f"{escape(case.cell)}; {escape(faults_of_run(case, run))}; seed {run.seed}</p>"
        f"{_render_drawn(run)}"
        f"<p>{prose(_why(store, run) or ended)}</p>"
        f'<p class="quiet">Largest true force {_force(run):.1f} N. Repeat it with {_command(store, run.key)}</p>'
        "</article>"
    )


def _render_drawn(run: Done) -> str:
    """Promises that the run broke, and the settings that were drawn for it."""
    parts = [figure_text(run.figures.get("promises")), settings_of_run(run)]
    return "".join(f'<p class="quiet">{escape(part)}</p>' for part in parts if part)


def _render_hunt(store: Store, plan: Plan) -> str:
    """The worst run that a hunt met, and the same made small; empty for a campaign."""
    parts = []
    for fact, label in (("worst", "The worst run"), ("smallest", "The same with the fewest faults")):
        for run in store.runs("key = ?", [store.fact(fact)]):
            lines = "<br>".join(map(escape, describe_run(plan, run, label)))
            parts.append(f"<article><p>{lines}</p><p>{_command(store, run.key)}</p></article>")
    return f"<h2>What the hunt came to</h2>{''.join(parts)}" if parts else ""


def _why(store: Store, run: Done) -> str:
    """How the run ended, from the recording that it left; empty where that is not there any more."""
    place = store.folder / run.recording
    try:
        return why(read(place), f"{store.folder.name}/{run.recording}") if run.recording else ""
    except BridgeError:
        return ""


def _render_injections(plan: Plan, runs: Sequence[Done]) -> str:
    """Which fault came in which phase, and in how many runs; empty where no faults are drawn."""
    if plan.draw is None or not plan.draw.most:
        return ""
    table, empty = injections(plan, runs)
    named = "; ".join(empty) or "none"
    return (
        "<h2>Each fault in each phase</h2>"
        '<p class="quiet">Number of runs in which the fault was planned in this phase where all passed; else how many '
        "passed, of how many. A question mark is a phase in which no run had it yet.</p>"
        f"{table}<p>Not injected yet: {escape(named)}.</p>"
    )


def _endings(runs: Iterable[Done]) -> str:
    counts = Counter(run.outcome for run in runs)
    return pairs((outcome, str(count)) for outcome, count in counts.most_common())


def _never(plan: Plan, runs: Sequence[Done]) -> str:
    """Parts of the plan of which there are no results, and faults that it does not have."""
    done = Counter(run.number for run in runs)
    struck = Counter(run.number for run in runs if run.figures.get("struck"))
    lines: list[tuple[str, str, str]] = [
        (criterion.text, "", "this criterion concerned no run")
        for criterion in plan.criteria
        if runs and all(criterion.judge(run.figures) is None for run in runs)
    ]
    impossible: dict[tuple[str, str], list[str]] = {}
    for number, case in enumerate(plan.cases):
        if case.impossible:
            impossible.setdefault((fault_of(case), case.impossible), []).append(case.cell)
        elif not done[number]:
            lines.append((fault_of(case), case.cell, "no run yet"))
        elif case.table != "{}" and struck[number] < done[number]:
            often = (
                f"in {struck[number]} of {done[number]} runs only"
                if struck[number]
                else f"in none of {done[number]} runs"
            )
            lines.append((fault_of(case), case.cell, f"the fault struck {often}"))
    left = [(fault, f"{len(where)}: {'; '.join(where)}", text) for (fault, text), where in impossible.items()]
    parts = [f'<div class="scroll">{cells(("fault or criterion", "cell", "why"), lines, "wide")}</div>']
    if missing := _not_planned(plan):
        words = "; ".join(f"{on}: {', '.join(names)}" for on, names in missing.items())
        parts.append(
            f"<p>Faults that these cells can have, and that the plan does not inject: {escape(words)}.</p>"
        )
    if left:
        table = cells(("fault", "cells", "why they cannot have it"), left, "wide")
        count = sum(map(len, impossible.values()))
        parts.append(
            f'<details><summary>{count} cases cannot be</summary><div class="scroll">{table}</div></details>'
        )
    return "".join(parts)


def _not_planned(plan: Plan) -> Mapping[str, list[str]]:
    """Faults of the devices in the matrix that no case has, by target."""
    there: dict[str, dict[str, None]] = {}
    for text in dict.fromkeys(case.config for case in plan.cases):
        config = json.loads(text)
        robot, sensor = config["robot"]["emulated"], config["sensor"]["emulated"]
        try:
            known = EmulatedKinds.named(robot, sensor, config["cell"].get("surface_kind", "")).faults
        except ConfigError:  # a package that made the results is not installed here
            continue
        for on, faults in known.items():
            there.setdefault(on, {}).update(dict.fromkeys(faults))
    planned = {
        (table.get("on"), table.get("fault")) for case in plan.cases for table in [json.loads(case.table)]
    }
    if plan.draw is not None and plan.draw.most:
        planned |= set(drawn_faults(plan))
    left = {on: [name for name in names if (on, name) not in planned] for on, names in there.items()}
    return {on: names for on, names in left.items() if names}
