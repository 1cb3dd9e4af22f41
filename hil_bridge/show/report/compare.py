"""Comparison of several runs: one page with overlaid charts, and tables of the differences."""

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace

from hil_bridge.errors import ConfigError
from hil_bridge.record.analysis.definition import UNKNOWN, difference, rounded
from hil_bridge.record.analysis.figures import CONTACT, FIGURES, MERIT, RESPONSE
from hil_bridge.record.analysis.strokes import TRACK
from hil_bridge.record.analysis.summary import Summary, phases, summarise
from hil_bridge.record.analysis.why import sentence, why_values
from hil_bridge.record.device_facts import devices_of
from hil_bridge.record.ending import Outcome
from hil_bridge.record.reader import Recording
from hil_bridge.show.charts.catalogue import CYCLE, catalogue
from hil_bridge.show.charts.columns import Columns
from hil_bridge.show.charts.end_panel import unbreakable
from hil_bridge.show.charts.facts import facts_of_recording, start_time
from hil_bridge.show.charts.run import run_marks
from hil_bridge.show.charts.sources import Sources
from hil_bridge.show.pages import Axis, Chart, Charts, Layer, Limit, Mark, Series, document, room
from hil_bridge.show.report.bag_page import assumptions_table
from hil_bridge.show.report.differences import ABSENT, between
from hil_bridge.show.report.figures import contact_rows, figure_tables, merit_rows, response_rows
from hil_bridge.show.report.identity import identity_rows
from hil_bridge.show.report.markup import across, badge, fold, note, prose, setting_cells, table

RUNS_MOST = 8
"""Maximum number of runs in a comparison, which is the number of distinguishable colours."""
_NAMED_MOST = 2
"""Maximum number of settings named in the first sentence. Chosen: the table has all."""
_OPEN_MOST = 6
"""Maximum number of differing settings that are not folded. Chosen: the charts begin on the first screen."""
_TASK = {
    "task.force_n": ("target force", "N"),
    "task.speed_mm_s": ("speed", "mm/s"),
    "task.step": ("steps of the program", ""),
}
"""Settings that define the task, with quantity and unit; the steps are too long for a sentence."""
_RESULTS = tuple(FIGURES[key].words for key in ("rise_s", "overshoot_percent", "rms_error_n"))
"""Figures in the first sentence, by their labels; the last one is comparable only if the runs have the same task."""
_RESULTS_MOST = 4
"""Maximum number of runs whose figures are in the first sentence. Chosen: two lines of text."""
_TOUCH_S = (-0.5, 3.0)
"""Range that is visible at first if the targets differ, s from the touch. Chosen: the rise and its overshoot."""
_TARGET = "force_reference"
"""Column of the target force."""
TOUCH, BEGIN = "touch", "begin"
"""Event at 0 s: the start of the first tracking, or the start of the run."""
COMPARED = {
    "force": "force",
    "lateral": "lateral",
    "moments": "moment",
    "depth": "depth",
    "correction": "correction",
    "stiffness": "stiffness",
    "times": "cycle_ms",
}
"""Charts of the catalogue that are overlaid, and the column of each chart that is drawn for each run."""


def compare_values(runs: Mapping[str, Recording]) -> dict[str, Any]:
    """Return outcome and figures of each run by name, and the settings that differ.

    Raises ConfigError as `compare_page` does.
    """
    _check_number(runs)
    ours = _with_settings(runs)
    summaries = {name: summarise(recording) for name, recording in runs.items()}
    return {
        "runs": {
            name: {"outcome": one.outcome, **one.figures, **one.response, **one.contact}
            for name, one in summaries.items()
        },
        "settings": {
            key: dict(zip(ours, values, strict=True)) for key, *values in between(list(ours.values()))
        },
    }


def _check_number(runs: Mapping[str, Recording]) -> None:
    if not 2 <= len(runs) <= RUNS_MOST:
        raise ConfigError(f"compare takes 2 to {RUNS_MOST} recordings, not {len(runs)}")


