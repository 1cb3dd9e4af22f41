"""Self-contained HTML page of a campaign."""

import json
import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from urllib.parse import quote

from hil_bridge.devices.kinds import EmulatedKinds
from hil_bridge.errors import BridgeError, ConfigError
from hil_bridge.lab.campaign.criteria import OUTCOMES, figure_text, value_text
from hil_bridge.lab.campaign.digest import (
    FORCE,
    FigureResult,
    Tally,
    bound_of,
    criterion_results,
    facts_of,
    figure_results,
    most_missed,
    primary_results,
    share_of_bound,
    tally_of,
    true_force,
    true_force_text,
    unmet_by,
    verdict_of,
    worst_first,
)
from hil_bridge.lab.campaign.pictures import drawn_faults, injections, matrix
from hil_bridge.lab.campaign.plan import Plan
from hil_bridge.lab.campaign.report_text import criteria_section, figures_section, rerun_command
from hil_bridge.lab.campaign.run_text import describe_run, fault_of, faults_of_run, settings_of_run
from hil_bridge.lab.campaign.spreads import distributions
from hil_bridge.lab.campaign.store import Done, Store
from hil_bridge.lab.campaign.worst import recording_of, worst_run
from hil_bridge.record import read
from hil_bridge.record.analysis.figures import FIGURES
from hil_bridge.record.analysis.summary import summarise
from hil_bridge.record.analysis.why import why
from hil_bridge.show.charts.cell import cell_picture
from hil_bridge.show.charts.end_panel import unbreakable
from hil_bridge.show.pages import cell_room, document
from hil_bridge.show.report import write_report
from hil_bridge.show.report.markup import Value, cells, command, fold, pairs, prose, stacked

WORST = 30
"""Maximum number of failed runs listed individually, worst first. Chosen: longer lists are rarely read."""
REPORT_NAME = "report.html"


def page(store: Store, place: Path | None = None) -> str:
    """Render the page of the runs stored so far. `place` is the path of the page, for links to recordings; None
    omits the links, and the worst run in three dimensions.
    """
    body = PageBody(None if place is None else place.parent).render(store)
    return document(page_title(store.plan()), body, charts=False, cell="data-cell=" in body)


def report_place(store: Store, run: Done) -> Path:
    """Return the path where the page expects the report of a run."""
    return store.folder / run.key / REPORT_NAME


def write_reports(store: Store) -> int:
    """Write reports of the failed runs that the page lists and that have a recording. Return the number of reports
    written.

    An existing report is kept. A recording that this version can no longer read is skipped.
    """
    written = 0
    for run in worst_first(store.plan().criteria, store.runs())[:WORST]:
        place, recording = report_place(store, run), store.folder / run.recording
        if not run.recording or place.exists() or not recording.is_file():
            continue
        try:
            record = read(recording)
        except BridgeError:
            continue
        write_report(record, summarise(record), place.parent)
        written += 1
    return written


def page_title(plan: Plan) -> str:
    """Return the title of the page."""
    return f"Campaign {plan.name}"