def compare_page(runs: Mapping[str, Recording], align: str = TOUCH) -> str:
    """Render the page of at least two runs by name. Raises ConfigError for too few or too many runs."""
    _check_number(runs)
    summaries = {name: summarise(recording) for name, recording in runs.items()}
    labels = _labels(runs, summaries)
    charts = _charts(dict(zip(labels, runs.values(), strict=True)), align)
    ours = _with_settings(runs)
    settings, only_some = _differing(ours)
    figures = [_figures_of(runs[name], summaries[name]) for name in runs]
    merits = [row.label for one in summaries.values() for row in merit_rows(one)]
    caution = _caution([*ours], [*settings, *only_some])
    merit = _figure_table(labels, summaries, figures, merits, best=not caution)
    body = f"""<h1>{len(runs)} runs compared</h1>
<p class="point">{prose(_results(dict(zip(runs, figures, strict=True)), _RESULTS[: -1 if caution else None]))}
{prose(_point([summaries[name] for name in ours], [key for key, *_ in settings]))}</p>
{caution}
<h2>Course</h2>
{room("runs", charts, first=1)}
<div class="pair"><section><h2>Figures of merit</h2>{merit}</section>
<section>{_settings(ours, settings, only_some)}</section></div>
<h2>How they ended</h2>
{_side_by_side(labels, _ends(runs, summaries), "sides")}
{fold(f"<h2>Other figures</h2>{_figure_table(labels, summaries, figures, merits)}")}
{_bags(runs)}"""
    return document(f"compared: {', '.join(runs)}", body)


def _labels(runs: Mapping[str, Recording], summaries: Mapping[str, Summary]) -> list[str]:
    """Return the names of the runs, each with its controller and its robot if they are not those of all runs."""
    controllers = [summaries[name].controller for name in runs]
    robots = [devices_of(recording).robot.kind for recording in runs.values()]
    parts = [[""] * len(runs) if len(set(one)) == 1 else one for one in (controllers, robots)]
    named = ([one, f"over {robot}" if one and robot else robot] for one, robot in zip(*parts, strict=True))
    return [
        ": ".join(filter(None, (name, " ".join(filter(None, both)))))
        for name, both in zip(runs, named, strict=True)
    ]


def _caution(names: Sequence[str], settings: Sequence[tuple[str, ...]]) -> str:
    """Render a caution if the runs had different tasks; empty if they had the same."""
    parts = []
    for key, *values in settings:
        if key in _TASK:
            quantity, unit = _TASK[key]
            texts = (f"{value} {unit} in `{name}`" for name, value in zip(names, values, strict=True))
            parts.append(f"{quantity} {', '.join(texts)}" if unit else quantity)
    if not parts:
        return ""
    text = f"{prose(unbreakable('; '.join(parts)))}. Compare the figures with care."
    return f'<p class="bar caution"><b>Different tasks:</b>{text}</p>'


def _results(figures: Mapping[str, Mapping[str, str]], labels: Sequence[str]) -> str:
    """Return the figures with these labels of each run in one sentence; empty if there are too many runs."""
    parts = []
    for label in labels:
        values = {name: texts.get(label, UNKNOWN) for name, texts in figures.items()}
        known = [f"{text} in `{name}`" for name, text in values.items() if text != UNKNOWN]
        parts += [f"{label} {', '.join(known)}"] * bool(known)
    return sentence(unbreakable("; ".join(parts))) if len(figures) <= _RESULTS_MOST else ""


def _point(summaries: Sequence[Summary], keys: Sequence[str]) -> str:
    """Return in one sentence how many runs completed, and which settings differ; bags have neither."""
    if not summaries:
        return "Bags of other programs contain neither settings nor an end."
    completed = sum(one.outcome == Outcome.COMPLETED for one in summaries)
    named = " and ".join(f"`{key}`" for key in keys) if len(keys) <= _NAMED_MOST else f"{len(keys)} settings"
    differ = f"{named} differ{'s' * (len(keys) == 1)}" if keys else "no setting differs"
    return f"{completed} of {len(summaries)} runs completed; {differ}."