class PageBody:
    """Renderer for the body of a campaign's page. It runs once for a file, and repeatedly for a live page."""

    def __init__(self, folder: Path | None = None) -> None:
        """Create a renderer. `folder` is the folder of the page, for links to recordings; None omits the links, and
        the worst run in three dimensions.
        """
        self._folder = folder
        self._reasons: dict[str, str] = {}
        """Cache of the explanations from `why`, by key of the run, since a recording no longer changes."""

    def render(self, store: Store) -> str:
        """Render the body for the runs stored so far. Raises ConfigError for a damaged file."""
        plan, runs = store.plan(), list(store.runs())
        tally, hunted, worst = tally_of(runs), _render_hunt(store, plan), worst_run(store, runs)
        planned = tally.total if hunted else plan.count
        failed = worst_first(plan.criteria, runs)
        others = [run for run in failed if worst is None or run.key != worst.key]
        figures = list(figure_results(plan, runs))
        cell, rows = self._cell(store, worst), primary_results(plan, figures)
        nearest, criteria = self._nearest(store, plan, runs, worst), _criteria(plan, runs)
        primary = f"<h2>Primary figures</h2>{_figures(rows)}" if rows else ""
        return f"""{_head(plan, tally, planned)}
<p class="point">{prose(unbreakable(point(plan, runs, planned)))}</p>
{_counts(tally, planned, runs)}
<h2>Each case of the matrix</h2>
{matrix(plan, runs)}
{primary}
<div class="pair"><section class="rest">{hunted + cell if hunted else self._worst(store, plan, worst, cell)}
</section><section>{nearest or criteria}</section></div>
{criteria if nearest else ""}
{fold(self._others(store, plan, others), "more-failed")}
<h2>Distribution of the figures</h2>
{distributions(plan, runs)}
{fold(f"<h2>Figures by cell</h2><div class='scroll'>{_figures(figures)}</div>", "figures")}
{fold(_render_injections(plan, runs), "injections")}
{fold(_never(plan, runs), "never")}
{fold(f"<h2>When, where and how fast</h2>{pairs(facts_of(store, plan, runs), 'facts')}", "facts")}"""

    def _worst(self, store: Store, plan: Plan, run: Done | None, cell: str) -> str:
        """Render the worst run with its picture `cell`; empty without a run."""
        if run is None:
            return ""
        title = f"Largest true force: {_force_text(plan, run)}" if run.passed else "The worst run"
        article = self._article(store, plan, run, plan.cases[run.number].cell, cell)
        return f"<h2>{unbreakable(title)}</h2>{article}"

    def _nearest(self, store: Store, plan: Plan, runs: Sequence[Done], worst: Done | None) -> str:
        """Render the run whose true force is nearest to its bound; empty if it is the worst run, or if a run failed."""
        nearest = max(runs, key=share_of_bound, default=None)
        if (
            worst is None
            or not worst.passed
            or nearest is None
            or nearest.key == worst.key
            or not bound_of(nearest)
        ):
            return ""
        article = self._article(store, plan, nearest, plan.cases[nearest.number].cell)
        return f"<h2>Nearest to its bound: {unbreakable(_force_text(plan, nearest))}</h2>{article}"

    def _cell(self, store: Store, run: Done | None) -> str:
        """Render the worst run in three dimensions, which the reader opens; empty without a recording."""
        source = None if run is None or self._folder is None else recording_of(store, run)
        if source is None or not source.recording.cycles:
            return ""
        return (
            '<details class="open-cell"><summary>Show this run in three dimensions</summary><div id="worst-cell">'
            f'{cell_room(cell_picture(source.recording))}</div><p class="quiet">{source.origin}</p></details>'
        )

    def _others(self, store: Store, plan: Plan, runs: Sequence[Done]) -> str:
        """Render the other failed runs by cell, the cell with the worst run first; empty if there are none."""
        listed = runs[: WORST - 1]
        by_cell: dict[str, list[Done]] = {}
        for run in listed:
            by_cell.setdefault(plan.cases[run.number].cell, []).append(run)
        parts = [
            f"<h3>{escape(cell)}: {len(group)}</h3>{''.join(self._article(store, plan, run, '') for run in group)}"
            for cell, group in by_cell.items()
        ]
        part = f", the worst {len(listed)} of them" * (len(runs) > len(listed))
        return f"<h2>{len(runs)} more that failed{part}, by cell</h2>{''.join(parts)}" if parts else ""

    def _article(self, store: Store, plan: Plan, run: Done, cell: str, more: str = "") -> str:
        """Render a run, with more markup at its end. `cell` names its cell; empty below a heading that does."""
        case = plan.cases[run.number]
        name = f"<strong>{escape(cell)}</strong>; " if cell else ""
        ended = f"{run.outcome}: {run.cause}" if run.cause else run.outcome
        unmet = [(FIGURES[one.figure].words, one.value, one.required) for one in unmet_by(plan, run)]
        listed = cells(("not met", "value", "required"), unmet, "narrow unmet") if unmet else ""
        force = "" if run.passed else f"Largest true force {true_force_text(plan, run)}."
        links = f'<p class="quiet">{text}</p>' if (text := self._recording(store, run) + force) else ""
        style = ' class="good"' * run.passed
        return (
            f"<article{style}><p>{name}fault {escape(faults_of_run(case, run))}; seed {run.seed}</p>"
            f"{listed}{_render_drawn(run)}<p>{prose(self._why(store, run) or ended)}</p>"
            f"{links}{_command(store, run.key, 'Repeat this run')}{more}</article>"
        )

    def _recording(self, store: Store, run: Done) -> str:
        """Render links to the recording of a run and, if there is one, its report."""
        if not run.recording or not (place := store.folder / run.recording).is_file():
            return ""
        parts = [self._link(place, "Recording")]
        if (report := report_place(store, run)).is_file():
            parts.append(self._link(report, "report"))
        return f"{', '.join(parts)}. "

    def _link(self, place: Path, text: str) -> str:
        if self._folder is None:
            return f"{text} <code>{escape(str(place))}</code>"
        target = quote(os.path.relpath(place, self._folder))
        return f'<a href="{escape(target)}">{text}</a>'

    def _why(self, store: Store, run: Done) -> str:
        """Explain from its recording how a run ended; empty if the recording no longer exists."""
        if not run.recording:
            return ""
        if run.key not in self._reasons:
            place = store.folder / run.recording
            try:
                self._reasons[run.key] = why(read(place), f"{store.folder.name}/{run.recording}")
            except BridgeError:
                self._reasons[run.key] = ""
        return self._reasons[run.key]