def _differing(runs: Mapping[str, Recording]) -> tuple[list[tuple[str, ...]], list[tuple[str, ...]]]:
    """Return the settings that all runs have with different values, and those that only some runs have."""
    rows = between(list(runs.values()))
    return [row for row in rows if ABSENT not in row], [row for row in rows if ABSENT in row]


def _settings(
    runs: Mapping[str, Recording], settings: Sequence[tuple[str, ...]], only_some: Sequence[tuple[str, ...]]
) -> str:
    """Render the settings that differ, folded if they are many, and, folded, those that only some runs have."""
    titles = ("setting", *runs)
    parts = []
    if 0 < len(settings) <= _OPEN_MOST:
        parts.append(f"<h2>Settings that differ</h2>{across(setting_cells(titles, settings))}")
    elif settings:
        heading = f"<h2>Settings that differ: {len(settings)}</h2>"
        parts.append(fold(f"{heading}{across(setting_cells(titles, settings))}"))
    if only_some:
        heading = f"<h2>Settings that only some runs have: {len(only_some)}</h2>"
        parts.append(fold(f'{heading}<div class="scroll">{setting_cells(titles, only_some)}</div>'))
    return "".join(parts)


def _ends(runs: Mapping[str, Recording], summaries: Mapping[str, Summary]) -> Iterator[str]:
    """Yield the lines with the outcome and the cause of each run."""
    yield f"<td>outcome</td>{''.join(f'<td>{badge(summaries[name].outcome)}</td>' for name in runs)}"
    yield f"<td>why</td>{''.join(f'<td>{prose(why_values(runs[name]).point)}</td>' for name in runs)}"


def _side_by_side(labels: Iterable[str], lines: Iterable[str], style: str, last: str = "") -> str:
    """Render a table with a column for each run, in the colour of its curves, and perhaps a last column."""
    heads = "".join(
        f'<th><i class="swatch" style="background:var(--c{place})"></i>{escape(name)}</th>'
        for place, name in enumerate(labels, 1)
    )
    heads += f"<th>{escape(last)}</th><th>farther from 0</th>" if last else ""
    return across(table(lines, style, f"<thead><tr><th></th>{heads}</tr></thead>"))


def _with_settings(runs: Mapping[str, Recording]) -> Mapping[str, Recording]:
    """Return the runs that have settings. Recordings of other programs have no settings."""
    return {name: recording for name, recording in runs.items() if recording.foreign is None}


def _bags(runs: Mapping[str, Recording]) -> str:
    """Render the assumptions with which each bag was read."""
    return "".join(
        fold(f"<h2>{escape(name)}: assumptions</h2>{assumptions_table(bag)}")
        for name, recording in runs.items()
        if (bag := recording.foreign) is not None
    )


def names_of(paths: Sequence[Path]) -> list[str]:
    """Return unique short names for recordings.

    The name is the file name if it is unique, otherwise folder and file name, otherwise the full path.
    """
    for name in (lambda path: path.stem, lambda path: f"{path.absolute().parent.name}/{path.stem}", str):
        names = [name(path) for path in paths]
        if len(set(names)) == len(names):
            return names
    raise ConfigError("compare was given the same file twice; name each recording once")