def point(plan: Plan, runs: Sequence[Done], planned: int) -> str:
    """Return in one sentence how the runs ended if all passed, or the criterion that most failed runs missed. `planned`
    is the number of runs of the complete campaign.
    """
    if not runs:
        return "No run has been executed yet."
    failed = [run for run in runs if not run.passed]
    if not failed:
        so_far = " so far" * (len(runs) < planned)
        return f"Every run{so_far} met every criterion; {_largest_force(plan, runs)}."
    cases = len({run.number for run in failed})
    where = f"{cases} of {len(plan.possible)} cases have failed runs"
    which = "failed run"
    if len(failed) == len(runs):
        every = "The only case" if cases == 1 else f"All {cases} cases"
        where = f"{every}{' run so far' * (len(runs) < planned)} failed"
        which = "run"
    count, criterion = most_missed(plan, failed)
    if criterion is None:
        return f"{where}."
    runs_of = f"every {which}" if count == len(failed) else f"{count} of {len(failed)} {which}s"
    return f"{where}; {runs_of} missed “{criterion.title}”."


def _largest_force(plan: Plan, runs: Sequence[Done]) -> str:
    """Describe the largest true force with the criterion on it, or else the true force that is nearest to its bound."""
    text = f"largest true force {true_force_text(plan, max(runs, key=true_force))}"
    for one in plan.criteria:
        if one.figure == FORCE:
            return f"{text} (required: {one.required})"
    nearest = max(runs, key=share_of_bound)
    return f"{text}; nearest to its bound: {_force_text(plan, nearest)}" if bound_of(nearest) else text


def _force_text(plan: Plan, run: Done) -> str:
    """Format the largest true force of a run, with its bound, which includes the run's faults, if there is one."""
    bound, text = bound_of(run), true_force_text(plan, run)
    return text if bound is None else f"{text} of {value_text('force_bound_n', bound)}"


def _head(plan: Plan, tally: Tally, planned: int) -> str:
    """Render name and verdict of the campaign."""
    bad, left = tally.failed + tally.errors, planned - tally.total
    what = "did not pass" if tally.errors else "failed"
    style, outcome = (
        ("bad", f"{bad} of {tally.total} {what}") if bad else ("good", f"all {tally.total} passed")
    )
    if left:
        style, outcome = style if bad else "plain", f"{outcome} · {left} not run"
    if not tally.total:
        style, outcome = "plain", "no run yet"
    return (
        f'<header class="headline"><h1>{escape(page_title(plan))}</h1>'
        f'<span class="badge {style}">{outcome}</span></header>'
    )


def _counts(tally: Tally, planned: int, runs: Iterable[Done]) -> str:
    """Render the counts of the campaign by verdict and outcome, as a bar with its legend."""
    kinds = Counter((verdict_of(run), run.outcome) for run in runs)
    several = len({outcome for _, outcome in kinds}) > 1
    bars, legend, begin = [], [], 0.0
    for verdict, count in (("passed", tally.passed), ("failed", tally.failed), ("errors", tally.errors)):
        marks = []
        for outcome in OUTCOMES:
            if part := kinds[verdict, outcome]:
                style, width = f"{verdict} {outcome}", 100.0 * part / max(planned, 1)
                bars.append(f'<rect class="{style}" x="{begin:.2f}" width="{width:.2f}" height="1"/>')
                text = f"{part} {outcome}" * (verdict != "errors")
                marks += [f'<i class="{style}"></i>{text}'] * several
                begin += width
        colour = f' class="{"good" if verdict == "passed" else "bad"}"' * bool(count)
        ended = f"<span>{' '.join(marks)}</span>" if marks else ""
        legend.append(f"<span><b{colour}>{count}</b> {verdict}</span>{ended}")
    return (
        '<svg class="progress" viewBox="0 0 100 1" preserveAspectRatio="none" role="img"'
        f' aria-label="runs by outcome">{"".join(bars)}</svg>\n<p class="tally">{" ".join(legend)}'
        f' <span class="quiet">{tally.total} of {planned} runs done</span></p>'
    )