def _charts(runs: Mapping[str, Recording], align: str) -> Charts:
    sources = Sources()
    series: dict[str, list[Series]] = {chart: [] for chart in COMPARED}
    marks: list[Mark] = []
    differ, targets = _targets([*runs.values()])
    own = differ and not targets
    longest = max(runs, key=lambda name: sum(cycle.phase == TRACK for cycle in runs[name].cycles))
    for place, (name, recording) in enumerate(runs.items()):
        zero = _zero(recording, align)
        layer, colour = f"run{place}", f"{place + 1}"
        table = Columns.of(recording, zero, facts_of_recording(recording)).arrays().get(CYCLE, {})
        if targets and table:
            table = {**table, **{one: 100.0 / targets[place] * table[one] for one in ("force", _TARGET)}}
        has_target = (own or name == longest) and bool(np.isfinite(table.get(_TARGET, np.empty(0))).any())
        for chart, column in COMPARED.items():
            if column not in table or not np.isfinite(table[column]).any():
                continue
            columns = (column, _TARGET) if chart == "force" and has_target else (column,)
            source = sources.add(layer, chart, table["x"], {one: table[one] for one in columns})
            line = Series(source, column, name, colour, layer=layer)
            series[chart].append(line)
            if _TARGET in columns:
                dashes = replace(
                    line, column=_TARGET, label=f"{name}, target", style="step", dashed=True, width=1.0
                )
                common = replace(dashes, label="target", colour="target", layer="")
                series[chart].append(dashes if own else common)
        marks += [
            replace(mark, text=f"{name}: {mark.text}", short=f"{name}, stop", layer=layer)
            for mark in run_marks(recording, zero)
            if mark.kind == "stop"
        ]
    charts = [
        replace(
            chart, title=_title(chart), series=series[chart.id], bands=[], limits=_same_limits(chart, runs)
        )
        if not targets or chart.id != "force"
        else replace(
            chart, unit="% of the target", series=series["force"], bands=[], limits=[], least_span=20.0
        )
        for chart in catalogue(facts_of_recording(next(iter(runs.values()))))
        if series.get(chart.id)
    ]
    label = "time since contact" if align == TOUCH else "time since the run began"
    layers = [Layer(f"run{place}", name) for place, name in enumerate(runs)]
    axis = Axis(label, "s", view=_TOUCH_S if targets and align == TOUCH else None)
    return Charts({"time": axis}, charts, sources.held, marks, layers=layers)


def _targets(recordings: Sequence[Recording]) -> tuple[bool, Sequence[float]]:
    """Return whether the targets of the runs differ, and the target of each run, N, if they differ and none changes."""
    each = [{cycle.force_reference for cycle in recording.cycles} for recording in recordings]
    ours = (one for one, recording in zip(each, recordings, strict=True) if recording.foreign is None)
    differ, steady = len(set().union(*ours)) != 1, all(len(one) == 1 and min(one) > 0.0 for one in each)
    return differ, [min(one) for one in each] if differ and steady else []


def _title(chart: Chart) -> str:
    """Return the title of a chart; it names the displayed series if the chart has several."""
    labels = [one.label for one in chart.series if one.column == COMPARED[chart.id]]
    return f"{chart.title}: {labels[0]}" if len(chart.series) > 1 and chart.id != "force" else chart.title


def _same_limits(chart: Chart, runs: Mapping[str, Recording]) -> list[Limit]:
    """Return the limits of a chart that are equal in all runs."""
    each = [
        next((one.limits for one in catalogue(facts_of_recording(run)) if one.id == chart.id), ())
        for run in runs.values()
    ]
    column = COMPARED[chart.id]
    return [
        limit
        for limit in chart.limits
        if limit.column in ("", column) and all(limit in limits for limits in each)
    ]


def _zero(recording: Recording, align: str) -> float:
    """Return the time at 0 s, s on the run's clock.

    It is the start of tracking if there is one, otherwise the start of the run; for a bag, it is the first contact.
    """
    if recording.foreign is not None and align == TOUCH:
        touches = (cycle.controlled_at for cycle in recording.cycles if cycle.in_contact)
        return next(touches, start_time(recording))
    touched = [span.begin for span in phases(recording) if span.name == TRACK]
    return touched[0] if touched and align == TOUCH else start_time(recording)


def _figures_of(recording: Recording, summary: Summary) -> dict[str, str]:
    """Return the figures of a run as texts, by label."""
    tables = (rows for _, rows in figure_tables(recording, summary))
    listed = [*(row for rows in tables for row in rows), *response_rows(summary), *contact_rows(summary)]
    return dict(identity_rows(recording, summary)) | {row.label: row.value for row in listed}


def _figure_table(
    labels: Sequence[str],
    summaries: Mapping[str, Summary],
    figures: Sequence[Mapping[str, str]],
    merits: Sequence[str],
    best: bool | None = None,
) -> str:
    """Render each figure of merit or, if `best` is None, each other figure that a run has; of two runs, also the
    difference. If `best` is true, the best value of each line is bold.
    """
    others = best is None
    changes = _changes(*summaries.values()) if len(summaries) == 2 else {}
    last = " − ".join(reversed([*summaries])) if changes else ""
    marked = _best([*summaries.values()]) if best else {}
    lines = (
        "".join(_figure_cells(labels, row, marked.get(row[0], ())))
        + _change_cells(last, *changes.get(row[0], ("", 0.0))) * bool(changes)
        for row in _figure_lines(figures, merits, others)
    )
    text = "Bold is the best value." if best else "No value is marked as best: the tasks differ."
    text += (
        " A bar points to the run whose value is farther from 0; a full bar is a difference of 100 %."
        * bool(changes)
    )
    return _side_by_side(labels, lines, "narrow stacked", last) + note("" if others else text)


def _figure_cells(titles: Sequence[str], row: Sequence[str], best: Collection[int]) -> Iterator[str]:
    """Yield the cells of a line of figures. If all runs have the same value, the line is grey."""
    label, *values = row
    style = " quiet" * (len(set(values)) == 1)
    yield f'<td class="text{style}">{escape(label)}</td>'
    for place, (title, text) in enumerate(zip(titles, values, strict=True)):
        mark = " best" * (place in best)
        yield f'<td class="count{style}{mark}" data-title="{escape(title)}">{escape(text)}</td>'


def _change_cells(title: str, text: str, share: float) -> str:
    """Render a difference as text, and as a bar towards the run whose value is farther from 0, in its colour."""
    width, style = 50.0 * min(abs(share), 1.0), "count" if share else "count quiet"
    place = (
        f"left:{50.0 - width * (share < 0.0):.0f}%;width:{width:.0f}%;background:var(--c{1 + (share > 0.0)})"
    )
    bar = f'<i class="change"><b style="{place}"></b></i>' * bool(text)
    cell = f'<td class="{style}" data-title="{escape(title)}">{escape(text)}</td>'
    return f'{cell}<td class="bars" data-title="farther from 0">{bar}</td>'


def _best(summaries: Sequence[Summary]) -> dict[str, set[int]]:
    """Return by label the places of the best displayed value of each figure of merit that all runs have; none if all
    are equally good.
    """
    places = {}
    for figure in MERIT:
        values = [run.figures.get(figure.key) for run in summaries]
        known = [value for value in values if value is not None and math.isfinite(value)]
        costs = [cost for value in known if (cost := figure.cost(rounded(value, figure))) is not None]
        if len(costs) == len(values) and len(set(costs)) > 1:
            places[figure.words] = {place for place, cost in enumerate(costs) if cost == min(costs)}
    return places


def _changes(first: Summary, second: Summary) -> dict[str, tuple[str, float]]:
    """Return by label how much larger each figure of the second run is, as text, and how much farther from 0 it is, as
    a share of the farther one; only of figures that both have.
    """
    one, other = ({**run.figures, **run.response, **run.contact} for run in (first, second))
    changes = {}
    for figure in (*MERIT, *RESPONSE, *CONTACT):
        before, after = one.get(figure.key), other.get(figure.key)
        if before is not None and after is not None and math.isfinite(before) and math.isfinite(after):
            sizes = [abs(rounded(value, figure)) for value in (before, after)]
            share = (sizes[1] - sizes[0]) / (max(sizes) or 1.0)
            changes[figure.words] = difference(before, after, figure), share
    return changes


def _figure_lines(
    figures: Sequence[Mapping[str, str]],
    merits: Sequence[str],
    others: bool,
) -> Iterator[tuple[str, ...]]:
    """Yield label and values of each figure."""
    for label in dict.fromkeys(label for texts in figures for label in texts):
        values = [texts.get(label) or ABSENT for texts in figures]
        if (label in merits) is others or set(values) == {ABSENT}:
            continue
        yield label, *values