def _criteria(plan: Plan, runs: Sequence[Done]) -> str:
    section = criteria_section(criterion_results(plan, runs))
    rows: list[Sequence[str | Value]] = [
        (one.title, met, Value(unmet, "bad" * (unmet != "0")), *others)
        for one, (_, met, unmet, *others) in zip(plan.criteria, section.rows, strict=True)
    ]
    return f"<h2>{section.title}</h2>{stacked(section.columns, rows, 1)}"


def _figures(figures: Iterable[FigureResult]) -> str:
    section = figures_section(figures)
    return stacked(section.columns, section.rows)


def _command(store: Store, key: str, purpose: str) -> str:
    return command(purpose, rerun_command(store.path.name, key))


def _render_drawn(run: Done) -> str:
    """Render the promises that the run broke, and the settings drawn for it."""
    promises, settings = figure_text(run.figures.get("promises")), settings_of_run(run)
    broken = f'<p class="quiet">{escape(promises)}</p>' if promises else ""
    listed = f"<details><summary>Drawn settings</summary><p>{escape(settings)}</p></details>"
    return broken + listed * bool(settings)


def _render_hunt(store: Store, plan: Plan) -> str:
    """Render the worst run of a hunt, and its reduced version; empty for a campaign."""
    parts = []
    for fact, label in (("worst", "The worst run"), ("smallest", "The same with the fewest faults")):
        for run in store.runs("key = ?", [store.fact(fact)]):
            lines = "<br>".join(map(escape, describe_run(plan, run, label)))
            parts.append(f"<article><p>{lines}</p>{_command(store, run.key, 'Repeat this run')}</article>")
    return f"<h2>Result of the hunt</h2>{''.join(parts)}" if parts else ""


def _render_injections(plan: Plan, runs: Sequence[Done]) -> str:
    """Render the number of runs with each fault in each phase; empty if no faults are drawn."""
    if plan.draw is None or not plan.draw.most:
        return ""
    return (
        f"<h2>Faults by phase</h2>{injections(plan, runs)}"
        '<p class="quiet">Runs that passed / runs in which the fault was planned in this phase. ? no run had it.</p>'
    )


def _never(plan: Plan, runs: Sequence[Done]) -> str:
    """Render the faults that took no effect in some runs, that no cell supports, and that are not in the plan."""
    done = Counter(run.number for run in runs)
    struck = Counter(run.number for run in runs if run.figures.get("struck"))
    lines: list[tuple[str, str, str]] = []
    impossible: dict[tuple[str, str], list[str]] = {}
    for number, case in enumerate(plan.cases):
        if case.impossible:
            impossible.setdefault((fault_of(case), case.impossible), []).append(case.cell)
        elif case.table != "{}" and struck[number] < done[number]:
            lines.append((fault_of(case), case.cell, f"{struck[number]} of {done[number]} runs"))
    left = [(fault, f"{len(where)}: {'; '.join(where)}", text) for (fault, text), where in impossible.items()]
    parts = [stacked(("fault", "cell", "took effect in"), lines, 3)] if lines else []
    if missing := _not_planned(plan):
        lists = "; ".join(f"{on}: {', '.join(names)}" for on, names in missing.items())
        parts.append(f"<p>Faults that these cells support and the plan does not inject: {escape(lists)}.</p>")
    if left:
        table = stacked(("fault", "cells", "why they do not support it"), left, 3)
        count = sum(map(len, impossible.values()))
        parts.append(f'<details id="impossible"><summary>{count} impossible cases</summary>{table}</details>')
    return f"<h2>Not exercised</h2>{''.join(parts)}" if parts else ""


def _not_planned(plan: Plan) -> Mapping[str, list[str]]:
    """Return the faults that the devices of the matrix support but no case injects, by target."""
    there: dict[str, dict[str, None]] = {}
    for text in dict.fromkeys(case.config for case in plan.cases):
        config = json.loads(text)
        robot, sensor = config["robot"]["emulated"], config["sensor"]["emulated"]
        try:
            known = EmulatedKinds.named(robot, sensor, config["cell"].get("surface_kind", "")).faults
        except ConfigError:  # a plug-in used for the results is not installed here
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
